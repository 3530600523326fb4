"""The report's part on how sure roll-outs are: the numbers of the document, in degrees."""

from __future__ import annotations

import math
from pathlib import Path

import pytest
from report_documents import comparison, drawn, kept

from mazeplan.apps.report.inputs import Input
from mazeplan.apps.report.models import models_section
from mazeplan.apps.report.page import PagePicture, PageTable

DEG = math.pi / 180.0


def document():
    """The usual document, with bands of 3 deg on either side and a ball that leaves them in the end."""
    told = comparison()
    for ring in told.values():
        band = {name: [value * DEG * (0.5 + 0.5 * k / 40) for k in range(41)] for name, value in (
            ("low", -3.0), ("middle", 0.0), ("high", 3.0), ("measured", 4.0))}  # fmt: skip
        entry = {
            "rollouts": 500, "windows": 10, "level": 0.9, "below": band["low"], "above": band["high"],
            "coverage": [1.0] * 20 + [0.8] + [0.7] * 20, "coverage20": 0.8, "coverage40": 0.7, "coverage_all": 0.84,
            "window": band,
        }  # fmt: skip
        ring |= {"confidence": {"sp": entry}, "windows": 10, "blocks": {"test": 5, "windows": 5}}
        ring["rollout"]["sp"]["40"] = 2.5 * DEG
        ring["interval95"]["40"] = {"sp": [2.0 * DEG, 3.2 * DEG]}
    return told


def parts(shown):
    return models_section(Input("comparison", Path("c.json"), "c", shown)).parts


def table(shown):
    return next(part for part in kept(shown, PageTable) if "half the band of 90 %" in part.caption)


def test_the_table_has_the_numbers_of_the_document():
    shown = table(parts(document()))
    assert shown.rows[1] == ["ring 2: 500 roll-outs of 10 windows", "2.5 ± 0.6\n± 3.0; 80 / 70 %"]
    assert "after 20 / 40 samples" in shown.caption
    assert "confidence" not in [part.name for part in kept(parts(comparison()), PagePicture)]


@pytest.mark.parametrize(
    ("all_windows", "blocks", "windows", "cell"),
    [
        (10, 1, 10, "2.5 (too few)\n± 3.0; 80 / 70 %"),
        (9, 5, 9, "2.5 (too few)\n± 3.0; too few"),
        (10, 4, 10, "2.5 (too few)\n± 3.0; 80 / 70 %"),
        (100, None, 9, "2.5 ± 0.6\n± 3.0; too few"),
    ],
)
def test_too_few_windows_or_blocks_are_said(all_windows, blocks, windows, cell):
    told = document()
    ring = told["ring2"]
    ring |= {"windows": all_windows, "blocks": {} if blocks is None else {"test": 5, "windows": blocks}}
    ring["confidence"]["sp"]["windows"] = windows
    if blocks == 1:  # which has no interval
        ring["interval95"]["40"] = {"sp": [None, None]}
    shown = parts(told)
    assert table(shown).rows[1] == [f"ring 2: 500 roll-outs of {windows} windows", cell]
    shares = drawn(shown, "confidence").axes[3]
    said = [text.get_text() for text in shares.texts]
    assert said == ([f"too few windows ({windows})"] if windows < 10 else [])
    assert len(shares.lines) == (1 if windows < 10 else 3)  # that of 90 %, and of the kind with its marks
    assert shares.get_legend() is not None  # the other ring has some


def test_the_picture_shows_band_measured_angle_and_coverage():
    figure = drawn(parts(document()), "confidence")
    above, below = figure.axes[0], figure.axes[2]
    measured = next(line for line in above.lines if line.get_label() == "measured")
    assert measured.get_ydata()[-1] == pytest.approx(4.0)
    assert above.collections[0].get_datalim(above.transData).y1 == pytest.approx(3.0)
    assert below.lines[0].get_ydata().tolist() == [100.0] * 20 + [80.0] + [70.0] * 20
