"""The tilt sensor from clinometer readings: how true, slips found by their line, files that cannot be used."""

from __future__ import annotations

import math

import numpy as np
import pytest
from emulator.truth import Diode

from mazeplan.rigs.hardware.tiltcalibration import Reading, fit_tilt, read_readings, write_readings

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
    assert fit.sensor.error_deg < 0.1
    plain = fit_tilt([r for i, r in enumerate(readings) if i not in slips])
    assert fit.sensor.beta_deg == pytest.approx(plain.sensor.beta_deg, abs=0.02)  # they took no part


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


def test_servos_come_along_where_the_pulses_are_known():
    fit = fit_tilt(read_off(1)[1])
    found = {axis: (servo["level_us"], servo["us_per_deg"]) for axis, servo in fit.servos.items()}
    assert found["beta"] == pytest.approx((1510.0, 40.0), rel=1e-3, abs=0.2)
    assert found["gamma"] == pytest.approx((1490.0, -38.0), rel=1e-3, abs=0.2)
    without = fit_tilt([Reading(r.v, r.beta_deg, r.gamma_deg, r.line) for r in read_off(1)[1]])
    assert without.servos == {}


def test_beyond_what_was_calibrated_it_stays_where_it_was():
    sensor = fit_tilt(read_off(2)[1]).sensor
    assert sensor.reaches(*sensor.centre_v)
    assert not sensor.reaches(0.0, 2.5)
    assert max(map(abs, np.degrees(sensor.tilt(0.0, 5.0)))) < 12.0


def test_a_table_there_and_back(tmp_path):
    readings = read_off(1)[1]
    write_readings(tmp_path / "r.csv", readings)
    again = read_readings(tmp_path / "r.csv")
    assert [r.line for r in again] == list(range(2, 51))
    assert again[7].v == pytest.approx(readings[7].v, abs=1e-5)
    assert again[7].pulses == pytest.approx(readings[7].pulses)
