"""Navigations one after the other with a model that learns from each: `evaluate --learn`.

The folder of a stored learner (`-o`) is a model folder that every `--model` takes (`mazeplan.learning.online`).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from mazeplan.core.errors import InputError, ModelError
from mazeplan.core.logs.table import table_of
from mazeplan.core.records import FailureKind, NavigationResult
from mazeplan.learning.modelfile import RigModel
from mazeplan.learning.online import STATE, Lesson, OnlineModel, open_online, save_online
from mazeplan.maze.geometry import Maze
from mazeplan.rigs.registry import rig_label
from mazeplan.run.campaign.lock import exclusive_lock
from mazeplan.run.campaign.one_run import Campaign, run_one
from mazeplan.run.request import Company
from mazeplan.run.resolve import resolve_model

LOCK = ".learning.lock"
SEEN = 0.8  # minimum share of the ticks in which the ball was seen
BAD = (FailureKind.RIG_FAILED, FailureKind.BALL_LOST, FailureKind.BALL_OUT, FailureKind.LEAF_FAILED)


@dataclass
class Ticks:
    """Collects the ticks of a run while it goes on; pass it to `run_one` as `feed`."""

    rows: list[dict[str, Any]] = field(default_factory=list)
    camera_delay: float | None = None  # s, as measured on the rig; None: not measured

    def __call__(self, topic: str, t: float, document: Mapping[str, Any]) -> None:
        """Take a message of the run."""
        if topic == "/tick":
            self.rows.append(dict(document))
        elif topic == "/header":
            latency = document["replay"].get("latency")
            self.camera_delay = None if latency is None else float(latency["camera_s"])


@contextmanager
def open_learner(
    model: str | Path | RigModel | None, rig: str, maze: Maze, folder: Path | None
) -> Iterator[OnlineModel]:
    """The model that learns, for `--model`, `--rig` and `-o`: the one stored in the folder, else a new one.

    Meanwhile no other process learns in the folder. Raises InputError."""
    if folder is None:
        yield OnlineModel(resolve_model(model, rig, maze), maze)
        return
    made = not folder.exists()
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as problem:
        raise InputError(f"-o: got {folder}: {problem.strerror}; expected a folder that can be made") from None
    try:
        with exclusive_lock(folder / LOCK, "-o", "learning"):
            yield _stored(model, rig, maze, folder)
    finally:
        if not (folder / STATE).exists():
            with suppress(OSError):
                (folder / LOCK).unlink(missing_ok=True)
                if made:
                    folder.rmdir()


def _stored(model: str | Path | RigModel | None, rig: str, maze: Maze, folder: Path) -> OnlineModel:
    if (folder / STATE).exists():
        if model is not None and (isinstance(model, RigModel) or Path(model).resolve() != folder.resolve()):
            raise InputError(f"--model: got {model}, but what {folder} has learned so far goes on: leave --model out")
        return open_online(folder, maze, rig_label(rig))
    if other := [path.name for path in folder.iterdir() if path.name != LOCK]:
        what = f"holds other things ({min(other)}), expected a new or an empty folder, or one of --learn"
        raise ModelError(what, file=folder)
    return OnlineModel(resolve_model(model, rig, maze), maze)


def unfit(result: NavigationResult, ticks: Ticks) -> str:
    """Why the model cannot learn from a run; empty if it can."""
    bad = next((f for f in result.failures if f.kind in BAD), None)
    if bad is not None:
        return f"{bad.kind} after {bad.t:.1f} s"
    if result.doubts:
        doubt = result.doubts[0]
        return f"what was measured is in doubt ({doubt.what} after {doubt.t:.1f} s)"
    seen = sum("x" in row for row in ticks.rows)
    if seen < SEEN * len(ticks.rows) or len(ticks.rows) < 2:
        return f"the ball was seen in {seen} of {len(ticks.rows)} ticks only"
    return ""


def learn_from(online: OnlineModel, result: NavigationResult, ticks: Ticks) -> Lesson:
    """Learn from a run that has ended."""
    if why := unfit(result, ticks):
        return online.skipped(why)
    try:
        return online.learn(table_of(ticks.rows, f"run {online.now + 1}"), ticks.camera_delay)
    except InputError as problem:
        return online.skipped(problem.problem)


def evaluate_learning(
    campaign: Campaign,
    folder: Path | None = None,
    *,
    progress: Callable[[int], None] | None = None,
    tell: Callable[[Lesson], None] | None = None,
) -> tuple[list[NavigationResult], list[Lesson]]:
    """The results of a campaign whose model learns from each run, in their order, and the lesson of each run.

    folder: where the model is stored after each run; None: nowhere
    progress: is called with the number of finished runs after each run
    tell: is called with the lesson after each run

    The numbers of the runs go on from the runs that the stored model has seen. So an interrupted campaign goes on as if
    it had not been interrupted. Raises InputError."""
    outcomes, lessons = [], []
    rig = str(campaign.rig)
    with open_learner(campaign.model, rig, campaign.maze, folder) as online:
        first = online.now
        for index in range(campaign.runs):
            ticks = Ticks()
            now = replace(campaign, model=online.model)
            outcomes.append(run_one(now, first + index, Company(feed=ticks)))
            lessons.append(learn_from(online, outcomes[-1], ticks))
            if folder is not None:
                save_online(online, folder, rig_label(rig))
            if tell is not None:
                tell(lessons[-1])
            if progress is not None:
                progress(index + 1)
    return outcomes, lessons


def lesson_document(lesson: Lesson) -> dict[str, Any]:
    """The entry of a run in `evaluate --learn --json`; errors are null if there are no rows."""

    def rounded(value: float) -> float | None:
        return round(value, 5) if math.isfinite(value) else None

    return {
        "run": lesson.run, "rows": {f"ring{ring}": n for ring, n in lesson.rows.items()}, "why_not": lesson.why or None,
        "error_m_s2": rounded(lesson.error), "fixed_error_m_s2": rounded(lesson.fixed), "trusted": lesson.trusted,
    }  # fmt: skip


def lesson_line(lesson: Lesson) -> str:
    """A lesson as a line for people; empty for a run from which the model learned as usual."""
    if lesson.why:
        return f"run {lesson.run}: not learned from: {lesson.why}"
    return "" if lesson.trusted else f"run {lesson.run}: the first model predicts better and is used for the next run"
