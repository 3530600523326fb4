"""What the model of a drive axis lacks is named, on records of a plant that shares nothing with the models."""

from __future__ import annotations

from pathlib import Path

import axisplant
import numpy as np
import pytest
from ring_records import names, parameters

from mazeplan.diagnosis.coordinate.fit import Fit, Likelihood, best_q, fit, start_of
from mazeplan.diagnosis.coordinate.kalman import NODES
from mazeplan.diagnosis.mechanism.diagnose import diagnose_mechanism
from mazeplan.diagnosis.mechanism.drive_log import MotionLog, read_drive
from mazeplan.diagnosis.mechanism.emps import EMPS
from mazeplan.diagnosis.mechanism.scores import course_of, free_run, relative_error, sized
from mazeplan.diagnosis.mechanism.system import thinned

LOAD = EMPS.motion.name
TRUE = {
    LOAD: {"mass": 95.0},
    "viscous_friction": {"coefficient": 200.0},
    "dry_friction": {"coefficient": 20.0, "asymmetry": 0.0},
}
FRICTION = ("viscous_friction", "dry_friction")


def record(**what):
    columns = axisplant.play(**what)
    gain = columns["gtau"]
    return MotionLog(axisplant.DT, columns["qm"].ravel(), gain * columns["vir"], gain)


def value(done, name, parameter):
    number = parameters(done, name)[parameter]
    return number["value"], number["stderr"]


def whole(log, names, declared=None):
    """Effects fitted to all of a record; its course, too."""
    course = course_of(EMPS, log, declared or {})
    library, _, weakest = sized(course)
    free = [c for c in library if c.name in names]
    system = thinned(EMPS, log, declared or {}, weakest)
    likelihood = Likelihood(system, library, np.ones(len(system), dtype=bool))
    start = {c.name: start_of(c) for c in free}
    return course, likelihood, fit(likelihood, free, start)


@pytest.mark.slow
@pytest.mark.parametrize("process", [0.0, 0.3, 2.0], ids=["quiet", "noisy", "very noisy"])
def test_where_nothing_is_missing_it_says_so(process):
    done = diagnose_mechanism(EMPS, record(seed=1, process=process), TRUE)
    assert done.verdict == "nothing_missing", done.sentence()
    assert done.effects == ()
    assert done.sentence().startswith("Nothing is missing")


@pytest.mark.slow
def test_of_the_bare_mass_all_friction_is_found_with_its_direction():
    done = diagnose_mechanism(EMPS, record(seed=1, lopsided=-35.0), {})
    assert done.verdict == "effect_found", done.sentence()
    assert names(done) == ["dry_friction", "viscous_asymmetry", "viscous_friction"]
    for name, true in (("viscous_friction", 200.0), ("viscous_asymmetry", -35.0), ("dry_friction", 20.0)):
        got, sigma = value(done, name, "coefficient")
        assert got == pytest.approx(true, abs=4.0 * sigma)
        assert sigma < 0.1 * abs(true)
    assert done.fitted[0]["parameters"]["mass"]["value"] == pytest.approx(95.0, rel=0.005)
    assert done.after.nrmse < 0.05 < 0.4 < done.before.nrmse
    assert done.after.free_run < 0.01 * done.before.free_run
    assert any("N s/m forwards" in remark for remark in done.remarks)
    for effect in done.effects:
        assert effect["evidence"] > 15.0
        assert effect["before"] > effect["after"] == pytest.approx(done.after.nrmse)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("what", "declared", "along", "name", "parameter", "true"),
    [
        ({"quadratic": 600.0}, {}, FRICTION, "quadratic_drag", "coefficient", 600.0),
        ({"stiffness": 40.0}, {}, FRICTION, "elastic_force", "stiffness", 40.0),
        ({"drift": 4.0}, {}, FRICTION, "friction_drift", "rate", 4.0),
        ({"offset": 4.0}, TRUE, (), "constant_force", "force", -4.0),
        ({"mass": 99.0}, TRUE, (), LOAD, "mass", 99.0),
        ({"viscous": 230.0}, TRUE, (), "viscous_friction", "coefficient", 230.0),
        ({"dry": 24.0}, TRUE, (), "dry_friction", "coefficient", 24.0),
    ],
    ids=lambda x: x if isinstance(x, str) else None,
)
def test_one_effect_is_named_with_its_size(what, declared, along, name, parameter, true):
    done = diagnose_mechanism(EMPS, record(seed=1, **what), declared, along)
    assert names(done) == [name], done.sentence()
    got, sigma = value(done, name, parameter)
    assert got == pytest.approx(true, abs=max(4.0 * sigma, 0.01 * abs(true)))
    assert done.after.nrmse < done.before.nrmse
    assert name.replace("_", " ") in done.sentence()


