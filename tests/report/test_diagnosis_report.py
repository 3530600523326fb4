"""Reports of diagnoses, and the evidence that is written for them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from report_documents import diagnosis, evidence

from mazeplan.diagnosis.evidence import Evidence
from mazeplan.diagnosis.report import spectrum
from mazeplan.diagnosis.screening import PEAK
from mazeplan.report.diagnosis import diagnosis_section, explained_by
from mazeplan.report.diagnosis_pictures import shown_candidates
from mazeplan.report.inputs import Input
from mazeplan.report.page import Note, Picture, Table


def section(shown=None):
    return diagnosis_section(Input("diagnosis", Path("d"), "d", diagnosis(), shown))


def of(residual, dt=0.04):
    t = dt * np.arange(len(residual))
    return Evidence(residual, np.zeros(len(t)), np.ones(len(t)), t)


def test_a_vibration_is_a_peak_at_its_frequency_and_noise_has_none():
    noise = np.random.default_rng(0).normal(size=4000)
    hz, highest, mean = spectrum(of(noise))
    assert highest.max() < PEAK
    assert np.average(mean) == pytest.approx(1.0, abs=0.02)
    swing = noise + 0.4 * np.sin(2 * np.pi * 3.7 * 0.04 * np.arange(4000))
    hz, highest, _ = spectrum(of(swing))
    assert highest.max() > PEAK
    assert hz[np.argmax(highest)] == pytest.approx(3.7, abs=0.1)


def test_a_spectrum_of_gaps_and_of_nothing():
    noise = np.random.default_rng(0).normal(size=500)
    noise[::7] = np.nan
    assert all(np.isfinite(part).all() for part in spectrum(of(noise)))
    assert all(len(part) == 0 for part in spectrum(of(np.full(50, np.nan))))


def test_what_explains_most_is_where_the_misfit_fell_most():
    assert explained_by(evidence()) == "speed"
    other = evidence()
    other["before"], other["after"] = other["after"], other["before"]
    assert explained_by(other) == ""


def test_a_placebo_is_shown_though_it_is_far_behind():
    shown = evidence()
    shown["candidates"] += [{"name": f"effect {i}", "gain": 90.0 - i, "named": True} for i in range(12)]
    names = [c["name"] for c in shown_candidates(shown)]
    assert names[0] == "dry_friction"
    assert names[-1] == "placebo: noise"


def test_numbers_and_what_would_tell_apart():
    done = section(evidence())
    scores, effects = (part for part in done.parts if isinstance(part, Table))
    assert ["theta error after 40 samples, rad", "0.2929", "0.0061"] in scores.rows
    assert scores.rows[-1] == ["theta error after 40 samples, rad, by noise alone", "", "0.0050"]
    assert effects.rows == [["dry friction", "coefficient", "0.4123 rad/s^2", "0.02", "321.5"]]
    notes = [part for part in done.parts if isinstance(part, Note)]
    assert notes[0].text.startswith("Hard to tell apart in this record: dry friction, viscous friction. Dry friction")
    assert notes[0].code == "mazeplan collect --tilt 1.5 -o apart.mcap"
    assert [p.name for p in done.parts if isinstance(p, Picture)] == ["candidates", "residual", "spectrum"]
    assert done.title == "Diagnosis of log, ring 2"
    assert ("track radius", "68.92 mm") in done.facts


def test_without_evidence_it_is_said_where_to_get_it():
    done = section()
    assert not any(isinstance(part, Picture) for part in done.parts)
    assert any(isinstance(part, Note) and part.code == "mazeplan diagnose LOG -o FOLDER" for part in done.parts)
