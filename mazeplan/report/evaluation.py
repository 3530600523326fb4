"""Evaluations, one or several side by side: success, times, failures, by the documents of `evaluate --json`."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from mazeplan.errors import MapError
from mazeplan.maze.geometry import Maze
from mazeplan.maze.mapfile import check_text, load_map
from mazeplan.records import Array
from mazeplan.report import published
from mazeplan.report.inputs import Input
from mazeplan.report.learning import learning_parts
from mazeplan.report.page import Note, Section, Table
from mazeplan.report.run import told
from mazeplan.report.words import MISSING, seconds

SECTORS = 16
Z = 1.959964  # of a 95 % interval


@dataclass(frozen=True)
class Runs:
    """One evaluation. time: s until arrival or the end, (N,); arrived (N,); start: angle in rad, NaN where the document
    does not tell, (N,); results, learning (of each run, with --learn): as in the document."""

    name: str
    time: Array
    arrived: np.ndarray
    start: Array
    results: list[dict[str, Any]]
    setup: dict[str, Any]
    learning: tuple[dict[str, Any], ...] = ()

    @property
    def number(self) -> np.ndarray:
        """Of each run in its campaign, from 1 (N,): a model that learns may have begun before this evaluation."""
        told = [lesson["run"] for lesson in self.learning]
        return np.array(told) if len(told) == len(self.time) else np.arange(1, len(self.time) + 1)

    @property
    def limit(self) -> float:
        """s; the longest time of all where the document does not tell."""
        limit = self.setup.get("time_limit_s")
        return float(limit) if isinstance(limit, int | float) and limit > 0 else float(self.time.max())


def runs_of(given: Input) -> Runs:
    """What an evaluation's document tells."""
    results = given.document["results"]
    return Runs(
        given.name,
        np.array([float(r["time_s"]) for r in results]),
        np.array([bool(r["success"]) for r in results]),
        np.array([float((r.get("start") or {}).get("theta", math.nan)) for r in results]),
        results,
        given.document.get("setup") or {},
        tuple((given.document.get("learning") or {}).get("runs") or ()),
    )


def maze_of(evaluations: Sequence[Input]) -> Maze:
    """The map of the first that tells its own, else cme. Raises MapError for one that cannot be used."""
    for given in evaluations:
        text = (given.document.get("setup") or {}).get("map")
        if isinstance(text, str):
            maze = check_text(text, file=given.path).maze
            if maze is None:
                raise MapError("the map in it cannot be used", file=given.path, key="setup.map")
            return maze
    return load_map("cme")


def as_published(maze: Maze) -> bool:
    """Whether a maze is the one of which the published times are."""
    return maze == load_map("cme")


def interval(successes: int, runs: int) -> tuple[float, float]:
    """Of a share, 95 % (Wilson, 1927)."""
    p, zz = successes / runs, Z * Z / runs
    middle = (p + 0.5 * zz) / (1.0 + zz)
    half = Z * math.sqrt(p * (1.0 - p) / runs + 0.25 * zz / runs) / (1.0 + zz)
    return max(middle - half, 0.0), min(middle + half, 1.0)


def by_sector(runs: Runs) -> tuple[np.ndarray, np.ndarray]:
    """(arrived, all) in SECTORS sectors of the start angle, the first from 0 on."""
    known = np.isfinite(runs.start)
    sector = np.floor(np.mod(runs.start[known], 2.0 * math.pi) / (2.0 * math.pi) * SECTORS).astype(int) % SECTORS
    total = np.bincount(sector, minlength=SECTORS)
    return np.bincount(sector, runs.arrived[known], minlength=SECTORS).astype(int), total


def by_ring(runs: Runs) -> dict[int, Array]:
    """Time in each ring, s, summed over visits, of the runs that arrived."""
    found: dict[int, list[float]] = {}
    for result, arrived in zip(runs.results, runs.arrived, strict=True):
        if not arrived:
            continue
        spent: Counter[int] = Counter()
        for visit in result["rings"]:
            spent[visit["ring"]] += visit["time_s"]
        for ring, time in spent.items():
            found.setdefault(ring, []).append(time)
    return {ring: np.array(times) for ring, times in sorted(found.items())}


def by_kind(runs: Runs) -> dict[str, tuple[int, int]]:
    """Kind of failure -> (how many in runs that arrived, how many in runs that did not), the most first."""
    counts: dict[str, list[int]] = {}
    for result, arrived in zip(runs.results, runs.arrived, strict=True):
        for failure in result["failures"]:
            counts.setdefault(failure["kind"], [0, 0])[0 if arrived else 1] += 1
    return {kind: (a, b) for kind, (a, b) in sorted(counts.items(), key=lambda entry: (-sum(entry[1]), entry[0]))}


def places(runs: Runs) -> list[tuple[str, float, float]]:
    """(kind, x, y in m) of each failure whose place is told."""
    return [
        (failure["kind"], float(failure["x"]), float(failure["y"]))
        for result in runs.results
        for failure in result["failures"]
        if failure.get("x") is not None and failure.get("y") is not None
    ]


