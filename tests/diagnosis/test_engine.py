"""The diagnosis engine finds what a machine lacks, and only that."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from machine_records import Pendulum, Slider, play

from mazeplan.core.errors import InputError, TableError
from mazeplan.core.logs.columns import Rows
from mazeplan.diagnosis.engine.diagnosis import diagnose_motion
from mazeplan.diagnosis.engine.model import Model, scales
from mazeplan.diagnosis.engine.record import Record, noise_of, record_of, resolution
from mazeplan.diagnosis.engine.system import system_of
from mazeplan.diagnosis.engine.windows import Windows, cut
from mazeplan.physics import Effect, Parameter, sin

PENDULUM, SLIDER = system_of(Pendulum), system_of(Slider)


class FreePendulum:
    """A pendulum that nothing drives."""

    position, unit = "theta", "rad"
    parameters = {"stiffness": Parameter("1/s^2", 35.0, 1.0, 200.0)}  # noqa: RUF012

    @staticmethod
    def motion(s, p):
        return -p.stiffness * sin(s.theta)


def swing(**more):
    """A driven pendulum with further forces."""
    extra, more = more.pop("extra", lambda x, v: 0.0), {"size": 0.25, **more}
    return play(more.pop("seed", 1), lambda x, v, u: 8.0 * u - 30.0 * math.sin(x) + extra(x, v), **more)


def found(done):
    return [e["name"] for e in done.effects]


def size(done, name):
    entry = next(e for e in done.effects if e["name"] == name)
    (number,) = entry["parameters"].values()
    return number["value"], number["stderr"]


@pytest.mark.parametrize(
    ("what", "name", "true"),
    [
        ({"extra": lambda x, v: -0.2 * v}, "viscous_friction", 0.2),
        ({"dry": 0.5}, "dry_friction", 0.5),
        ({"extra": lambda x, v: -0.05 * v * abs(v)}, "quadratic_drag", 0.05),
        ({"extra": lambda x, v: 0.4}, "constant_torque", 0.4),
        ({"late": 0.08}, "input_delay", 0.08),
    ],
)
def test_one_effect_is_named_with_its_size(what, name, true):
    done = diagnose_motion(PENDULUM, swing(**what), {})
    assert found(done) == [name], done.sentence()
    value, stderr = size(done, name)
    assert value == pytest.approx(true, abs=max(5.0 * stderr, 0.03 * true))
    assert done.after.nrmse < 0.5 * done.before.nrmse
    assert done.remaining < 1.5


def test_a_lag_of_a_held_input_is_no_delay():
    done = diagnose_motion(replace(PENDULUM, held=("torque",)), swing(lag=0.1, rate=200.0), {})
    assert found(done) == ["input_lag"], done.sentence()
    value, stderr = size(done, "input_lag")
    assert value == pytest.approx(0.1, abs=max(5.0 * stderr, 0.006))


@pytest.mark.parametrize("rate", [6.0, 9.0])
def test_few_samples_in_a_swing_are_no_noise(rate):
    record = play(2, lambda x, v, u: -39.0 * math.sin(x), start=0.9, dry=0.1, noise=2e-3, rate=rate, size=0.0, fine=400,
                  seconds=50.0)  # fmt: skip
    done = diagnose_motion(system_of(FreePendulum), record, {})
    assert found(done) == ["dry_friction"], done.sentence()
    assert size(done, "dry_friction")[0] == pytest.approx(0.1, rel=0.05)
    assert done.remaining == pytest.approx(1.0, abs=0.2)


def test_two_effects_that_only_together_explain_a_record_are_found():
    record = play(
        5, lambda x, v, u: -39.0 * math.sin(x) - 0.05 * v * abs(v), start=2.6, dry=0.4, noise=0.0,
        quantum=math.tau / 4000.0, rate=50.0, size=0.0, fine=200,
    )  # fmt: skip
    done = diagnose_motion(system_of(FreePendulum), record, {})
    assert sorted(found(done)) == ["dry_friction", "quadratic_drag"], done.sentence()
    assert size(done, "dry_friction")[0] == pytest.approx(0.4, rel=0.05)
    assert size(done, "quadratic_drag")[0] == pytest.approx(0.05, rel=0.05)


def test_lines_between_samples_of_a_smooth_input_are_no_gain():
    """Twelve samples in the shortest period: lines lose 2 % of it."""
    record = play(4, lambda x, v, u: 2.0 * u - 0.4 * v, rate=15.0, fine=400, noise=2e-4)
    done = diagnose_motion(SLIDER, record, {"motion": {"gain": 2.0}})
    assert found(done) == ["viscous_friction"], done.sentence()
    assert size(done, "viscous_friction")[0] == pytest.approx(0.4, rel=0.01)


def test_a_lag_shorter_than_a_sample_is_found():
    record = play(4, lambda x, v, u: 2.0 * u - 0.4 * v, rate=15.0, fine=400, noise=2e-4, lag=0.05)
    done = diagnose_motion(SLIDER, record, {"motion": {"gain": 2.0}, "viscous_friction": {"coefficient": 0.4}})
    assert found(done) == ["input_lag"], done.sentence()
    assert size(done, "input_lag")[0] == pytest.approx(0.05, rel=0.02)


def test_inputs_that_are_held_without_a_word_are_pointed_at():
    t, rng = np.arange(3000) / 100.0, np.random.default_rng(3)
    given = np.repeat(rng.normal(0.0, 3.0, 300), 10)
    speed = np.concatenate([[0.0], np.cumsum(2.0 * given[:-1]) / 100.0])
    place = np.concatenate([[0.0], np.cumsum(speed[:-1] / 100.0 + given[:-1] / 1e4)])
    record = Record(t, (place + 1e-4 * rng.standard_normal(3000))[:, None], given[:, None])
    done = diagnose_motion(SLIDER, record, {})
    assert found(done) == []
    assert any("held = (" in note for note in done.notes)
    assert diagnose_motion(replace(SLIDER, held=("force",)), record, {}).verdict == "nothing_missing"


def test_friction_that_would_drive_is_not_taken():
    record = swing(seed=6, extra=lambda x, v: 0.3 * abs(v))
    done = diagnose_motion(replace(PENDULUM), record, {"viscous_friction": {"coefficient": 0.1}})
    assert "viscous_asymmetry" not in found(done), done.sentence()


@pytest.mark.parametrize("what", [{}, {"quantum": 5e-3}, {"jitter": 0.4}, {"rate": 40.0}, {"noise": 1e-4, "fine": 400}])
def test_where_nothing_is_missing_it_says_so(what):
    done = diagnose_motion(PENDULUM, swing(seed=3, **what), {})
    assert done.verdict == "nothing_missing", done.sentence()
    assert not done.effects
    assert all(entry["why_not"] for entry in done.document()["tried"])


def test_rest_at_the_end_does_no_harm():
    record = play(4, lambda x, v, u: 2.0 * u - 0.5 * v, dry=0.8, stop=12.0, size=1.0, seconds=30.0)
    done = diagnose_motion(SLIDER, record, {})
    assert set(found(done)) == {"viscous_friction", "dry_friction"}, done.sentence()
    assert 0.0 < done.after.nrmse < done.before.nrmse


def test_what_no_effect_explains_is_not_called_complete():
    record = swing(seed=5, extra=lambda x, v: 3.0 * math.sin(7.0 * x))
    done = diagnose_motion(PENDULUM, record, {})
    assert done.verdict in ("unknown_effect", "effect_found", "ambiguous")
    assert done.verdict == "unknown_effect" or done.remaining > 1.5


def test_a_number_that_the_record_leaves_open_is_marked():
    class Narrow(Slider):
        parameters = {"gain": Parameter("1/kg", 1.0, 0.5, 1.5)}  # noqa: RUF012

    record = play(6, lambda x, v, u: 2.0 * u, noise=1e-4)
    done = diagnose_motion(system_of(Narrow), record, {})
    (motion,) = done.document()["fitted"]
    assert motion["parameters"]["gain"]["determined"] is False
    assert done.verdict != "nothing_missing"


def test_declared_values_are_not_fitted_and_a_known_effect_is_not_found():
    record = swing(seed=7, extra=lambda x, v: -0.3 * v)
    done = diagnose_motion(PENDULUM, record, {"viscous_friction": {"coefficient": 0.3}})
    assert done.verdict == "nothing_missing", done.sentence()
    along = diagnose_motion(PENDULUM, record, {}, ["viscous_friction"])
    entry = next(e for e in along.fitted if e["name"] == "viscous_friction")
    assert entry["parameters"]["coefficient"]["value"] == pytest.approx(0.3, abs=0.01)


def test_an_effect_of_a_user_is_found():
    own = Effect("magnet", {"strength": Parameter("rad/s^2", 0.0, -50.0, 50.0)},
                 formula=lambda s, p: p.strength * s.theta**3)  # fmt: skip
    done = diagnose_motion(system_of(Pendulum, [own]), swing(seed=8, extra=lambda x, v: -2.0 * x**3), {})
    assert found(done) == ["magnet"]
    assert size(done, "magnet")[0] == pytest.approx(-2.0, rel=0.05)


def test_a_further_record_is_only_scored():
    one, two = (swing(seed=seed, extra=lambda x, v: -0.2 * v) for seed in (1, 2))
    done = diagnose_motion(PENDULUM, one, {}, test=two)
    assert done.test is not None
    assert done.test[1].nrmse < 0.5 * done.test[0].nrmse


def test_gaps_and_empty_cells_are_bridged():
    record = swing(extra=lambda x, v: -0.2 * v)
    keep = np.ones(len(record), dtype=bool)
    keep[700:760] = False
    y = record.y.copy()
    y[100:110] = np.nan
    done = diagnose_motion(PENDULUM, Record(record.t[keep], y[keep], record.u[keep]), {})
    assert found(done) == ["viscous_friction"]
    assert size(done, "viscous_friction")[0] == pytest.approx(0.2, rel=0.05)


@pytest.mark.parametrize(
    ("change", "line", "words"),
    [
        (lambda t: 1000.0 * t, 1, "unit"),
        (lambda t: 1.7e18 + np.round(1e9 * t), 1, "unit"),
        (lambda t: np.where(t == t[50], t[48], t), 50, "grow"),
        (lambda t: np.floor(2.0 * t) / 2.0, 1, "grow"),
    ],
)
def test_times_that_cannot_be_right_are_refused_with_their_row(tmp_path, change, line, words):
    t = 0.02 * np.arange(200)
    rows = Rows(tmp_path / "log.csv", range(200))
    with pytest.raises(TableError, match=words) as caught:
        record_of(change(t), np.sin(t)[:, None], np.empty((200, 0)), ("rad",), rows)
    assert caught.value.line == line


def test_rows_with_one_time_are_merged(tmp_path):
    t = 0.02 * np.arange(200)
    t = np.insert(t, 10, t[10])
    record = record_of(t, np.sin(t)[:, None], np.empty((201, 0)), ("rad",), Rows(tmp_path, range(201)))
    assert len(record) == 200
    assert len(record.notes) == 1


def test_the_noise_is_that_of_the_sensor():
    rng, t = np.random.default_rng(0), 0.01 * np.arange(3000)
    y = np.sin(3.0 * t) + 2e-3 * rng.standard_normal(3000)
    assert noise_of(Record(t, y[:, None], np.empty((3000, 0))))[0] == pytest.approx(2e-3, rel=0.1)
    rounded = 0.01 * np.round(np.sin(3.0 * t) / 0.01)
    assert noise_of(Record(t, rounded[:, None], np.empty((3000, 0))))[0] == pytest.approx(0.01 / np.sqrt(12.0), rel=0.4)


def test_a_fast_encoder_skips_steps():
    steps = np.random.default_rng(1).choice([2, 3, 4], 400, p=[0.6, 0.3, 0.1])
    assert resolution(1e-3 * np.cumsum(steps)) == pytest.approx(1e-3)
    assert resolution(np.random.default_rng(1).standard_normal(400)) == 0.0


def test_a_fit_of_windows_agrees_with_a_plain_least_squares():
    """Independently: scipy on all parameters and initial states at once, with another integrator."""
    from scipy.integrate import solve_ivp
    from scipy.interpolate import CubicSpline
    from scipy.optimize import least_squares

    record = swing(seed=9, seconds=6.0, rate=50.0, extra=lambda x, v: -0.5 * v)
    noise = noise_of(record)
    model = Model(PENDULUM, record, noise, scales(PENDULUM, record, noise))
    windows = cut(record, 75)
    values = {"motion": {"stiffness": 25.0, "gain": 6.0}, "viscous_friction": {"coefficient": 0.1}}
    free = (("motion", "stiffness"), ("motion", "gain"), ("viscous_friction", "coefficient"))
    ours = Windows(model, windows).fit(values, free)

    given = CubicSpline(record.t, record.u[:, 0])

    def residual(p):
        out = []
        for m, (a, b) in enumerate(windows):

            def motion(t, z):
                u = given(t)
                return z[1], p[1] * u - p[0] * np.sin(z[0]) - p[2] * z[1]

            x = solve_ivp(motion, (record.t[a], record.t[b - 1]), p[3 + 2 * m : 5 + 2 * m], t_eval=record.t[a:b],
                          rtol=1e-8, atol=1e-8, max_step=0.02).y[0]  # fmt: skip
            out.append((x - record.y[a:b, 0])[1:])
        return np.concatenate(out) / noise[0]

    start = np.concatenate([[ours.values[e][n] for e, n in free], ours.states.ravel()])
    assert ours.total == pytest.approx(float(np.sum(residual(start) ** 2)), rel=1e-3)
    plain = least_squares(residual, start, x_scale=np.maximum(np.abs(start), 0.1), max_nfev=20)
    assert ours.total < 2.0 * plain.cost * 1.005
    assert plain.x[:3] == pytest.approx(start[:3], rel=2e-3)


@pytest.mark.parametrize(
    ("told", "message"),
    [
        ({"unit": "degrees"}, "unit: got 'degrees', expected rad or m"),
        ({"inputs": ("theta_dot",)}, "inputs: got 'theta_dot'"),
        ({"held": "pull"}, "held: got 'pull', expected one of force"),
        ({"parameters": {"gain": 2.0}}, "motion.gain: got 2.0, expected Parameter"),
        ({"effects": ("wind",)}, "effects: got 'wind', expected an Effect or one of viscous_friction"),
        ({"effects": ("dry_friction", "dry_friction")}, "got the effect 'dry_friction', expected names"),
        ({"motion": lambda s, p: s.wind * p.gain}, "the formula of motion cannot be used: got wind in a formula"),
        ({"motion": 9.81}, "got no motion(s, p)"),
        ({"positions": ("x", "x"), "unit": "m"}, "positions: got 1 names"),
    ],
)
def test_a_class_that_cannot_be_used_is_refused(told, message):
    with pytest.raises(InputError) as caught:
        system_of(type("Wrong", (Slider,), told))
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)
