"""Generated balls keep to the map, scripts can be read, and no behaviour of a ball breaks the main tree."""

from __future__ import annotations

import itertools
import math
import subprocess
import sys

import numpy as np
import pytest
from hypothesis import HealthCheck, example, find, given, settings
from hypothesis import strategies as st

from mazeplan.apps.testing import (
    BallBehaviour,
    Jump,
    Pass,
    Rest,
    Roll,
    ball_behaviours,
    run_tree,
)
from mazeplan.apps.testing.balls import DT, states
from mazeplan.core.errors import InputError
from mazeplan.core.records import FailureKind
from mazeplan.core.resources import to_install
from mazeplan.maze.mapfile import load_map

MAZE, OTHER = load_map("cme"), load_map("lopsided")
FEW = settings(deadline=None, derandomize=True, database=None, suppress_health_check=list(HealthCheck))
REASONS = {"arrived", *map(str, FailureKind)}


def inside(maze, x, y):
    """The ring in which a ball's centre may be at this place, None in an opening; False in a wall."""
    r, theta = math.hypot(x, y), math.atan2(y, x)
    for ring in maze.rings:
        low = 0.0 if ring.is_disc else ring.inner_radius + maze.ball.radius
        if low - 1e-9 <= r <= ring.outer_radius - maze.ball.radius + 1e-9:
            return ring.number
    across = [r * abs(math.sin(theta - o.angle)) for o in maze.openings if math.cos(theta - o.angle) > 0]
    return None if min(across, default=1.0) < 1e-9 else False


@pytest.mark.slow
@settings(FEW, max_examples=200)
@given(st.data())
def test_a_generated_ball_keeps_to_the_map_but_where_it_jumps(data):
    maze = data.draw(st.sampled_from((MAZE, OTHER)))
    ball = data.draw(ball_behaviours(maze))
    path = ball.path(maze)
    places = [inside(maze, x, y) for x, y in path]
    assert places[0] == ball.ring
    assert False not in places
    steps = np.hypot(*np.diff(path, axis=0).T)
    assert np.sum(steps > 1.0 * DT) <= sum(isinstance(move, Jump) for move in ball.moves)
    passed = [maze.opening(move.opening) for move in ball.moves if isinstance(move, Pass)]
    if not any(isinstance(move, Jump) for move in ball.moves):
        rings = [ring for ring in places if ring is not None]
        changes = [{a, b} for a, b in itertools.pairwise(rings) if a != b]
        assert changes == [{o.outer, o.inner} for o in passed]


@pytest.mark.slow
@pytest.mark.parametrize(
    "wanted",
    [
        lambda ball: any(isinstance(move, Roll) for move in ball.moves),
        lambda ball: any(isinstance(move, Rest) and move.seconds > 0.6 for move in ball.moves),  # stuck
        lambda ball: [m.opening[:3] for m in ball.moves if isinstance(m, Pass)] == ["1-2", "1-2"],  # falls back
        lambda ball: any(isinstance(move, Jump) and abs(move.ring - ball.ring) > 1 for move in ball.moves),
        lambda ball: any(b - a > 0.5 for a, b in ball.unseen),
    ],
)
def test_there_are_balls_of_every_kind(wanted):
    ball = find(ball_behaviours(MAZE), wanted, settings=settings(FEW, max_examples=5000))
    assert len(ball.moves) <= 3  # shrunk
    assert len(ball.unseen) <= 1


def test_a_move_that_the_map_does_not_allow_is_refused():
    with pytest.raises(InputError, match="Pass: got '2-3@90', expected one of ring 1: 1-2@45"):
        BallBehaviour(moves=(Pass("2-3@90"),)).path(MAZE)


def test_an_exact_state_follows_the_ball_and_is_lost_when_it_is_not_seen():
    out = states(BallBehaviour(2, 90.0, (Roll(1.0, 30.0), Jump(4, 0.0)), unseen=((0.2, 0.9),)), MAZE, 0.5)
    assert [s.ring for s in out] == [2] * 31 + [4]
    assert math.degrees(out[30].theta) == pytest.approx(120.0)
    assert out[3].theta_dot == pytest.approx(math.radians(30.0), rel=0.01)
    assert out[-1].speed == 0.0
    assert [s.t for s in out if not s.seen] == pytest.approx([k / 30 for k in range(6, 27)])
    assert [s.t for s in out if s.lost] == pytest.approx([k / 30 for k in range(21, 27)])


LEAVES_AT_THE_LAST_MOMENT = (Pass("1-2@45", 0.1), Jump(1, 0.0), Jump(1, 13.0))  # too far apart to be believed soon


@pytest.mark.slow
@settings(FEW, max_examples=25)
@example(ball=BallBehaviour(moves=LEAVES_AT_THE_LAST_MOMENT), goal=2)
@given(ball=ball_behaviours(MAZE), goal=st.integers(1, 5))
def test_whatever_a_ball_does_the_main_tree_ends_by_name_and_within_the_limits(ball, goal):
    record = run_tree(ball=ball, goal=goal, time_limit=4.0).never("outside limits").within(4.1)
    assert record.reason in REASONS
    if record.success:
        assert record.ticks[-1].ring == goal


@pytest.mark.slow
def test_without_hypothesis_the_kit_works_and_its_strategies_say_what_they_need():
    code = """if True:
        import sys
        sys.modules["hypothesis"] = sys.modules["pytest"] = None  # as if they were not installed
        from mazeplan.apps.testing import tick_tree
        tree = '<root BTCPP_format="4"><BehaviorTree ID="Main"><Replan/></BehaviorTree></root>'
        tick_tree(tree).ends_with("SUCCESS")
        try:
            from mazeplan.apps.testing import ball_behaviours
        except ImportError as problem:
            print(problem)
    """
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.stderr == ""
    said = "the strategies of mazeplan.apps.testing need hypothesis, which is not installed"
    assert done.stdout == f"{said}: {to_install('testing')}\n"