def test_what_swings_with_time_has_no_name_and_a_frequency():
    done = diagnose_mechanism(EMPS, record(seed=1, hum=(3.3, 6.0)), {}, FRICTION)
    assert done.verdict == "unknown_effect"
    document = done.document()
    assert document["unknown"]["depends_on"] == ["time"]
    assert "3.3" in document["unknown"]["description"] or "3.29" in document["unknown"]["description"]
    assert float(document["unknown"]["description"].split()[-2]) == pytest.approx(6.0, rel=0.1), "in N"


def test_a_dry_friction_that_is_smaller_forwards_is_as_good_a_find_as_one_that_is_larger():
    for offset in (3.0, -3.0):
        _, _, found = whole(record(seed=2, seconds=8.0, offset=offset), [LOAD, *FRICTION])
        assert found.values["dry_friction"]["asymmetry"] == pytest.approx(offset, abs=0.5)


@pytest.mark.slow
def test_a_further_record_is_scored_whole_and_changes_nothing():
    log, other = record(seed=1, lopsided=-35.0, seconds=12.0), record(seed=7, lopsided=-35.0, seconds=6.0)
    alone, both = (diagnose_mechanism(EMPS, log, {}, FRICTION, test=test) for test in (None, other))
    assert both.effects == alone.effects
    assert both.after == alone.after
    assert both.test is not None
    assert both.test[1].seconds == pytest.approx(6.0)
    assert both.test[1].nrmse < both.test[0].nrmse


def test_the_force_error_is_that_of_least_squares_on_derivatives():
    """Independently: the inverse model's columns, decimated like the force."""
    from scipy.signal import butter, decimate, filtfilt

    log = record(seed=3, seconds=8.0)
    course, likelihood, found = whole(log, [LOAD, *FRICTION])
    b, a = butter(4, 100.0, fs=1000.0)
    q = filtfilt(b, a, log.position)
    v = np.gradient(q, 1e-3)
    dry, m, c = (
        found.values["dry_friction"],
        found.values[LOAD]["mass"],
        found.values["viscous_friction"]["coefficient"],
    )
    needed = m * np.gradient(v, 1e-3) + c * v + dry["coefficient"] * np.sign(v) + dry["asymmetry"]
    e, y = (
        decimate(x, 10, ftype="iir", zero_phase=True)[10:-10] for x in (needed - log.inputs[:, 0], log.inputs[:, 0])
    )
    assert relative_error(course, likelihood, found, 0.0) == pytest.approx(
        np.linalg.norm(e) / np.linalg.norm(y), rel=0.03
    )


def test_the_free_run_never_sees_the_position_again():
    log = record(seed=3, seconds=8.0, process=0.0)
    _, likelihood, found = whole(log, [LOAD, *FRICTION])
    off = free_run(likelihood, found, 4.0)
    assert off < 1e-3
    system = likelihood.system
    system.theta[system.t > 4.5] += 0.01
    assert free_run(likelihood, found, 4.0) == pytest.approx(0.01 * np.sqrt(3.5 / 4.0), rel=0.05)


def test_terms_are_forces_over_the_mass():
    log = record(seed=3, seconds=2.0)
    declared = {LOAD: {"mass": 50.0}}
    course = course_of(EMPS, log, declared)
    named, nameless, weakest = sized(course)
    library = [*named, *nameless]
    system = thinned(EMPS, log, declared, weakest)
    for c in library:
        if c.name == LOAD or c.acts == "dry":
            continue
        _, p = system.build(library, {c.name: dict.fromkeys(c.parameters, 10.0)})
        assert p[0] == pytest.approx(50.0)
        assert p[1:] == pytest.approx(10.0 / 50.0 if c.named else 10.0)
    problem, _ = system.build(library, {})
    assert problem.w.shape == (len(system), NODES, 1)
    empty = Likelihood(system, library, np.ones(len(system), dtype=bool))
    q = best_q(empty, {})
    assert np.isfinite(relative_error(course, empty, Fit((), {}, 0.0, 0.0, q, {}, 0), 0.0))


def emps():
    """The public record, or skip."""
    root = Path(__file__).resolve().parents[2]
    for home in (root, root.parent):
        if (path := home / "shared" / "data" / "emps" / "DATA_EMPS.mat").is_file():
            return read_drive(path)
    return pytest.skip("the record of the benchmark EMPS is not here")


def test_the_published_friction_is_found_on_the_measured_axis():
    """Published: 4.08 % with symmetric, 3.11 % with direction-dependent friction, fitted to all of the record."""
    done = diagnose_mechanism(EMPS, emps(), {})
    assert done.verdict == "effect_found"
    assert names(done) == ["dry_friction", "viscous_asymmetry", "viscous_friction"]
    assert done.after.nrmse < 0.032
    without = next(e["before"] for e in done.effects if e["name"] == "viscous_asymmetry")
    assert without > 0.04
    assert done.after.free_run < 0.01
    middle, half = (value(done, name, "coefficient")[0] for name in ("viscous_friction", "viscous_asymmetry"))
    assert middle + half == pytest.approx(167.0, rel=0.02)
    assert middle - half == pytest.approx(240.0, rel=0.02)
