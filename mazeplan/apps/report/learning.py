"""The sections about a record of `collect` and a model of `learn`: pictures and tables of what their documents have."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mazeplan.apps.report.drawing import legend_beside
from mazeplan.apps.report.inputs import Input, read_as_printed
from mazeplan.apps.report.page import Note, PagePicture, PageSection, PageTable
from mazeplan.core.logs.table import read_table
from mazeplan.core.palette import COLOURS

if TYPE_CHECKING:
    from matplotlib.figure import Figure

BARS = (("error", "with the model", "real"), ("persistence", "without", "neutral"), ("noise", "noise", "unsure"))


def record_section(given: Input) -> PageSection:
    """The section about a record: time in each ring, and passages of openings, if the ball was driven."""
    document = given.document
    with read_as_printed(given):
        tour = document["tour"] or {}
        lead = f"{document['samples']} samples in {document['seconds']:g} s."
        rings = [[str(ring), f"{seconds:.1f} s"] for ring, seconds in tour.get("ring_s", {}).items()]
        passed = [[name, str(count)] for name, count in tour.get("passed", {}).items()]
    tables = [
        PageTable("Time in each ring", ("ring", "time"), rings),
        PageTable("Passages", ("opening", "passages"), passed),
    ]
    facts = [(name, str(document[name])) for name in ("rig", "map", "seed", "log")]
    log = Path(str(document["log"]))
    places = [PagePicture("places", "Where the ball was", "Each dot is one sample.", partial(_places, log), (4.6, 4.4))]
    parts = [*(places if log.exists() else []), *(table for table in tables if table.rows)]
    return PageSection(f"Record of {document['rig']}", lead, facts, parts)


def _places(log: Path, figure: Figure) -> None:
    """Measured positions of the ball in a log."""
    table = read_table(log)
    axes = figure.subplots()
    axes.plot(1e3 * table["x"], 1e3 * table["y"], ".", markersize=1.5, color=COLOURS["real"])
    axes.set(xlabel="x, mm", ylabel="y, mm", aspect="equal")


def model_section(given: Input) -> PageSection:
    """The section about a learned model: the verdict on its logs, ring by ring, and how well its parts fit."""
    document = given.document
    with read_as_printed(given):
        fits = [[part, f"{times:.2f}"] for part, times in document["fits"].items()]
        scored = score_section(str(document["model"]), document["score"])
        facts = [("model", str(document["model"])), ("kind", str(document["kind"]))]
    tables = [PageTable("Errors of the fit, in times the noise", ("part", "times"), fits)] if fits else []
    return PageSection("Learned model", scored.lead, facts, [*tables, *scored.parts])


def score_section(model: str, score: dict[str, Any]) -> PageSection:
    """The section about how well a model predicts logs: `score --json`, which `learn --json` has, too."""
    rows = [
        [ring, str(r["windows"]), f"{r['error']:.3f}", f"{r['persistence']:.3f}", f"{r['noise']:.3f}", r["verdict"]]
        for ring, r in score["rings"].items()
    ]
    head = ("ring", "windows", "model", "without a model", "noise", "verdict")
    table = PageTable("Mean absolute error of the angle after 40 samples, rad", head, rows)
    lead = f"{score['verdict'].capitalize()}: {score['because']}."
    words = "In each ring: with the model, without a model, and the noise."
    shown = PagePicture("errors", "Error of the angle after 40 samples", words, partial(_errors, score["rings"]))
    return PageSection(
        f"Prediction errors of {model}", lead, (), [*([shown, table] if rows else []), *map(Note, score["advice"])]
    )


def _errors(rings: Mapping[str, Mapping[str, float]], figure: Figure) -> None:
    """Bars of the errors of each ring, rad."""
    axes = figure.subplots()
    for i, (key, name, colour) in enumerate(BARS):
        axes.bar([j + 0.27 * (i - 1) for j in range(len(rings))], [r[key] for r in rings.values()], 0.25,
                 label=name, color=COLOURS[colour])  # fmt: skip
    axes.set_xticks(range(len(rings)), [f"ring {ring}" for ring in rings])
    axes.set_ylabel("mean error, rad")
    legend_beside(axes)
