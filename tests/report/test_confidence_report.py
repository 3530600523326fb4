"""The report's part on how sure roll-outs are: the numbers of the document, in degrees."""

from __future__ import annotations

import math
from pathlib import Path

import pytest
from report_documents import comparison

from mazeplan.report.confidence import confidence_parts
from mazeplan.report.inputs import Input
from mazeplan.report.models import models_section
from mazeplan.report.page import Picture, Table

DEG = math.pi / 180.0


def told(rings=(1, 2)):
    """The usual document, with bands of 3 deg on either side and a ball that leaves them in the end."""
    document = comparison()
    for ring in rings:
        band = {name: [value * DEG * (0.5 + 0.5 * k / 40) for k in range(41)] for name, value in (
            ("low", -3.0), ("middle", 0.0), ("high", 3.0), ("measured", 4.0))}  # fmt: skip
        document[f"ring{ring}"]["confidence"] = {
            "sp": {
                "rollouts": 500, "windows": 10, "level": 0.9, "below": band["low"], "above": band["high"],
                "coverage": [1.0] * 20 + [0.8] + [0.7] * 20, "coverage20": 0.8, "coverage40": 0.7, "coverage_all": 0.84,
                "window": band,
            }
        }  # fmt: skip
        document[f"ring{ring}"] |= {"windows": 10, "blocks": {"test": 5, "windows": 5}}
        document[f"ring{ring}"]["rollout"]["sp"]["40"] = 2.5 * DEG
        document[f"ring{ring}"].setdefault("interval95", {})["40"] = {"sp": [2.0 * DEG, 3.2 * DEG]}
    return document


def test_the_table_has_the_numbers_of_the_document():
    table = confidence_parts(told())[0]
    assert isinstance(table, Table)
    assert table.rows[1] == ["ring 2: 500 roll-outs of 10 windows", "2.5 ± 0.6\n± 3.0; 80 / 70 %"]
    assert "after 20 / 40 samples" in table.caption


@pytest.mark.parametrize(
    ("all_windows", "blocks", "windows", "cell"),
    [
        (10, 1, 10, "2.5 (too few)\n± 3.0; 80 / 70 %"),
        (9, 5, 9, "2.5 (too few)\n± 3.0; too few"),
        (10, 4, 10, "2.5 (too few)\n± 3.0; 80 / 70 %"),
        (100, None, 9, "2.5 ± 0.6\n± 3.0; too few"),
    ],
)
def test_too_few_windows_or_blocks_say_so(all_windows, blocks, windows, cell):
    document = told()
    ring = document["ring2"]
    ring |= {"windows": all_windows, "blocks": {} if blocks is None else {"test": 5, "windows": blocks}}
    ring["confidence"]["sp"]["windows"] = windows
    if blocks == 1:  # which has no interval
        ring["interval95"]["40"] = {"sp": [None, None]}
    table, picture = confidence_parts(document)
    assert table.rows[1] == [f"ring 2: 500 roll-outs of {windows} windows", cell]
    from matplotlib.figure import Figure

    figure = Figure()
    picture.draw(figure)
    shares = figure.axes[3]
    said = [text.get_text() for text in shares.texts]
    assert said == ([f"too few windows ({windows})"] if windows < 10 else [])
    assert len(shares.lines) == (1 if windows < 10 else 3)  # that of 90 %, and of the kind with its marks
    assert shares.get_legend() is not None  # the other ring has some


def test_the_picture_shows_band_measured_angle_and_coverage():
    from matplotlib.figure import Figure

    picture = confidence_parts(told())[1]
    assert isinstance(picture, Picture)
    figure = Figure()
    picture.draw(figure)
    above, below = figure.axes[0], figure.axes[2]
    measured = next(drawn for drawn in above.lines if drawn.get_label() == "measured")
    assert measured.get_ydata()[-1] == pytest.approx(4.0)
    assert above.collections[0].get_datalim(above.transData).y1 == pytest.approx(3.0)
    assert below.lines[0].get_ydata().tolist() == [100.0] * 20 + [80.0] + [70.0] * 20


def test_it_is_in_the_section_where_the_document_tells():
    def pictures(document):
        parts = models_section(Input("comparison", Path("c.json"), "c", document)).parts
        return [part.name for part in parts if isinstance(part, Picture)]

    assert "confidence" in pictures(told((2,)))
    assert "confidence" not in pictures(comparison())
    assert confidence_parts(comparison()) == []
