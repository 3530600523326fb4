"""Ring after ring: the goal of each part of a run is the tree's, not the run's."""

from __future__ import annotations

import pytest

import mazeplan
from mazeplan.core.errors import InputError
from mazeplan.run.replay import replay

VIA = ("ring3", "ring2", "ring3")

OWN = """
<root BTCPP_format="4" main_tree_to_execute="Mine">
  <include path="navigate.xml"/>
  <BehaviorTree ID="Mine">
    <Sequence>
      <SubTree ID="Navigate" goal="3"/>
      <SubTree ID="Navigate" goal="2"/>
      <SubTree ID="Navigate" goal="3"/>
      <SubTree ID="Navigate" goal="{goal}"/>
    </Sequence>
  </BehaviorTree>
</root>
"""


def rings_of(result):
    """Rings in the order in which the ball came into them."""
    return [passage.ring for passage in result.rings]


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_the_ball_visits_the_rings_in_order(seed):
    result = mazeplan.navigate("ring1", "ring5", via=VIA, seed=seed, time_limit=30)
    assert result.success, result.reason
    assert rings_of(result) == [1, 2, 3, 2, 3, 4, 5]


def test_a_tree_of_ones_own_names_its_goals(tmp_path):
    path = tmp_path / "mine.xml"
    path.write_text(OWN)  # navigate.xml is a packaged tree: it does not lie beside this one
    result = mazeplan.navigate("ring1", "ring5", behavior=str(path), seed=4, time_limit=30)
    assert result.success, result.reason
    assert rings_of(result) == [1, 2, 3, 2, 3, 4, 5]


def test_a_run_by_way_of_rings_is_replayed(tmp_path):
    log = tmp_path / "run.mcap"
    assert mazeplan.navigate("ring1", "ring4", via=("ring3", "ring2"), seed=1, time_limit=30, log=log).success
    assert replay(log).identical


def test_a_ring_that_the_map_lacks_is_refused():
    with pytest.raises(InputError, match="ring9"):
        mazeplan.navigate("ring1", "ring5", via=("ring9",))
