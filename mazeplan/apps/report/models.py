"""The report of models: a comparison of kinds of models (`compare --json`), or one model folder judged on logs."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from mazeplan.apps.report import published, words
from mazeplan.apps.report.documents import ComparedRing, Comparison, ResidualDocument, best_kind, kinds
from mazeplan.apps.report.drawing import (
    KIND_STYLES,
    darker,
    legend_beside,
    line,
    plan_view,
    points,
    sector_map,
)  # fmt: skip
from mazeplan.apps.report.inputs import Input
from mazeplan.apps.report.page import Note, PagePicture, PageSection, PageTable
from mazeplan.apps.report.run_record import maze_of
from mazeplan.apps.report.words import DEG, KINDS, MISSING
from mazeplan.core.logs.run_log import read_log
from mazeplan.core.palette import COLOURS
from mazeplan.core.records import Array
from mazeplan.learning.split import BLOCKS, TOO_FEW, WINDOWS, enough
from mazeplan.maze.geometry import Maze
from mazeplan.maze.mapfile import load_map

if TYPE_CHECKING:
    from matplotlib.figure import Figure

INTERVALS = (
    "Intervals are percentiles over test rows drawn in whole blocks again and again. The error is divided by the "
    "spread of the rows drawn, which is less where a block is drawn twice: with few blocks an interval may begin at "
    f"its number, or lie above it. Fewer than {BLOCKS} blocks, or {WINDOWS} windows of roll-outs, are too few to say "
    "how sure a number is."
)
SLASH = f"{words.HARD}/{words.HARD}"
DRAWS = "mazeplan compare LOG... --report FILE.html"  # draws all pictures, as it knows the map
MAPS_SHOWN = 3  # number of kinds of models whose maps are side by side


def models_section(given: Input) -> PageSection:
    """The section of a page about a comparison. Rings that the maze lacks leave out the picture over the maze."""
    document, maze = given.document, given.maze or load_map("cme")
    known = max(document) <= len(maze.rings)
    parts: list[Any] = [_accelerations(document), _rollouts(document)]
    if any(scores.interval95 for scores in document.values()):
        parts.insert(1, Note(INTERVALS))
    parts += models_pictures(document, maze if known else None)
    if not known:
        parts.append(Note("The picture over the maze needs the map. This command draws it:", DRAWS))
    first, facts = next(iter(document.values())), [("rings", ", ".join(map(str, document)))]
    if first.rates is not None:
        facts.append(("rates", first.rates))
    if math.isfinite(first.delay_s):
        facts.append(("ball behind the tilt", f"{first.delay_s:g} s"))
    return PageSection(f"Models, {given.name}", _lead(document), facts, parts)


def model_section(folder: Path, logs: Sequence[Path]) -> PageSection:
    """The section of a page about a model folder, with its scores on logs, if logs are given. Raises InputError."""
    from mazeplan.apps.report.learned import effects_table, judged, learned_from, model_facts
    from mazeplan.core.logs.table import read_table
    from mazeplan.learning.modelfile import load_model

    model, facts = load_model(folder), model_facts(load_model(folder), folder)
    if not logs:
        note = Note("Give logs with the model to see how well it predicts them:",
                    "mazeplan report MODEL LOG... -o FILE.html")  # fmt: skip
        lead = f"Kind of model: {words.kind(model.kind)}."
        return PageSection(f"Model {folder.name}", lead, facts, [effects_table(model), note])
    run = next((log for log in logs if log.suffix.lower() == ".mcap"), None)
    maze, names = load_map("cme") if run is None else maze_of(read_log(run)), ", ".join(log.name for log in logs)
    document = judged(model, [read_table(log) for log in logs], maze)
    parts = [_accelerations(document), _rollouts(document), effects_table(model)]
    scores = [f"{s.nrmse_test['model']:.3f} in ring {ring}" for ring, s in document.items()]
    lead = f"Relative error of the angular acceleration (nRMSE): {', '.join(scores)}"
    if seen := learned_from(model, logs):
        lead += f". Beware: the model was learned from {', '.join(seen)} itself, so that it looks better than it is"
    parts += models_pictures(document, maze, "model")
    return PageSection(f"Model {folder.name} on {names}", f"{lead}.", [*facts, ("judged on", names)], parts)


def _lead(document: Comparison) -> str:
    best = best_kind(document)
    if not best:
        return "No kind of model could be scored."
    scores = [f"{s.nrmse_test[best]:.3f} in ring {ring}" for ring, s in document.items()]
    others = []
    for ring, s in document.items():
        finite = {kind: value for kind, value in s.nrmse_test.items() if math.isfinite(value)}
        first = min(finite, key=lambda kind: finite[kind])
        if finite[first] < finite[best]:
            others.append(f"in ring {ring} {KINDS.get(first, first)}, {finite[first]:.3f}")
    return (
        f"Predicts the acceleration best{'' if len(document) == 1 else ' on average'}: {KINDS.get(best, best)}. "
        f"Relative error on test rows (nRMSE): {', '.join(scores)}."
        + (f" Better there: {'; '.join(others)}." if others else "")
    )


# -- tables ------------------------------------------------------------------------------------------------------------


def _scores_table(
    title: str, head: Sequence[str], columns: list[str], labels: dict[int, str],
    value: Callable[[int, str], float], text: Callable[[int, str], str], paper: list[list[str]], bold: str,
) -> PageTable:  # fmt: skip
    """A table with a row for each ring and a column for each kind. The smallest value of each row is bold.

    head: headings of the columns.
    columns: kinds.
    labels: {ring: label of its row}.
    value, text: the value of a ring and kind, and its text.
    paper: rows of published scores, which come last.
    bold: what the bold values are the smallest of, for the title."""
    rows, strong = [], set()
    for i, (ring, label) in enumerate(labels.items()):
        values = [value(ring, kind) for kind in columns]
        rows.append([label, *(text(ring, kind) for kind in columns)])
        if np.isfinite(values).any():
            strong.add((i, 1 + int(np.nanargmin(values))))
    title += "; published: test, on the paper's rig" if paper else ""
    title += f"; bold: least {bold}" if strong else ""
    return PageTable(title, ("", *head), [*rows, *paper], frozenset(strong))


def _paper(columns: list[str], rings: Comparison, table: dict[str, Any], text: Callable[[Any], str]) -> list[list[str]]:
    """Rows with the published scores, which come from other data."""
    rows = []
    for ring in rings:
        known = {kind: table[kind][ring - 1] for kind in columns if ring <= len(table.get(kind, ()))}
        if known:
            cells = [text(known[kind]) if kind in known else MISSING for kind in columns]
            rows.append([f"published, ring {ring}", *cells])
    return rows


def _accelerations(document: Comparison) -> PageTable:
    """The table of errors of the acceleration, as the first table of the paper."""
    columns = kinds(document, "nrmse_test")

    def test(ring: int, kind: str) -> float:
        return document[ring].nrmse_test.get(kind, math.nan)

    def text(ring: int, kind: str) -> str:
        scores = document[ring]
        train, interval = scores.nrmse_train.get(kind, math.nan), scores.interval("nrmse_test", kind)
        before = f"{words.number(train, 3)}{SLASH}" if math.isfinite(train) else ""
        band = ""
        if interval is not None and not enough(blocks=scores.blocks.get("test")):
            band = f"\n{TOO_FEW}"
        elif interval is not None and np.isfinite(interval).all():
            band = f"\n[{interval[0]:.2f},{words.HARD}{interval[1]:.2f}]"
        return f"{before}{words.number(test(ring, kind), 3)}{band}"

    title = "Relative error of the angular acceleration (nRMSE)"
    if any(scores.nrmse_train for scores in document.values()):
        title += ", train / test" + (", [95 % interval]" if any(s.interval95 for s in document.values()) else "")
    return _scores_table(
        title, [words.kind(kind) for kind in columns], columns,
        {ring: f"ring {ring}: {_rows(scores)}" for ring, scores in document.items()}, test, text,
        _paper(columns, document, published.NRMSE, lambda value: f"{value:.2f}"), "on test rows",
    )  # fmt: skip


def _rows(scores: ComparedRing) -> str:
    train, test = ("?" if n is None else n for n in (scores.n_train, scores.n_test))
    blocks, text = scores.blocks.get("test"), f"{test} to test"
    if blocks is not None and not enough(blocks=blocks):
        text += f" in {blocks} block{'' if blocks == 1 else 's'}"
    return f"{train} rows, {text}" if train != 0 else text


def _rollouts(document: Comparison) -> PageTable:
    """The table of errors of roll-outs, as the second table of the paper."""
    columns = kinds(document, "rollout")

    def text(ring: int, kind: str) -> str:
        errors = document[ring].rollout.get(kind)
        return _degrees(errors["20"], errors["40"]) if errors else MISSING

    labels = {
        ring: f"ring {ring}: {'?' if s.windows is None else s.windows} windows, {s.windows_chosen}"
        for ring, s in document.items() if s.rollout
    }  # fmt: skip
    return _scores_table(
        "Mean absolute error of the angle after 20 / 40 samples, degrees", [KINDS.get(kind, kind) for kind in columns],
        columns, labels, lambda ring, kind: document[ring].rollout.get(kind, {}).get("40", math.nan), text,
        _paper(columns, document, published.ROLLOUT, lambda pair: _degrees(*pair)), "after 40",
    )  # fmt: skip


def _degrees(early: float, late: float) -> str:
    return SLASH.join(words.number(DEG * value, 1) for value in (early, late))


# -- pictures ----------------------------------------------------------------------------------------------------------


def around(residual: ResidualDocument, kind: str) -> Array:
    """Root mean square residual of a kind at each angle (A,), over all rates, rad/s^2."""
    rms = residual.rms[kind]
    count = np.where(np.isfinite(rms), residual.count, 0.0)
    total = count.sum(axis=0)
    power = np.sum(count * np.nan_to_num(rms) ** 2, axis=0)
    return np.sqrt(np.divide(power, total, out=np.full(len(total), math.nan), where=total > 0))


def models_pictures(document: Comparison, maze: Maze | None, main: str = "") -> list[PagePicture]:
    """The pictures for which the document has numbers.

    maze: None leaves out the picture over the maze.
    main: the kind on which they focus, by default the best."""
    main = main or best_kind(document)
    found, width = [], min(12.0, 1.4 + 2.7 * len(document))
    if any(scores.bands for scores in document.values()):
        found.append(
            PagePicture(
                "rollouts", "How far roll-outs are off: mean, and from 10 to 90 % of the windows",
                "absolute error of the angle against the number of samples rolled out, by ring",
                partial(_rollout_errors, document=document), (width, 3.2),
            )
        )  # fmt: skip
    residuals = {ring: scores.residual for ring, scores in document.items() if scores.residual}
    if residuals and maze is not None:
        have = list(next(iter(residuals.values())).rms)
        wanted = dict.fromkeys(kind for kind in ("p", "pi", main, "np") if kind in have)
        shown = list(wanted or have)[:MAPS_SHOWN]
        found.append(
            PagePicture(
                "residual-maze", "Residual of the acceleration, over the maze (white: too few samples)",
                "root mean square residual by ring and angle, over the plan of the maze",
                partial(_over_maze, residuals=residuals, maze=maze, shown=shown), (1.0 + 3.7 * len(shown), 4.4),
            )
        )  # fmt: skip
    return found


def _rollout_errors(figure: Figure, document: Comparison) -> None:
    bands = {ring: scores.bands for ring, scores in document.items() if scores.bands}
    panels, top = figure.subplots(1, len(bands), sharey=True, squeeze=False)[0], 0.0
    for axes, (ring, by_kind) in zip(panels, bands.items(), strict=True):
        for kind in (kind for kind in kinds(document, "bands") if kind in by_kind):
            mean, low, high = (DEG * by_kind[kind][name] for name in ("mean", "p10", "p90"))
            k, name = np.arange(len(mean)), KIND_STYLES.get(kind, "neutral")
            axes.plot(k, mean, **line(name), label=KINDS.get(kind, kind))
            axes.plot(k[10::10], mean[10::10], **points(name))
            if kind != "npd":  # the errors of npd are too large for the picture
                axes.fill_between(k, low, high, color=COLOURS[name], alpha=0.16, lw=0)
                top = max(top, float(np.nanmax(high)))
        axes.set_title(f"ring {ring}")
        axes.set_xlabel("samples rolled out")
        axes.grid()
    panels[0].set_ylabel("error of the angle, degrees")
    panels[0].set_ylim(0.0, 1.05 * top if top > 0.0 else None)
    legend_beside(panels[-1])


def _over_maze(figure: Figure, residuals: dict[int, ResidualDocument], maze: Maze, shown: list[str]) -> None:
    panels: Any = figure.subplots(1, len(shown), squeeze=False)[0]
    values = {kind: [around(residual, kind) for residual in residuals.values()] for kind in shown}
    top = float(np.nanpercentile(np.concatenate([row for rows in values.values() for row in rows]), 98.0))
    rings = [(maze.ring(ring).inner_radius, maze.ring(ring).outer_radius) for ring in residuals]
    drawn: Any = None
    for axes, kind in zip(panels, shown, strict=True):
        plan_view(axes, maze, np.empty((0, 2)), labels=False)
        drawn = sector_map(axes, rings, values[kind], 0.0, top, darker("inferno_r", 0.06, 1.0))
        axes.set_title(KINDS.get(kind, kind))
    bar = figure.colorbar(drawn, ax=list(panels), shrink=0.75, extend="max", aspect=30)
    bar.set_label("measured less predicted,\nroot mean square, rad/s²")
