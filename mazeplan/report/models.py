"""Kinds of models on the same data, by the documents of `compare --json`: the paper's tables, curves, residuals."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from mazeplan.errors import InputError
from mazeplan.maze.geometry import Maze
from mazeplan.maze.mapfile import load_map
from mazeplan.models.enough import BLOCKS, TOO_FEW, WINDOWS, enough
from mazeplan.records import Array
from mazeplan.report import published, words
from mazeplan.report.inputs import Input
from mazeplan.report.page import Note, Section, Table
from mazeplan.report.words import KINDS, MISSING

Document = dict[str, Any]
INTERVALS = (
    "Intervals are percentiles over test rows drawn in whole blocks again and again. The error is divided by the "
    "spread of the rows drawn, which is less where a block is drawn twice: with few blocks an interval may begin at "
    f"its number, or lie above it. Fewer than {BLOCKS} blocks, or {WINDOWS} windows of roll-outs, are too few to say "
    "how sure a number is."
)
SLASH = f"{words.HARD}/{words.HARD}"


def rings(document: Document) -> list[int]:
    """Their numbers, in order."""
    return sorted(int(key.removeprefix("ring")) for key in document)


def kinds(document: Document, part: str) -> list[str]:
    """Kinds of models that any ring tells of, in the paper's order."""
    found = {kind for scores in document.values() for kind in scores.get(part, {})}
    return [kind for kind in KINDS if kind in found] + sorted(found - set(KINDS))


def best_kind(document: Document) -> str:
    """That with the least test nRMSE on the average of the rings that have it."""
    means = {
        kind: float(np.mean([known(s["nrmse_test"].get(kind)) for s in document.values()]))
        for kind in kinds(document, "nrmse_test")
    }
    finite = {kind: mean for kind, mean in means.items() if math.isfinite(mean)}
    return min(finite, key=lambda kind: finite[kind]) if finite else ""


def known(value: float | None) -> float:
    """A number of a document, NaN where it is null."""
    return math.nan if value is None else float(value)


def blocks_of(scores: Document, which: str) -> int | None:
    """How many blocks of time a ring has with test rows ("test"), or with windows; None: an older document."""
    return scores.get("blocks", {}).get(which)


def cells(rows: Sequence[Sequence[float | None]]) -> Array:
    """A table of a document, NaN where it is null."""
    return np.array([[known(value) for value in row] for row in rows])


def around(residual: Document, kind: str) -> Array:
    """Root mean square of what a kind leaves over in each cell of angle (A,), all rates together, rad/s^2."""
    rms, count = cells(residual["rms"][kind]), np.array(residual["count"], dtype=float)
    count = np.where(np.isfinite(rms), count, 0.0)
    total = count.sum(axis=0)
    power = np.sum(count * np.nan_to_num(rms) ** 2, axis=0)
    return np.sqrt(np.divide(power, total, out=np.full(len(total), math.nan), where=total > 0))


def models_section(given: Input) -> Section:
    """Everything about a comparison. Raises InputError."""
    from mazeplan.report.confidence import confidence_parts
    from mazeplan.report.models_pictures import models_pictures

    document = given.document
    maze = _maze(given)
    parts: list[Any] = [_accelerations(document), _rollouts(document), *confidence_parts(document)]
    if any("interval95" in scores for scores in document.values()):
        parts.insert(1, Note(INTERVALS))
    parts += models_pictures(document, maze)
    if not any(scores.get("curve") for scores in document.values()):
        parts.append(Note("Learning curves are in the document of", "mazeplan compare LOG... --curve FILE.png --json"))
    if not any(scores.get("residual") for scores in document.values()):
        parts.append(Note("The document is from before it told of residuals over the maze and of bands."))
    first = next(iter(document.values()))
    facts = [("rings", ", ".join(str(ring) for ring in rings(document)))]
    if "rates" in first:
        facts.append(("rates", str(first["rates"])))
    if isinstance(first.get("delay_s"), int | float):
        facts.append(("ball behind the tilt", f"{first['delay_s']:g} s"))
    return Section(f"Models, {given.name}", _lead(document), facts, parts)


