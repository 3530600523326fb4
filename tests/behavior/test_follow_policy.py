"""The leaf that follows a learned policy: as long as it knows the state, and not a tick longer."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
from policies import LIMIT, hand_made

from mazeplan.apps.testing import run_tree
from mazeplan.behavior.context import RunContext, Steering
from mazeplan.behavior.follow_policy import FollowPolicy
from mazeplan.btree.blackboard import Blackboard
from mazeplan.btree.status import FAILURE, RUNNING, SUCCESS
from mazeplan.control.tilt import Plate
from mazeplan.core.errors import InputError, TreeError
from mazeplan.core.records import State
from mazeplan.maze.graph import RouteGraph
from mazeplan.maze.mapfile import load_map
from mazeplan.run.settings import load_settings

MAZE = load_map("cme")
OPENING = MAZE.openings_between(1, 2)[0]


def at(turn_deg: float, t: float = 0.0, ring: int = 1) -> State:
    """A ball at rest in the middle of a ring, so far from the opening."""
    r, theta = max(MAZE.track_radius(ring), 1e-3), OPENING.angle - math.radians(turn_deg)
    return State(t, r * math.cos(theta), r * math.sin(theta), 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, ring)


class Bench:
    """A context with a policy, and the leaf on it."""

    def __init__(self, policy=None, opening=OPENING, **ports):
        self.events = []
        self.run = RunContext(
            maze=MAZE, graph=RouteGraph(MAZE), plate=Plate(LIMIT), goal=5,
            steering=Steering({}, load_settings().leaves),
            ahead=lambda seconds, beside=(0.0, 0.0): self.run.here, report=self.events.append, policy=policy,
        )  # fmt: skip
        self.leaf = FollowPolicy("FollowPolicy", self.run, Blackboard(), {"opening": opening.name, **ports})

    def tick(self, state):
        self.run.begin(state.t, state, state)
        self.leaf.execute()
        return self.leaf.status


def test_it_sends_what_the_policy_says_and_the_log_says_what_is_followed():
    bench = Bench(hand_made(turn=(0.0, 0.2)))
    assert bench.tick(at(40.0)) is RUNNING
    command, theta = bench.run.command, at(40.0).theta
    along = 0.2 * LIMIT * math.radians(40.0)
    assert (command.u_beta, command.u_gamma) == pytest.approx((-math.sin(theta) * along, -math.cos(theta) * along))
    assert [event.law for event in bench.events] == ["policy"]


def test_it_goes_on_the_way_round_that_it_began_past_half_a_turn():
    bench = Bench(hand_made(turn=(0.0, 0.1)))
    signs = []
    for turn in (179.0, 181.0, 183.0):
        bench.tick(at(turn))
        c, s, u = math.cos(at(turn).theta), math.sin(at(turn).theta), bench.run.command
        signs.append(-s * u.u_beta - c * u.u_gamma)
    assert signs == sorted(signs)
    assert signs[0] > 0.0


@pytest.mark.parametrize(("most", "status"), [(2.0, RUNNING), (0.5, FAILURE)])
def test_beyond_the_distance_of_its_port_the_state_is_unfamiliar(most, status):
    far = math.sqrt(sum(v * v for v in (math.radians(40.0), math.tanh(math.radians(40.0) / 0.15), 0.1125, 0, 1.0)))
    bench = Bench(hand_made(reach=far), max_distance=most)
    assert bench.tick(at(40.0)) is status
    assert [str(f.kind) for f in bench.run.history.failures] == (["unfamiliar"] if status is FAILURE else [])
    assert (bench.run.command is None) == (status is FAILURE)


def test_a_state_of_no_number_is_unfamiliar():
    bench = Bench(hand_made())
    assert bench.tick(replace(at(40.0), vx=math.nan)) is FAILURE
    assert bench.run.history.failures[0].kind == "unfamiliar"


def test_the_disc_is_unfamiliar():
    into = MAZE.openings_between(4, 5)[0]
    bench = Bench(hand_made(), into)
    assert bench.tick(at(0.0, ring=5)) is FAILURE
    assert "the disc" in bench.run.history.failures[0].words


def test_it_succeeds_in_the_next_ring_and_fails_in_another():
    for ring, status in ((2, SUCCESS), (3, FAILURE)):
        bench = Bench(hand_made())
        assert bench.tick(at(5.0)) is RUNNING
        assert bench.tick(at(5.0, 0.1, ring)) is status


@pytest.mark.parametrize(
    ("seconds", "moving", "kind"), [(0.7, False, "stuck"), (5.1, True, "missed_opening"), (4.9, True, None)]
)
def test_a_ball_that_stands_or_never_comes_ends_it(seconds, moving, kind):
    bench = Bench(hand_made())
    for k in range(round(30 * seconds)):
        status = bench.tick(at(60.0 - 0.5 * k * moving % 20, k / 30.0))
        if status is not RUNNING:
            break
    assert status is (RUNNING if kind is None else FAILURE)
    assert [str(f.kind) for f in bench.run.history.failures][:1] == ([] if kind is None else [kind])


def test_an_opening_that_closes_ends_it():
    bench = Bench(hand_made())
    assert bench.tick(at(40.0)) is RUNNING
    bench.run.graph.close(OPENING.name)
    assert bench.tick(at(39.0, 0.03)) is FAILURE
    assert bench.run.history.failures[0].kind == "opening_closed"


def test_without_a_policy_it_is_a_mistake_of_the_tree():
    with pytest.raises(TreeError, match=r"FollowPolicy.* the run has no policy; --policy DIR gives it one"):
        Bench(None).tick(at(40.0))


# -- the packaged tree ----------------------------------------------------------------------------------------------


@pytest.mark.slow
def test_the_tree_goes_by_the_policy_all_the_way_and_never_plans():
    record = run_tree("policy", policy=hand_made()).reaches().within(20.0).visits("FollowPolicy", "Settle")
    record.never("Track", "Recover")
    assert record.result.replans == 0
    assert record.result.planner_ms["max"] == 0.0


def test_where_the_policy_knows_nothing_the_planner_goes_every_leg():
    record = run_tree("policy", policy=hand_made(reach=1e-3)).reaches().within(6.0).visits("FollowPolicy", "Track")
    assert record.failures == ["unfamiliar"] * 4
    record.never("Recover")


def test_what_else_goes_wrong_is_for_the_packaged_tree_of_the_planner():
    record = run_tree("policy", policy=hand_made(), mishap=lambda rig: setattr(rig, "glued", rig.t < 2.0))
    record.visits("FollowPolicy", "Dither", "Track").reaches().within(9.0)
    assert record.failures[0] == "stuck"


def test_tree_and_policy_go_together_or_not_at_all():
    with pytest.raises(InputError, match="follows a learned policy, but the run has none: give --policy DIR"):
        run_tree("policy")
    with pytest.raises(InputError, match="--policy: the tree has no FollowPolicy"):
        run_tree("waypoints", policy=hand_made())
