"""The sections about models: comparisons of kinds (the tables of the paper), learned models, and records for them."""

from __future__ import annotations

import math
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from mazeplan.apps.report import words
from mazeplan.apps.report.inputs import Input, number, read_as_printed
from mazeplan.apps.report.page import Note, PagePicture, PageSection, PageTable
from mazeplan.apps.report.words import DEG, KINDS, MISSING
from mazeplan.core.logs.table import read_table
from mazeplan.core.palette import COLOURS
from mazeplan.learning.split import TOO_FEW, enough

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SLASH = f"{words.HARD}/{words.HARD}"
Comparison = dict[int, dict[str, Any]]  # {ring: its scores}


def models_section(given: Input) -> PageSection:
    """The section of a page about a comparison. Raises InputError."""
    with read_as_printed(given):
        document = {int(key.removeprefix("ring")): given.document[key] for key in given.document}
        document = dict(sorted(document.items()))
        parts: list[Any] = [_accelerations(document), _rollouts(document), *_of_the_data(document)]
        first, facts = next(iter(document.values())), [("rings", ", ".join(map(str, document)))]
        if first.get("rates") is not None:
            facts.append(("rates", str(first["rates"])))
        if first.get("delay_s") is not None:
            facts.append(("ball behind the tilt", f"{first['delay_s']:g} s"))
        lead = _lead(document)
    return PageSection(f"Models, {given.name}", lead, facts, parts)


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
    table, axes = read_table(log), figure.subplots()
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
    parts = [*([table] if rows else []), *map(Note, score["advice"])]
    return PageSection(f"Prediction errors of {model}", lead, (), parts)


def _kinds(document: Comparison, part: str) -> list[str]:
    """Kinds of models that have scores in some ring, in the paper's order. part: the key of the scores"""
    found = {kind for scores in document.values() for kind in scores.get(part) or {}}
    return [kind for kind in KINDS if kind in found] + sorted(found - set(KINDS))


def _lead(document: Comparison) -> str:
    """Which kind has the smallest test nRMSE, as a mean over all rings."""
    tests = {k: [number(s["nrmse_test"].get(k)) for s in document.values()] for k in _kinds(document, "nrmse_test")}
    finite = {kind: float(np.mean(scores)) for kind, scores in tests.items() if np.isfinite(scores).all()}
    if not finite:
        return "No kind of model could be scored."
    best = min(finite, key=lambda kind: finite[kind])
    scores = [f"{score:.3f} in ring {ring}" for ring, score in zip(document, tests[best], strict=True)]
    return (
        f"Predicts the acceleration best{'' if len(document) == 1 else ' on average'}: {KINDS.get(best, best)}. "
        f"Relative error on test rows (nRMSE): {', '.join(scores)}."
    )


def _scores_table(title: str, columns: list[str], rows: dict[str, list[tuple[float, str]]]) -> PageTable:
    """A table with a row for each ring and a column for each kind. The smallest value of each row is bold.

    rows: {label: value and text of each cell}"""
    strong, head = set(), ("", *(words.kind(kind) for kind in columns))
    for i, cells in enumerate(rows.values()):
        values = [value for value, _ in cells]
        if np.isfinite(values).any():
            strong.add((i, 1 + int(np.nanargmin(values))))
    texts = [[label, *(text for _, text in cells)] for label, cells in rows.items()]
    return PageTable(f"{title}; bold: least", head, texts, frozenset(strong))


def _accelerations(document: Comparison) -> PageTable:
    """The table of errors of the acceleration, as the first table of the paper."""
    columns, rows = _kinds(document, "nrmse_test"), {}
    for ring, scores in document.items():
        cells = []
        for kind in columns:
            train, test = (number(scores[part].get(kind)) for part in ("nrmse_train", "nrmse_test"))
            interval, band = (scores.get("interval95") or {}).get("nrmse_test", {}).get(kind), ""
            if interval is not None and not enough(blocks=(scores.get("blocks") or {}).get("test")):
                band = f"\n{TOO_FEW}"
            elif interval is not None and None not in interval:
                band = f"\n[{interval[0]:.2f},{words.HARD}{interval[1]:.2f}]"
            cells.append((test, f"{words.number(train, 3)}{SLASH}{words.number(test, 3)}{band}"))
        rows[f"ring {ring}: {scores['n_train']} rows, {scores['n_test']} to test"] = cells
    title = "Relative error of the angular acceleration (nRMSE), train / test, [95 % interval]"
    return _scores_table(title, columns, rows)


def _rollouts(document: Comparison) -> PageTable:
    """The table of errors of roll-outs, as the second table of the paper."""
    columns, rows = _kinds(document, "rollout"), {}
    for ring, scores in document.items():
        if not scores["rollout"]:
            continue
        blocks = (scores.get("blocks") or {}).get("windows") or 0
        sure, cells = enough(scores.get("windows") or 0, blocks), []
        for kind in columns:
            errors = scores["rollout"].get(kind) or {}
            text = SLASH.join(_error(scores, kind, n, sure) for n in ("20", "40")) if errors else MISSING
            cells.append((number(errors.get("40")), text))
        few = "" if sure else f" ({TOO_FEW} for ±)"
        rows[f"ring {ring}: {scores.get('windows')} windows{few}, {scores.get('windows_chosen')}"] = cells
    title = "Mean absolute error of the angle after 20 / 40 samples, degrees ± half of the 95 % interval"
    return _scores_table(title, columns, rows)


def _error(scores: dict[str, Any], kind: str, steps: str, sure: bool) -> str:
    """A roll-out error in degrees, with half of its 95 % interval, if there is one."""
    low, high = map(number, (scores.get("interval95") or {}).get(steps, {}).get(kind) or (None, None))
    half = f" ± {0.5 * DEG * (high - low):.2f}" if math.isfinite(high - low) and sure else ""
    return f"{words.number(DEG * number(scores['rollout'][kind][steps]), 2)}{half}"


def _of_the_data(document: Comparison) -> list[Note]:
    """What the data have of their own: signs of the tilts, and the point about which the camera counts the angle."""
    notes = [
        Note(f"These data count {axis} the other way round (gravity would pull uphill); its sign was changed.")
        for axis in ("beta", "gamma")
        if any((scores.get("signs") or {}).get(axis, 1) < 0 for scores in document.values())
    ]
    centres = {ring: scores.get("centre_m") or (0.0, 0.0) for ring, scores in document.items()}
    off = [f"ring {ring} {1e3 * x:.1f}, {1e3 * y:.1f}" for ring, (x, y) in centres.items() if x or y]
    if off:
        about = "The camera counts the angle about another point than the rings' centre, in mm"
        notes.append(Note(f"{about}: {'; '.join(off)}."))
    return notes
