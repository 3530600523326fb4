"""The tilt sensor from clinometer readings: how true, slips found by their line, files that cannot be used."""

from __future__ import annotations

import math

import numpy as np
import pytest
from emulator.truth import Diode

from mazeplan.core.errors import InputError, TableError
from mazeplan.rigs.files import validated
from mazeplan.rigs.hardware.tiltcalibration import Reading, fit_tilt, read_readings, write_readings
from mazeplan.rigs.hardware.tiltsensor import TiltSection

ALL = np.linspace(-5.75, 5.75, 7)


def read_off(seed, slips=()):
    """49 readings of a drawn diode, to a tenth of a degree; `slips`: numbers of those with a forgotten minus sign."""
    rng = np.random.default_rng(seed)
    diode, readings = Diode.drawn(rng), []
    for i, (beta, gamma) in enumerate((b, g) for b in ALL for g in ALL):
        v = tuple(np.array(diode.volts(math.radians(beta), math.radians(gamma))) + rng.normal(0.0, 0.002, 2))
        said = np.round(np.array([beta, gamma]) + rng.normal(0.0, 0.04, 2), 1)
        said[0] *= -1.0 if i in slips else 1.0
        readings.append(Reading(v, *said, line=i + 2, pulses=(1510.0 + 40.0 * beta, 1490.0 - 38.0 * gamma)))
    return diode, readings


def errors(diode, fit):
    """deg, over the whole range: (N, 2)."""
    angles = np.radians(np.linspace(-5.0, 5.0, 11))
    tilts = [(beta, gamma) for beta in angles for gamma in angles]
    return np.degrees([np.array(fit.sensor.tilt(*diode.volts(*tilt))) - tilt for tilt in tilts])


@pytest.mark.parametrize("seed", range(4))
def test_two_wrong_readings_do_no_harm(seed):
    slips = (3, 40)
    diode, readings = read_off(seed, slips)
    fit = fit_tilt(readings)
    assert np.abs(errors(diode, fit)).max() < 0.1
    assert {(o.line, o.axis) for o in fit.outliers} == {(i + 2, "beta") for i in slips}
    assert fit.error_deg < 0.1
    plain = fit_tilt([r for i, r in enumerate(readings) if i not in slips])
    assert fit.sensor.beta == pytest.approx(plain.sensor.beta, abs=0.02)  # they took no part


def test_small_and_grouped_outliers_are_found():
    diode, readings = read_off(5)
    r = readings[24]
    readings[24] = Reading(r.v, r.beta_deg + 0.5, r.gamma_deg, r.line)
    assert [(o.line, o.axis) for o in fit_tilt(readings).outliers] == [(26, "beta")]
    corner = [i for i, r in enumerate(readings) if r.beta_deg > 3.0 and r.gamma_deg > 1.5]
    for i in corner:  # a whole corner read with the plate's other half in mind
        r = readings[i]
        readings[i] = Reading(r.v, -r.beta_deg, r.gamma_deg, r.line)
    fit = fit_tilt(readings)
    assert {o.line for o in fit.outliers if o.axis == "beta"} == {readings[i].line for i in corner} | {26}
    assert np.abs(errors(diode, fit)[:, 1]).max() < 0.1


def test_no_more_terms_than_the_readings_ask_for():
    eye = np.random.default_rng(3).normal(0.0, 0.04, (49, 2))  # or rounding would depend on the place alone
    straight = [
        Reading((2.5 + 0.2 * b, 2.4 - 0.18 * g), round(float(b + eye[i, 0]), 1), round(float(g + eye[i, 1]), 1), i)
        for i, (b, g) in enumerate((b, g) for b in ALL for g in ALL)
    ]
    assert list(fit_tilt(straight).sensor.beta) == ["one", "a", "b"]
    bent = [Reading((r.v[0], r.v[1] + 0.03 * r.v[0] ** 2), r.beta_deg, r.gamma_deg, r.line) for r in straight]
    assert "aa" in fit_tilt(bent).sensor.gamma