def figures(runs: Runs) -> dict[str, float]:
    """Mean, best, median, 95 % and worst time of those that arrived, s; NaN of none."""
    times = runs.time[runs.arrived]
    if not len(times):
        return dict.fromkeys(("mean", "best", "p50", "p95", "worst"), math.nan)
    p50, p95 = np.percentile(times, [50.0, 95.0])
    values = (times.mean(), times.min(), p50, p95, times.max())
    return dict(zip(("mean", "best", "p50", "p95", "worst"), map(float, values), strict=True))


def evaluation_section(given: Sequence[Input]) -> Section:
    """Everything about evaluations. Raises InputError."""
    from mazeplan.report.evaluation_pictures import evaluation_pictures

    maze = maze_of(given)
    several = _apart([runs_of(part) for part in given])
    parts: list[Any] = [_table(several, as_published(maze)), *evaluation_pictures(several, maze), _kinds_table(several)]
    if all(not len(by_kind(runs)) for runs in several):
        parts.pop()
    parts += [part for runs in several for part in learning_parts(runs, several)]
    if any(not np.isfinite(runs.start).any() for runs in several):
        parts.append(Note("Where start angles are not shown, the document is from before they were told."))
    facts = _facts(several) if len(several) == 1 else []
    return Section(_title(several), _lead(several), facts, parts)


def _apart(several: list[Runs]) -> list[Runs]:
    """With names that differ."""
    from dataclasses import replace

    names: Counter[str] = Counter()
    out = []
    for runs in several:
        names[runs.name] += 1
        n = names[runs.name]
        out.append(replace(runs, name=runs.name if n == 1 else f"{runs.name} ({n})"))
    return out


def _title(several: list[Runs]) -> str:
    return (
        f"Evaluation {several[0].name}" if len(several) == 1 else "Evaluations: " + ", ".join(r.name for r in several)
    )


def _facts(several: list[Runs]) -> list[tuple[str, str]]:
    setup = several[0].setup
    names = (
        ("rig", "rig"), ("map_name", "map"), ("model", "model"), ("behavior", "behaviour tree"), ("seed", "first seed"),
        ("start_ring", "from ring"), ("goal_ring", "to ring"), ("time_limit_s", "time limit"),
        ("version", "mazeplan"),
    )  # fmt: skip
    return [(label, told(name, setup[name])) for name, label in names if setup.get(name) not in (None, "")]


def _lead(several: list[Runs]) -> str:
    told = []
    for runs in several:
        n, times = int(runs.arrived.sum()), figures(runs)
        mean = f", on average after {times['mean']:.2f} s" if n else ""
        told.append(f"{'' if len(several) == 1 else runs.name + ': '}{n} of {len(runs.time)} arrived{mean}")
    return "; ".join(told) + "."


def _table(several: list[Runs], compared: bool) -> Table:
    """compared: with the published times."""
    head = ["", *(runs.name for runs in several), "published, on hardware"]
    rows = [["arrived", *(f"{int(r.arrived.sum())} of {len(r.time)}" for r in several)]]
    rows[0].append(f"{published.ARRIVED} of {published.RUNS}")
    shares = [interval(int(r.arrived.sum()), len(r.time)) for r in several]
    shares.append(interval(published.ARRIVED, published.RUNS))
    rows.append(["95 % interval of the share", *(f"{100 * a:.0f} to {100 * b:.0f} %" for a, b in shares)])
    labels = {"mean": "mean time", "best": "best", "p50": "median", "p95": "95 % are faster than", "worst": "worst"}
    for key, label in labels.items():
        cells = [seconds(figures(runs)[key]) for runs in several]
        rows.append([label, *cells, seconds(published.TIMES.get(key, math.nan))])
    rows.append(["failures on the way", *(str(sum(len(x["failures"]) for x in r.results)) for r in several), MISSING])
    ends = [Counter(x["reason"] for x in r.results if not x["success"]) for r in several]
    why = [", ".join(f"{k.replace('_', ' ')} {n}" for k, n in sorted(e.items())) or MISSING for e in ends]
    rows.append(["those that did not arrive ended with", *why, MISSING])
    if len(several) > 1:
        for key, label in (("rig", "rig"), ("model", "model"), ("map_name", "map"), ("version", "mazeplan")):
            rows.append([label, *(str(r.setup.get(key, MISSING)) for r in several), MISSING])
    if not compared:
        head, rows = head[:-1], [row[:-1] for row in rows]
    return Table("In figures; times are of the runs that arrived", head, rows)


def _kinds_table(several: list[Runs]) -> Table:
    kinds = sorted({kind for runs in several for kind in by_kind(runs)})
    counted = [by_kind(runs) for runs in several]
    rows = [[kind.replace("_", " "), *(_counts(c.get(kind, (0, 0))) for c in counted)] for kind in kinds]
    return Table("Failures: got over + in runs that did not arrive", ("kind", *(r.name for r in several)), rows)


def _counts(pair: tuple[int, int]) -> str:
    return f"{pair[0]} + {pair[1]}"