def model_section(folder: Path, logs: Sequence[Path]) -> Section:
    """A model folder, and how it does on logs, where there are any. Raises InputError."""
    from mazeplan.data.table import read_table
    from mazeplan.models.modelfile import load_model
    from mazeplan.report.learned import effects_table, judged, learned_from, model_facts
    from mazeplan.report.models_pictures import models_pictures

    model, maze = load_model(folder), _log_map(logs)
    facts, parts = model_facts(model, folder), [effects_table(model)]
    if not logs:
        note = Note("How it does on a log, and what it leaves over, is shown when logs are given with it:",
                    "mazeplan report MODEL LOG... -o FILE.html")  # fmt: skip
        return Section(f"Model {folder.name}", f"Kind of model: {words.kind(model.kind)}.", facts, [*parts, note])
    document = judged(model, [read_table(log) for log in logs], maze)
    facts.append(("judged on", ", ".join(log.name for log in logs)))
    shown: list[Any] = [
        _accelerations(document),
        _rollouts(document),
        *parts,
        *models_pictures(document, maze, "model"),
    ]
    told = [f"{known(s['nrmse_test']['model']):.3f} in {ring}" for ring, s in document.items()]
    lead = f"Relative error of the angular acceleration (nRMSE): {', '.join(told)}".replace("in ring", "in ring ")
    seen = learned_from(model, logs)
    if seen:
        lead += f". Beware: the model was learned from {', '.join(seen)} itself, so that it looks better than it is"
    return Section(f"Model {folder.name} on {', '.join(log.name for log in logs)}", f"{lead}.", facts, shown)


def _log_map(logs: Sequence[Path]) -> Maze:
    """The map of the first run log that has one, else cme."""
    from mazeplan.data.runlog import read_log
    from mazeplan.report.run import maze_of

    first = next((log for log in logs if log.suffix.lower() == ".mcap"), None)
    return load_map("cme") if first is None else maze_of(read_log(first))


def _maze(given: Input) -> Maze:
    """To draw over: the rings must be there. Raises InputError."""
    maze = load_map("cme")
    most = max(rings(given.document))
    if most > len(maze.rings):
        raise InputError(f"got ring{most}, expected ring1 to ring{len(maze.rings)}", file=given.path)
    return maze


def _lead(document: Document) -> str:
    best = best_kind(document)
    if not best:
        return "No kind of model could be scored."
    told = [
        f"{known(document[f'ring{ring}']['nrmse_test'].get(best)):.3f} in ring {ring}" for ring in rings(document)
    ]  # fmt: skip
    return (
        f"Predicts the acceleration best{'' if len(document) == 1 else ' on average'}: {KINDS.get(best, best)}. "
        f"Relative error on test rows (nRMSE): {', '.join(told)}.{_others(document, best)}"
    )


def _others(document: Document, best: str) -> str:
    """Rings in which another kind is the best."""
    told = []
    for ring in rings(document):
        scores = {kind: known(value) for kind, value in document[f"ring{ring}"]["nrmse_test"].items()}
        finite = {kind: value for kind, value in scores.items() if math.isfinite(value)}
        first = min(finite, key=lambda kind: finite[kind]) if finite else best
        if first != best and finite[first] < finite.get(best, math.inf):
            told.append(f"in ring {ring} {KINDS.get(first, first)}, {finite[first]:.3f}")
    return f" Better there: {'; '.join(told)}." if told else ""


def _marked(
    rows: Sequence[str], head: Sequence[str], value: Callable[[str, str], float], text: Callable[[str, str], str]
) -> tuple[list[list[str]], frozenset[tuple[int, int]]]:
    """Cells (row x head), and the least of each row."""
    out, strong = [], set()
    for i, row in enumerate(rows):
        values = [value(row, column) for column in head]
        out.append([row, *(text(row, column) for column in head)])
        if any(math.isfinite(v) for v in values):
            strong.add((i, 1 + int(np.nanargmin(values))))
    return out, frozenset(strong)


