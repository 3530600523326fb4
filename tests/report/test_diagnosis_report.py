"""Reports of diagnoses, and the evidence that is written for them."""

from __future__ import annotations

from pathlib import Path

from report_documents import diagnosis, evidence, kept

from mazeplan.apps.report.diagnosis import diagnosis_section
from mazeplan.apps.report.inputs import Input
from mazeplan.apps.report.page import Note, PagePicture, PageTable


def section(shown=None, document=None):
    return diagnosis_section(Input("diagnosis", Path("d"), "d", document or diagnosis(), shown))


def test_a_placebo_is_shown_though_it_is_far_behind():
    shown = evidence()
    shown["candidates"] += [{"name": f"effect {i}", "gain": 90.0 - i, "named": True} for i in range(12)]
    rows = kept(section(shown).parts, PageTable)[-1].rows
    assert rows[0] == ["dry friction", "100", "yes"]
    assert rows[-1][0] == "placebo: noise"


def test_numbers_and_what_cannot_be_told_apart():
    done = section(evidence())
    effects, scores, _ = kept(done.parts, PageTable)
    assert ["error of the angle after 40 samples, degrees", "16.782", "0.350"] in scores.rows
    assert scores.rows[-1] == ["the same by noise alone", "", "0.286"]
    size = "0.412\u00a0±\u00a00.020\u00a0rad/s²"
    assert effects.rows == [["dry friction", "coefficient", "–", size, "yes", "dry_friction.coefficient"]]
    assert done.lead == "The model lacks dry friction (this record cannot tell)."
    notes = kept(done.parts, Note)
    assert notes[0].text == "Hard to tell apart in this record: dry friction, viscous friction."
    assert [p.name for p in kept(done.parts, PagePicture)] == ["residual"]
    assert done.title == "Diagnosis of log, ring 2"
    assert ("track radius", "68.92 mm") in done.facts


def test_without_evidence_it_is_said_where_to_get_it():
    done = section()
    assert not kept(done.parts, PagePicture)
    assert any(part.code == "mazeplan diagnose LOG -o FOLDER" for part in kept(done.parts, Note))


def test_a_number_that_is_not_determined_is_no_number():
    document = diagnosis()
    document["effects"][0]["parameters"]["coefficient"] |= {"stderr": 250.0, "determined": False}
    effects = kept(section(document=document).parts, PageTable)[0]
    assert effects.rows[0][3] == "not determined"