def test_servos_come_along_where_the_pulses_are_known():
    fit = fit_tilt(read_off(1)[1])
    assert fit.level_us == pytest.approx((1510.0, 1490.0), abs=0.5)
    assert fit.us_per_deg == pytest.approx((40.0, -38.0), abs=0.2)
    without = fit_tilt([Reading(r.v, r.beta_deg, r.gamma_deg, r.line) for r in read_off(1)[1]])
    assert without.level_us is None


def test_what_is_written_into_the_file_is_the_sensor():
    fit = fit_tilt(read_off(2)[1])
    section = validated(TiltSection, fit.section("2026-11-22"))
    assert section.sensor().tilt(2.3, 2.7) == pytest.approx(fit.sensor.tilt(2.3, 2.7), abs=1e-5)
    assert section.date == "2026-11-22"
    assert section.error_deg == pytest.approx(fit.error_deg, abs=1e-3)


def test_beyond_what_was_calibrated_it_stays_where_it_was():
    sensor = fit_tilt(read_off(2)[1]).sensor
    assert sensor.reaches(*sensor.centre)
    assert not sensor.reaches(0.0, 2.5)
    assert max(map(abs, np.degrees(sensor.tilt(0.0, 5.0)))) < 12.0


def test_readings_that_tell_too_little():
    readings = read_off(1)[1]
    with pytest.raises(InputError, match="got 5 readings"):
        fit_tilt(readings[:5])
    with pytest.raises(InputError, match="one line: tilt the plate about both axes"):
        fit_tilt([Reading((r.v[0], 1.0 + 0.5 * r.v[0]), r.beta_deg, r.gamma_deg, r.line) for r in readings])


@pytest.mark.parametrize(
    ("spoil", "key", "said"),
    [
        (lambda v: (v[0], 5.0), "v1", "got 5.000 to 5.000 V, it is at its upper end all the time: is the laser's spot"),
        (lambda v: (0.0, v[1]), "v0", "got 0.000 to 0.000 V, it is at its lower end all the time"),
        (lambda v: (2.31, v[1]), "v0", "got 2.310 to 2.310 V"),
        (lambda v: (v[0], min(5.0, v[1] + 2.6)), "v1", " % of the readings are at an end of its range"),
    ],
)
def test_a_channel_that_tells_nothing_is_named(spoil, key, said):
    readings = [Reading(spoil(r.v), r.beta_deg, r.gamma_deg, r.line) for r in read_off(1)[1]]
    with pytest.raises(InputError) as caught:
        fit_tilt(readings)
    assert caught.value.key == key
    assert said in caught.value.problem


def test_a_table_there_and_back(tmp_path):
    readings = read_off(1)[1]
    write_readings(tmp_path / "r.csv", readings)
    again = read_readings(tmp_path / "r.csv")
    assert [r.line for r in again] == list(range(2, 51))
    assert again[7].v == pytest.approx(readings[7].v, abs=1e-5)
    assert again[7].pulses == pytest.approx(readings[7].pulses)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (
            "v0,v1,beta_deg\n1,2,3\n",
            "r.csv:1: got the header 'v0,v1,beta_deg'",
        ),
        (
            "v0,v1,beta_deg,gamma_deg,pulse_beta_us,pulse_gamma_us\n1,2,3,4,1500,1.5\n",
            "r.csv:2: pulse_gamma_us: got 1.5",
        ),
        ("v0,v1,beta_deg,gamma_deg\n1,2,3,4\n\n1,2,3,4,5\n", "r.csv:4: got 5 columns, the header has 4"),
        ("v0,v1,beta_deg,gamma_deg\n1,2,3,4\n1,2,x,4\n", "r.csv:3: beta_deg: got 'x'"),
        ("", "r.csv:1: got an empty file"),
    ],
)
def test_tables_that_cannot_be_used(tmp_path, text, said):
    (tmp_path / "r.csv").write_text(text)
    with pytest.raises(TableError) as caught:
        read_readings(tmp_path / "r.csv")
    assert said in str(caught.value)