def _accelerations(document: Document) -> Table:
    """The paper's first table."""
    columns = kinds(document, "nrmse_test")

    def test(row: str, kind: str) -> float:
        return known(document[row]["nrmse_test"].get(kind))

    def text(row: str, kind: str) -> str:
        train = known(document[row]["nrmse_train"].get(kind))
        interval = document[row].get("interval95", {}).get("nrmse_test", {}).get(kind)
        low, high = (interval or (None, None))[:2]
        band = "" if low is None or high is None else f"\n[{low:.2f},{words.HARD}{high:.2f}]"
        if interval is not None and not enough(blocks=blocks_of(document[row], "test")):
            band = f"\n{TOO_FEW}"
        before = f"{words.number(train, 3)}{SLASH}" if math.isfinite(train) else ""
        return f"{before}{words.number(test(row, kind), 3)}{band}"

    names = [f"ring{ring}" for ring in rings(document)]
    rows, strong = _marked(names, columns, test, text)
    for row, ring in zip(rows, rings(document), strict=True):
        row[0] = f"ring {ring}: {_rows(document[f'ring{ring}'])}"
    title = "Relative error of the angular acceleration (nRMSE)"
    if any(scores["nrmse_train"] for scores in document.values()):
        title += ", train / test" + (", [95 % interval]" if any("interval95" in s for s in document.values()) else "")
    paper = _paper(columns, rings(document), published.NRMSE, lambda value: f"{value:.2f}")
    return _beside(paper, title, [words.kind(kind) for kind in columns], rows, strong, "on test rows")


def _beside(
    paper: list[list[str]],
    title: str,
    head: Sequence[str],
    rows: list[list[str]],
    strong: frozenset[tuple[int, int]],
    bold: str,
) -> Table:
    """A table with what was published below, where there is any; bold: by what the least of a row is told."""
    told = "; published: test, on the paper's rig" if paper else ""
    told += f"; bold: least {bold}" if strong else ""
    return Table(title + told, ("", *head), [*rows, *paper], strong)


def _rows(scores: Document) -> str:
    train, test, blocks = scores.get("n_train", "?"), f"{scores.get('n_test', '?')} to test", blocks_of(scores, "test")
    if blocks is not None and not enough(blocks=blocks):
        test += f" in {blocks} block{'' if blocks == 1 else 's'}"
    return f"{train} rows, {test}" if train != 0 else test


def _paper(
    columns: Sequence[str], numbers: Sequence[int], table: dict[str, Any], text: Callable[[Any], str]
) -> list[list[str]]:
    """What was published, of other data: rows of the same form."""
    rows = []
    for ring in numbers:
        if not any(ring <= len(table[kind]) for kind in columns if kind in table):
            continue
        told = [
            text(table[kind][ring - 1]) if kind in table and ring <= len(table[kind]) else MISSING for kind in columns
        ]
        rows.append([f"published, ring {ring}", *told])
    return rows


def _rollouts(document: Document) -> Table:
    """The paper's second table."""
    columns = kinds(document, "rollout")

    def late(row: str, kind: str) -> float:
        return known(document[row]["rollout"].get(kind, {}).get("40"))

    def text(row: str, kind: str) -> str:
        errors = document[row]["rollout"].get(kind)
        return _degrees(known(errors["20"]), late(row, kind)) if errors else MISSING

    names = [f"ring{ring}" for ring in rings(document) if document[f"ring{ring}"]["rollout"]]
    rows, strong = _marked(names, columns, late, text)
    for row in rows:
        scores = document[row[0]]
        row[0] = f"ring {row[0].removeprefix('ring')}: {scores.get('windows', '?')} windows, " + str(
            scores.get("windows_chosen", "")
        )
    paper = _paper(columns, rings(document), published.ROLLOUT, lambda pair: _degrees(*pair))
    title = "Mean absolute error of the angle after 20 / 40 samples, deg"
    return _beside(paper, title, [KINDS.get(kind, kind) for kind in columns], rows, strong, "after 40")


def _degrees(early: float, late: float) -> str:
    return SLASH.join(words.number(words.DEG * value, 1) for value in (early, late))
