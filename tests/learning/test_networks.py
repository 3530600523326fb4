"""Networks: compiled against plain, trained on a ball that is known, kept in files, used by the planner."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from finite_differences import jacobian
from gaussian_processes import state_inputs
from process_folder import arrays, assert_refused, edit, put, saved
from ring_record import ring_table

from mazeplan.control import uncertain_cost
from mazeplan.control.cost import CostParameters
from mazeplan.control.ring_planner import RingPlanner
from mazeplan.core.errors import InputError, ModelError, TableError
from mazeplan.learning import gp_dynamics, learned_part, rollout
from mazeplan.learning.ball_models import NetworkBall
from mazeplan.learning.fitting import FitOptions, fit_kind
from mazeplan.learning.modelfile import RigModel, load_model, packed_model, save_model, unpacked_model
from mazeplan.learning.network_training import NetworkOptions, train_networks
from mazeplan.learning.networks import ARRAYS, WIDTH, Networks
from mazeplan.learning.online_rig import OnlineModel
from mazeplan.learning.posterior import draw_model
from mazeplan.learning.rig_gp import learn_processes
from mazeplan.learning.samples import SampleOptions, ring_samples
from mazeplan.learning.smoothing import Smoothing
from mazeplan.maze.mapfile import load_map
from mazeplan.physics.ball_model import BallModel
from mazeplan.physics.dynamics.ring_parameters import RingParameters
from mazeplan.physics.effects.ball import rolling_inertia, viscous_friction
from mazeplan.physics.rig.stage import StageModel

MAZE = load_map("cme")
AT = np.int64(0)
TINY = NetworkOptions(members=3, hidden=8, updates=120, rolled=15, horizon=10)
SHORT = replace(TINY, updates=20, rolled=2)


def networks(members=3, hidden=8, inputs="state", seed=0):
    rng, d = np.random.default_rng(seed), WIDTH[inputs]
    shapes = ((d, hidden), (hidden,), (hidden, hidden), (hidden,), (hidden,), ())
    arrays = {n: 0.5 * rng.standard_normal((members, *s)) for n, s in zip(ARRAYS, shapes, strict=True)}
    return Networks(**arrays, noise=0.4, rows=100, inputs=inputs)


def states(n, seed=1):
    return np.random.default_rng(seed).uniform(-1.0, 1.0, (n, 6)) * [9.0, 2.0, 0.1, 0.5, 0.1, 0.5]


@pytest.fixture(scope="module")
def samples():
    pytest.importorskip("torch")
    table = ring_table((2,), 30.0)
    return ring_samples(table, MAZE, Smoothing(window=9), SampleOptions())[2]


@pytest.fixture(scope="module")
def good(samples):
    return np.flatnonzero(samples.good)


# --- prediction


def test_the_compiled_mean_and_its_derivatives_are_those_of_the_plain_ensemble():
    some = networks()
    packed, slopes = learned_part.pack(some), np.empty(6)
    for s in states(20):
        value = learned_part.mean_and_gradient(packed, AT, s, slopes)
        assert value == pytest.approx(some.mean(state_inputs(s[None]))[0], abs=1e-9)
        assert learned_part.mean(packed, AT, s) == value
        plain = jacobian(lambda x: some.mean(state_inputs(x[None])), s)[0]
        np.testing.assert_allclose(slopes, plain, rtol=1e-5, atol=1e-7)


def test_the_compiled_variance_is_the_spread_of_the_members_and_its_slopes_follow():
    some = networks()
    packed, slopes, bend = learned_part.pack(some), np.empty(6), np.empty(6)
    for s in states(20):
        value = learned_part.variance_and_derivatives(packed, AT, s, 0.0, np.empty(9), slopes, bend)
        assert value == pytest.approx(some.variance(state_inputs(s[None]))[0] - 0.4**2, rel=1e-9)
        plain = jacobian(lambda x: some.variance(state_inputs(x[None])), s)[0]
        np.testing.assert_allclose(slopes, plain, rtol=1e-4, atol=1e-6)
        assert (bend >= 0.0).all()


def test_draws_of_an_ensemble_have_its_mean_and_its_spread(samples, good):
    ball = NetworkBall((rolling_inertia(0.5),), networks())
    k = samples.at(good[:5])
    many = samples.at(np.tile(good[:5], 4000))
    drawn = draw_model(ball, ball, 4000, np.random.default_rng(0))(many).reshape(4000, 5)
    np.testing.assert_allclose(drawn.mean(axis=0), ball.mean(k), atol=0.1)
    np.testing.assert_allclose(drawn.std(axis=0), ball.each(k).std(axis=0, ddof=1), rtol=0.05)


@pytest.mark.parametrize("name", ARRAYS)
def test_arrays_that_do_not_fit_are_refused(name):
    good = networks()
    with pytest.raises(ModelError, match="got shape"):
        replace(good, **{name: getattr(good, name)[:2]})
    with pytest.raises(ModelError, match=name):
        replace(good, **{name: getattr(good, name) * math.nan})


# --- training


def test_networks_beside_effects_find_the_friction_that_the_effects_lack(samples, good):
    """The ball of `ring_record` has friction; without it, effects alone predict badly, and networks make up for it."""
    bare = (rolling_inertia(0.5),)
    terms, found = train_networks(samples, good, bare, TINY, fitted=True)
    target, k = samples.theta_ddot[good], samples.at(good)
    left = [np.std(target - m.mean(k)) for m in (NetworkBall(bare, constant()), NetworkBall(terms, found))]
    assert left[1] < 0.6 * left[0]
    assert terms[0].values()["factor"] != 0.5
    assert 0.5 * left[1] < found.noise < 2.5 * left[1]  # of rows left out


def constant():
    zero = {name: np.zeros_like(getattr(networks(), name)) for name in ARRAYS}
    return Networks(**zero, noise=1.0, rows=1)


def test_without_fitting_the_effects_stay_as_they_are(samples, good):
    given = (rolling_inertia(0.5), viscous_friction(0.1))
    terms, _ = train_networks(samples, good, given, TINY, fitted=False)
    assert terms == given


@pytest.mark.parametrize("rates", ["smoothed", "delayed"])
def test_training_rolls_out_as_the_scores_do(samples, good, rates):
    """The errors inside the training are those of `rollout` from the same start."""
    from mazeplan.learning.network_training import _Learner

    table = ring_table((2,), 30.0)
    own = ring_samples(table, MAZE, Smoothing(window=9), SampleOptions(rates=rates))[2]
    rows = np.flatnonzero(own.good)
    learner = _Learner(own, rows, (rolling_inertia(0.5),), replace(TINY, horizon=rollout.STEPS), "state", rates, {})
    start = learner._free[0][::40]
    found = learner.rolled(np.tile(start, (TINY.members, 1))).detach().numpy()
    ball = NetworkBall(learner.terms(), replace(learner.networks(), rows=1))
    theta, rate = own.k.theta[start], own.k.theta_dot[start]
    if rates == "delayed":
        theta, rate = own.measured[start], (own.measured[start + 1] - own.measured[start - 1]) / (2.0 * own.dt)
    wanted = rollout.rollout_function(rates)(ball.mean, own, start, theta, rate)
    np.testing.assert_allclose(np.abs(found[0]), wanted.error[:, 1:], atol=2e-4)


def test_the_same_seed_gives_the_same_networks(samples, good):
    one, same, other = (
        train_networks(samples, good, (rolling_inertia(0.5),), SHORT, fitted=True, seed=seed)[1] for seed in (1, 1, 2)
    )
    assert all(np.array_equal(getattr(one, n), getattr(same, n)) for n in ARRAYS)
    assert not np.array_equal(one.first, other.first)


def test_too_few_rows_are_refused(samples):
    with pytest.raises(TableError, match="got 4 rows"):
        train_networks(samples, np.arange(4), (rolling_inertia(0.5),), TINY, fitted=False)


@pytest.mark.parametrize("kind", ["nn", "spnn"])
def test_both_kinds_are_fitted_like_any_other(samples, good, kind):
    model = fit_kind(kind, samples, good, FitOptions(inputs="local", networks=TINY)).model
    error = model.mean(samples.at(good)) - samples.theta_ddot[good]
    assert np.std(error) < 0.7 * np.std(samples.theta_ddot[good])


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["nn", "spnn"])
def test_a_rig_model_with_networks_predicts_blocks_that_a_member_has_not_seen(kind):
    pytest.importorskip("torch")
    start = RigModel(StageModel(), {2: BallModel((rolling_inertia(0.4),))}, kind="pi")
    model, learned = learn_processes(ring_table((2,), 30.0), MAZE, start, kind, FitOptions(networks=TINY))
    assert (model.kind, set(model.processes), model.by_effects(2)) == (kind, {2}, kind == "spnn")
    assert learned[2].after < (learned[2].before if kind == "spnn" else 1.0)
    moved = model.ball(2).parameter("rolling_inertia", "factor", 0.0)
    assert (moved > 0.4) == (kind == "spnn")  # the truth is 5/9


# --- files, planner, learning while running

BALLS = {1: BallModel((rolling_inertia(0.58), viscous_friction(0.3)))}
MODEL = RigModel(StageModel(), BALLS, kind="spnn", processes={1: networks()})


def test_a_model_with_networks_survives_its_folder_and_its_log(tmp_path):
    save_model(MODEL, tmp_path / "m")
    for back in (load_model(tmp_path / "m"), unpacked_model(packed_model(MODEL))):
        assert back.kind == "spnn"
        for name in (*ARRAYS, "noise", "rows"):
            np.testing.assert_array_equal(getattr(back.processes[1], name), getattr(MODEL.processes[1], name))


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"format": np.array(2)}, "got 2, expected 1"),
        ({"noise": np.array(-1.0)}, "noise"),
        ({"first": np.zeros((3, 5, 8))}, "first"),
        ({"last": np.zeros((3, 8), np.float32)}, "float32"),
        ({"second": None}, "lacks second"),
    ],
)
def test_damaged_networks_are_refused_with_file_and_line(tmp_path, changes, said):
    save_model(MODEL, tmp_path / "m")
    changed = arrays(tmp_path / "m") | changes
    put(tmp_path / "m", saved(**{name: array for name, array in changed.items() if array is not None}))
    assert_refused(tmp_path / "m", "processes.1", said, line_of="1:")


def test_a_number_changed_by_hand_is_refused(tmp_path):
    save_model(MODEL, tmp_path / "m")
    edit(tmp_path / "m", "hidden: 8", "hidden: 9")
    assert_refused(tmp_path / "m", "processes.1", "hidden: changed by hand", line_of="1:")


def test_the_planner_plans_on_networks_and_their_price_keeps_it_near_known_states():
    """Networks that push the ball along: a plan that knows of them arrives in the rolled-out model."""
    parameters = RingParameters.from_model(MODEL, 1, MAZE.track_radius(1))
    pushing = replace(constant(), last_bias=np.full(3, 0.8))
    plan = RingPlanner(parameters, MAZE.tilt_limit, process=pushing).plan(np.zeros(6), 0.4)
    assert plan.ok
    assert plan.states[-1, 0] == pytest.approx(0.4, abs=0.05)
    packed, s = gp_dynamics.pack(parameters, pushing), np.zeros(6)
    for u in plan.controls:
        out = np.empty(6)
        gp_dynamics.step(s, u, packed, out)
        s = out
    np.testing.assert_allclose(s, plan.states[-1], atol=1e-9)
    priced = uncertain_cost.pack(CostParameters(uncertainty=2.0), networks())
    priced[: uncertain_cost.PLAIN] = CostParameters().pack(0.4)
    bare = CostParameters().pack(0.4)
    s, u = states(1)[0], np.zeros(2)
    spread = networks().variance(state_inputs(s[None]))[0] - 0.4**2
    more = uncertain_cost.running(3, s, u, priced) - uncertain_cost.plain_running(3, s, u, bare)
    assert more == pytest.approx(2.0 * spread, rel=1e-9)


def test_a_model_with_networks_does_not_learn_while_running():
    with pytest.raises(InputError, match="spnn does not learn while running"):
        OnlineModel(replace(MODEL, camera_delay=0.05), MAZE)
