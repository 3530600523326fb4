"""The sections about a record of `collect` and a model of `learn`: tables of what their documents have."""

from __future__ import annotations

from mazeplan.apps.report.inputs import Input, read_as_printed
from mazeplan.apps.report.page import Note, PageSection, PageTable


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
    return PageSection(f"Record of {document['rig']}", lead, facts, [table for table in tables if table.rows])


def model_section(given: Input) -> PageSection:
    """The section about a learned model: the verdict on its logs, ring by ring, and how well its parts fit."""
    document = given.document
    with read_as_printed(given):
        score = document["score"]
        rows = [
            [ring, str(r["windows"]), f"{r['error']:.3f}", f"{r['persistence']:.3f}", f"{r['noise']:.3f}", r["verdict"]]
            for ring, r in score["rings"].items()
        ]
        fits = [[part, f"{times:.2f}"] for part, times in document["fits"].items()]
        notes = [Note(text) for text in document["advice"]]
        lead = f"{document['verdict'].capitalize()}: {score['because']}."
    head = ("ring", "windows", "model", "without a model", "noise", "verdict")
    tables = [
        PageTable("Mean absolute error of the angle after 40 samples, rad", head, rows),
        PageTable("Errors of the fit, in times the noise", ("part", "times"), fits),
    ]
    facts = [("model", str(document["model"])), ("kind", str(document["kind"]))]
    return PageSection("Learned model", lead, facts, [*(table for table in tables if table.rows), *notes])
