"""Reports of diagnoses, and the evidence that is written for them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from report_documents import diagnosis, evidence, kept

from mazeplan.apps.report.diagnosis import diagnosis_section
from mazeplan.apps.report.inputs import Input
from mazeplan.apps.report.page import Note, PagePicture, PageTable
from mazeplan.diagnosis.coordinate.evidence import Evidence, spectrum
from mazeplan.diagnosis.coordinate.screening import PEAK


def section(shown=None, document=None):
    return diagnosis_section(Input("diagnosis", Path("d"), "d", document or diagnosis(), shown))


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


def test_a_placebo_is_shown_though_it_is_far_behind():
    shown = evidence()
    shown["candidates"] += [{"name": f"effect {i}", "gain": 90.0 - i, "named": True} for i in range(12)]
    rows = kept(section(shown).parts, PageTable)[-1].rows
    assert rows[0] == ["dry friction", "100", "yes"]
    assert rows[-1][0] == "placebo: noise"


def test_numbers_and_what_would_tell_apart():
    done = section(evidence())
    effects, scores, _ = kept(done.parts, PageTable)
    assert ["error of the angle after 40 samples, degrees", "16.782", "0.350"] in scores.rows
    assert scores.rows[-1] == ["the same by noise alone", "", "0.286"]
    size = "0.412\u00a0±\u00a00.020\u00a0rad/s²"
    assert effects.rows == [["dry friction", "coefficient", "–", size, "yes", "dry_friction.coefficient"]]
    assert done.lead == "The model lacks dry friction (this record cannot tell)."
    notes = kept(done.parts, Note)
    assert notes[0].text.startswith("Hard to tell apart in this record: dry friction, viscous friction. Dry friction")
    assert notes[0].code == "mazeplan collect --tilt 1.5 -o apart.mcap"
    assert [p.name for p in kept(done.parts, PagePicture)] == ["residual"]
    assert done.title == "Diagnosis of log, ring 2"
    assert ("track radius", "68.92 mm") in done.facts


def test_without_evidence_it_is_said_where_to_get_it():
    done = section()
    assert not kept(done.parts, PagePicture)
    assert any(part.code == "mazeplan diagnose LOG -o FOLDER" for part in kept(done.parts, Note))
