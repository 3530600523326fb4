"""What is made of samples: observations, rewards and ends, without any physics."""

import math

import numpy as np
import pytest

from mazeplan.apps.environment.judging import HOLD, LOST, Judge, expected_times
from mazeplan.apps.environment.senses import HIGH, LOW, NAMES, RATE, Senses
from mazeplan.apps.environment.task import Task
from mazeplan.apps.environment.worlds import Samples
from mazeplan.control.estimation.rim_watch import SAMPLES
from mazeplan.core.errors import SettingsError
from mazeplan.maze.graph import RouteGraph
from mazeplan.maze.mapfile import load_map

MAZE = load_map("cme")
ROW = np.array([0])
STILL = np.zeros((1, 2))


def sample(t, x, y, beta=0.0, gamma=0.0):
    return Samples(*(np.array([value]) for value in (t, x, y, beta, gamma)))


def begun(reward="sparse", ring=1, theta=0.0, **options):
    senses = Senses(MAZE, 30.0, 1)
    judge = Judge(Task(reward=reward, start_ring=ring, **options), senses, 1)
    radius = MAZE.track_radius(ring)
    senses.reset(ROW, sample(0.0, radius * math.cos(theta), radius * math.sin(theta)), [ring], [theta])
    judge.reset(ROW)
    return senses, judge


def walk(places, reward="sparse", **options):
    """Verdicts of a ball seen at these places, one sample apart."""
    senses, judge = begun(reward, **options)
    verdicts = []
    for step, (x, y) in enumerate(places, start=1):
        senses.take(ROW, sample(step / 30.0, x, y), STILL)
        verdicts.append(judge.judge(ROW))
    return verdicts


def named(senses):
    return dict(zip(NAMES, senses.state(ROW)[0].tolist(), strict=True))


def test_the_state_is_what_its_names_say():
    senses, _ = begun(ring=2, theta=0.5)
    for step in range(1, 4):  # 30 mm/s outwards, 1 rad/s round, and a plate that tilts at 0.3 rad/s
        radius, theta = 0.070 + 0.03 * step / 30.0, 0.5 + step / 30.0
        at = sample(step / 30.0, radius * math.cos(theta), radius * math.sin(theta), 0.01 * step, -0.005)
        senses.take(ROW, at, np.array([[0.02, -0.04]]))
    got, limit = named(senses), MAZE.tilt_limit
    expected = {
        "radius": radius / MAZE.rings[0].outer_radius, "cos_theta": math.cos(theta), "sin_theta": math.sin(theta),
        "beta": 0.03 / limit, "gamma": -0.005 / limit, "beta_rate": 0.3 / (RATE * limit), "gamma_rate": 0.0,
        "u_beta": 0.02 / limit, "u_gamma": -0.04 / limit, "ring": 0.25, "unseen": 0.0,
    }  # fmt: skip
    assert {name: got[name] for name in expected} == pytest.approx(expected, abs=1e-6)
    assert got["radial_speed"] == pytest.approx(0.03, abs=0.004)  # differences lag by a sample
    assert got["tangential_speed"] == pytest.approx(0.073, abs=0.004)


def test_an_unseen_ball_keeps_its_place_and_speed():
    senses, _ = begun(ring=2)
    for step in range(1, 4):
        senses.take(ROW, sample(step / 30.0, 0.07, 0.004 * step), STILL)
    before = named(senses)
    for step in range(4, 7):
        senses.take(ROW, sample(step / 30.0, math.nan, math.nan), STILL)
    after = named(senses)
    assert after.pop("unseen") == pytest.approx(0.1)
    assert before.pop("unseen") == 0.0
    assert after == before
    senses.take(ROW, sample(7 / 30.0, 0.07, 0.028), STILL)  # seen again, on its way: speed over the time that passed
    assert named(senses)["tangential_speed"] == pytest.approx(0.12, abs=0.02)


def test_nothing_leaves_the_bounds():
    senses, _ = begun()
    for t, x in ((1.0, 1.0), (1.0, -1.0), (1.0, 1.0), (9.0, 0.0)):  # with a clock that stood still
        senses.take(ROW, sample(t, x, x, 3.0 * x, x), STILL)
        state = senses.state(ROW)[0]
        assert state.dtype == np.float32
        assert np.all((state >= LOW) & (state <= HIGH))


def test_rings_are_the_maze_s_own():
    senses, radii = Senses(MAZE, 30.0, 1), np.linspace(0.0, 0.12, 200)
    assert senses.ring(radii).tolist() == [MAZE.ring_at(r) for r in radii]


