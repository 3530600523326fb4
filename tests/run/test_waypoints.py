"""Ring after ring: the goal of each part of a run is the tree's, not the run's."""

from __future__ import annotations

import json

import pytest
from commands import call as run_command

import mazeplan
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


@pytest.mark.slow
@pytest.mark.parametrize("seed", [0, 1, 2])
def test_the_ball_visits_the_rings_in_order(seed):
    result = mazeplan.navigate("ring1", "ring5", via=VIA, seed=seed, time_limit=30)
    assert result.success, result.reason
    assert rings_of(result) == [1, 2, 3, 2, 3, 4, 5]
    assert [(goal.ring, goal.t) for goal in result.goals] == [(3, 0.0), (2, 0.0), (3, 0.0), (5, 0.0)]


@pytest.mark.slow
def test_a_run_by_way_of_rings_is_replayed(tmp_path):
    log = tmp_path / "run.mcap"
    assert mazeplan.navigate("ring1", "ring4", via=("ring3", "ring2"), seed=1, time_limit=30, log=log).success
    assert replay(log).identical


def test_the_command_tells_each_mistake_and_takes_rings_in_either_form(tmp_path, monkeypatch, capsys):
    path = tmp_path / "mine.xml"
    path.write_text(OWN.replace('goal="2"/>', 'gaol="2"/><InRing ring="{aim}"/>'))
    own = ("navigate", "--rig", "ideal", "--behavior", str(path))
    code, out, err = run_command(monkeypatch, capsys, *own)
    assert (code, out) == (2, "")
    assert [line.partition("Mine/Sequence/")[2][:8] for line in err.splitlines()[-2:]] == ["Navigate", "InRing: "]
    path.write_text(OWN)
    code, _, err = run_command(monkeypatch, capsys, *own, "--via", "ring3,ring2", "--via", "ring3")
    assert (code, err.splitlines()[-1].partition(", but")[0]) == (2, "mazeplan: via: got ring3, ring2, ring3")
    words = ("navigate", "--rig", "ideal", "--to", "ring3", "--via", "ring2", "--via", "ring1,ring2", "--json")
    code, out, err = run_command(monkeypatch, capsys, *words)
    assert code == 0
    assert [goal["ring"] for goal in json.loads(out)["goals"]] == [2, 1, 2, 3]
    assert err.splitlines()[-1].endswith("goals: rings 2, 1, 2, 3)")
