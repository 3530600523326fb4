"""The numbers of an evaluation that reports show: success, times and failures of its runs."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from mazeplan.apps.report.documents import EvaluationSetup, FailureEntry, RunEntry
from mazeplan.apps.report.inputs import Input
from mazeplan.core.errors import MapError
from mazeplan.core.records import Array
from mazeplan.maze.geometry import Maze
from mazeplan.maze.mapfile import check_text, load_map

Z = 1.959964  # half width of a 95 % interval, in standard deviations


@dataclass(frozen=True)
class EvaluatedRuns:
    """One evaluation of N runs.

    time (N,): time until arrival or end of the run, s.
    arrived (N,): whether the run arrived.
    results, setup: as in the document."""

    name: str
    time: Array
    arrived: np.ndarray
    results: list[RunEntry]
    setup: EvaluationSetup

    @property
    def limit(self) -> float:
        """Time limit, s; if the document has none, the longest time."""
        return self.setup.time_limit_s if self.setup.time_limit_s > 0.0 else float(self.time.max())

    @property
    def share(self) -> str:
        """How many runs arrived, as text."""
        return f"{int(self.arrived.sum())} of {len(self.time)}"

    def failures(self) -> Iterator[tuple[FailureEntry, bool]]:
        """Each failure, and whether its run arrived."""
        return ((failure, run.success) for run in self.results for failure in run.failures)


def runs_of(given: Input, name: str = "") -> EvaluatedRuns:
    """The runs of an evaluation's document. name: by default the name of the input."""
    results = given.document.results
    return EvaluatedRuns(
        name or given.name,
        np.array([run.time_s for run in results]),
        np.array([run.success for run in results]),
        results,
        given.document.setup,
    )


def maze_of(evaluations: Sequence[Input]) -> Maze:
    """The map of the first evaluation that has one, else cme. Raises MapError for a map with errors."""
    for given in evaluations:
        if given.document.setup.map is not None:
            maze = check_text(given.document.setup.map, file=given.path).maze
            if maze is None:
                raise MapError("the map in it cannot be used", file=given.path, key="setup.map")
            return maze
    return load_map("cme")


def as_published(maze: Maze) -> bool:
    """Whether the published times hold for this maze."""
    return maze == load_map("cme")


def interval(successes: int, runs: int) -> tuple[float, float]:
    """95 % interval of the share of successes (Wilson, 1927)."""
    p, zz = successes / runs, Z * Z / runs
    middle = (p + 0.5 * zz) / (1.0 + zz)
    half = Z * math.sqrt(p * (1.0 - p) / runs + 0.25 * zz / runs) / (1.0 + zz)
    return max(middle - half, 0.0), min(middle + half, 1.0)


def by_kind(runs: EvaluatedRuns) -> dict[str, tuple[int, int]]:
    """{kind of failure: (number in runs that arrived, number in the other runs)}, the most frequent kind first."""
    counts = Counter((failure.kind, arrived) for failure, arrived in runs.failures())
    pairs = {kind: (counts[kind, True], counts[kind, False]) for kind, _ in counts}
    return dict(sorted(pairs.items(), key=lambda entry: (-sum(entry[1]), entry[0])))


def places(runs: EvaluatedRuns) -> list[tuple[str, float, float]]:
    """(kind, x, y in m) of each failure whose place is known."""
    return [(f.kind, f.x, f.y) for f, _ in runs.failures() if math.isfinite(f.x) and math.isfinite(f.y)]


def figures(runs: EvaluatedRuns) -> dict[str, float]:
    """Mean, best, median, 95 % and worst time of the runs that arrived, s; NaN if none arrived."""
    times = runs.time[runs.arrived] if runs.arrived.any() else np.array([math.nan])
    p50, p95 = np.percentile(times, [50.0, 95.0])
    values = {"mean": times.mean(), "best": times.min(), "p50": p50, "p95": p95, "worst": times.max()}
    return {name: float(value) for name, value in values.items()}