def test_arrival_is_a_hold_inside_the_goal():
    needed = round(30 * HOLD) + 1
    here, gone, beside = (0.0, 0.001), (math.nan, math.nan), (0.0, 0.018)
    whole = walk([here] * needed)
    assert [bool(v.arrived[0]) for v in whole] == [False] * (needed - 1) + [True]
    assert [v.reward[0] for v in whole] == [0.0] * (needed - 1) + [1.0]
    blinked = walk([here, *[gone] * (needed - 2), here])
    assert blinked[-1].arrived[0]
    assert not blinked[-2].arrived[0]
    assert not walk([*[here] * (needed - 2), beside, *[here] * (needed - 1)])[-1].arrived[0]
    assert not any(v.out[0] for v in whole)


def test_an_unseen_ball_or_one_beyond_the_rim_is_out():
    lost = walk([(math.nan, math.nan)] * round(30 * LOST))
    assert [bool(v.out[0]) for v in lost] == [False] * (len(lost) - 1) + [True]
    assert not any(v.left[0] for v in lost)
    outside = walk([(0.12, 0.0)] * SAMPLES)
    assert [bool(v.out[0]) for v in outside] == [False] * (len(outside) - 1) + [True]
    assert [bool(v.left[0]) for v in outside] == [bool(v.out[0]) for v in outside]
    assert not any(v.out[0] for v in walk([(0.12, 0.0), (0.12, 0.0), (0.09, 0.0)] * 8))  # a wrong position or two
    nowhere = (math.nan, math.nan)
    assert not any(v.left[0] for v in walk([(0.12, 0.0), nowhere, nowhere, nowhere] * 4))
    for flown in ([(0.12, 0.0), (0.13, 0.0), nowhere], [(0.12, 0.0), nowhere, (0.13, 0.0)]):  # out of the picture
        assert [bool(v.left[0]) for v in walk(flown)] == [False, False, True]


def test_the_dense_reward_is_the_sparse_one_and_a_potential():
    """Summed with its discount, shaping leaves -phi(start): the same for all ways, so that none gains by it."""
    inwards = [(r, 0.0) for r in np.linspace(0.089, 0.001, 40)] + [(0.0, 0.001)] * 8
    wandering = [(0.089 * math.cos(a), 0.089 * math.sin(a)) for a in np.linspace(0.0, 4.0, 30)] + inwards
    _, judge = begun("dense", discount=0.97)
    start = judge.potential(ROW)[0]
    assert 0.0 < start < 0.5
    for places in (inwards, wandering):
        dense = walk(places, "dense", discount=0.97)
        sparse = walk(places)
        last = next(k for k, v in enumerate(dense) if v.arrived[0])
        factors = 0.97 ** np.arange(last + 1)
        shaped = sum(f * (d.reward[0] - s.reward[0]) for f, d, s in zip(factors, dense, sparse, strict=False))
        assert shaped == pytest.approx(-start, abs=1e-12)


def test_the_potential_is_the_expected_time_of_the_fastest_route():
    times, graph = expected_times(MAZE, 5), RouteGraph(MAZE)
    senses, judge = begun("dense", ring=3, theta=-math.pi + math.tau * 30 / 120)
    route = graph.route(3, 5, -math.pi + math.tau * 30 / 120)
    assert route is not None
    assert judge.potential(ROW)[0] == pytest.approx(1.0 - route.expected_s / times.max())
    assert np.all(times[4] == 0.0)
    closed = load_map("cme").openings  # towards the goal it grows, ring by ring
    gates = [next(o for o in closed if o.outer == ring) for ring in (1, 2, 3, 4)]
    phis = []
    for gate in gates:
        senses.take(
            ROW,
            sample(1.0, *(MAZE.track_radius(gate.outer) * np.array([math.cos(gate.angle), math.sin(gate.angle)]))),
            STILL,
        )
        phis.append(judge.potential(ROW)[0])
    assert np.all(np.diff(phis) > 0.0)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"observation": "sound"}, "observation: got 'sound'"),
        ({"discount": 0.0}, "discount: got 0.0"),
        ({"size": 4}, "size: got 4"),
        ({"size": True}, "size: got true"),
        ({"rig": 3}, "rig: got 3"),
        ({"start_angle_deg": math.nan}, "start_angle_deg: got"),
        ({"colour": "red"}, "colour: unknown key"),
    ],
)
def test_what_cannot_be_is_one_line(options, words):
    with pytest.raises(SettingsError) as problem:
        Task.of(options)
    assert str(problem.value).startswith(words)


def test_rings_to_start_in():
    assert Task().starts(MAZE) == (1,)
    assert Task(start_ring="any", goal_ring=3).starts(MAZE) == (1, 2, 4, 5)
    assert Task(start_ring="any").starts(MAZE, "ring2") == (2,)
    for options, words in (
        ({"start_ring": 5}, "start_ring: got ring 5, which is the goal"),
        ({"start_ring": 9}, "start_ring: got 9"),
        ({"goal_ring": "ring7"}, "goal_ring: got 'ring7'"),
    ):
        with pytest.raises(SettingsError, match=words):
            Task(**options).starts(MAZE)
