"""Navigations one after the other with a model that learns from each: `evaluate --learn`, `navigate --learn`.

    learner = Learner.begin(model, maze)        # or Learner.opened(folder, maze), where one was kept
    outcomes = learn_while(campaign, learner)   # runs in their order, each with what the ones before it taught

A folder in which a learner is kept (`-o`) is a model folder that every `--model` takes; beside model.yaml lie the model
that it began with, `start/`, and the rows that it has learned since, `learning.npz`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from mazeplan.core.errors import InputError, ModelError
from mazeplan.core.logs.table import table_of
from mazeplan.core.records import FailureKind, NavigationResult
from mazeplan.learning.modelfile import RigModel
from mazeplan.learning.online_folder import ROWS, keep_learner, open_learner
from mazeplan.learning.online_rig import Lesson, OnlineModel, OnlineOptions
from mazeplan.maze.geometry import Maze
from mazeplan.rigs.registry import rig_label
from mazeplan.run.campaign.evaluate import Campaign, run_one
from mazeplan.run.campaign.lock import alone
from mazeplan.run.resolve import resolve_model

LOCK = ".learning.lock"
SEEN = 0.8  # of the ticks, at least, in which the ball must have been seen
BAD = (FailureKind.RIG_FAILED, FailureKind.BALL_LOST, FailureKind.BALL_OUT, FailureKind.LEAF_FAILED)


@dataclass
class Ticks:
    """Collects the ticks of a run while it goes on, as `feed` of `navigate` and `run_one`."""

    rows: list[dict[str, Any]] = field(default_factory=list)
    camera_delay: float | None = None  # s, where it was measured of the rig

    def __call__(self, topic: str, t: float, document: Mapping[str, Any]) -> None:
        """Take a message of the run."""
        if topic == "/tick":
            self.rows.append(dict(document))
        elif topic == "/header":
            latency = document["replay"].get("latency")
            self.camera_delay = None if latency is None else float(latency["camera_s"])


@dataclass
class Learner:
    """A model that learns, and where it is kept; None: nowhere."""

    online: OnlineModel
    folder: Path | None = None
    rig: str = ""

    @classmethod
    def begin(
        cls, start: RigModel, maze: Maze, folder: str | Path | None = None, options: OnlineOptions | None = None,
        rig: str = "",
    ) -> Learner:  # fmt: skip
        """Begin with a model, on a rig of that name. Raises InputError for one that cannot learn, ModelError for a
        folder that holds another model, or anything else."""
        folder = None if folder is None else Path(folder)
        if folder is not None and (folder / "model.yaml").exists():
            advice = "give another folder, and this one with --model to begin with it"
            raise ModelError(f"holds a model that was not made by --learn: {advice}", file=folder)
        if folder is not None and folder.is_dir() and (other := [p.name for p in folder.iterdir() if p.name != LOCK]):
            advice = "expected a new or an empty folder, or one of --learn"
            raise ModelError(f"holds other things ({min(other)}), {advice}", file=folder)
        return cls(OnlineModel(start, maze, options), folder, rig)

    @classmethod
    def opened(cls, folder: str | Path, maze: Maze, options: OnlineOptions | None = None, rig: str = "") -> Learner:
        """Go on with one that was kept. Raises InputError where it learned on another rig or map, ModelError."""
        return cls(open_learner(Path(folder), maze, rig, options), Path(folder), rig)

    @property
    def model(self) -> RigModel:
        """The model for the next run."""
        return self.online.model

    def learn(self, result: NavigationResult, ticks: Ticks) -> Lesson:
        """Learn from a run that has ended, and keep what was learned. Raises ModelError where it cannot be kept."""
        why = unfit(result, ticks)
        if why:
            lesson = self.online.skipped(why)
        else:
            try:
                lesson = self.online.learn(table_of(ticks.rows, f"run {self.online.now + 1}"), ticks.camera_delay)
            except InputError as problem:
                lesson = self.online.skipped(problem.problem)
        self.keep()
        return lesson

    def keep(self) -> None:
        """Write it where it is kept."""
        if self.folder is not None:
            keep_learner(self.online, self.folder, self.rig)


def learner_of(
    model: str | None, rig: str, maze: Maze, folder: Path | None, options: OnlineOptions | None = None
) -> Learner:
    """The learner for `--model`, `--rig` and `-o`: a learner in the folder goes on, else a new one begins. Raises
    InputError."""
    if folder is not None and (folder / ROWS).exists():
        if model is not None and Path(model).resolve() != folder.resolve():
            raise InputError(f"--model: got {model}, but what {folder} has learned so far goes on: leave --model out")
        return Learner.opened(folder, maze, options, rig_label(rig))
    return Learner.begin(resolve_model(model, rig, maze), maze, folder, options, rig_label(rig))


@contextmanager
def learning_alone(folder: Path | None) -> Iterator[None]:
    """Nobody else learns in the folder, which is made, meanwhile. Raises InputError where somebody does. A folder into
    which nothing was written is not left behind."""
    if folder is None:
        yield
        return
    made = not folder.exists()
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as problem:
        raise InputError(f"-o: got {folder}: {problem.strerror}; expected a folder that can be made") from None
    try:
        with alone(folder / LOCK, "-o", "learning"):
            yield
    finally:
        if not (folder / ROWS).exists():
            with suppress(OSError):
                (folder / LOCK).unlink(missing_ok=True)
                if made:
                    folder.rmdir()


def unfit(result: NavigationResult, ticks: Ticks) -> str:
    """Why nothing can be learned from a run; empty where it can."""
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


def learn_while(
    campaign: Campaign,
    learner: Learner,
    *,
    progress: Callable[[int], None] | None = None,
    tell: Callable[[Lesson], None] | None = None,
) -> tuple[list[NavigationResult], list[Lesson]]:
    """The results of a campaign in the order of its runs, and what each run taught; `progress(finished)` and `tell` are
    called after each. The runs are counted on from those that the learner has seen: what was interrupted goes on as if
    it had not been."""
    outcomes, lessons = [], []
    first = learner.online.now
    for index in range(campaign.runs):
        ticks = Ticks()
        outcomes.append(run_one(campaign, first + index, learner.model, ticks))
        lessons.append(learner.learn(outcomes[-1], ticks))
        if tell is not None:
            tell(lessons[-1])
        if progress is not None:
            progress(index + 1)
    return outcomes, lessons


def evaluate_learning(
    campaign: Campaign, folder: str | Path | None = None, options: OnlineOptions | None = None
) -> tuple[list[NavigationResult], list[Lesson]]:
    """`evaluate --learn` for Python: the campaign's model learns from each run; folder: where it is kept."""
    maze = campaign.maze()
    kept = None if folder is None else Path(folder)
    with learning_alone(kept):
        return learn_while(campaign, learner_of(campaign.model, campaign.rig, maze, kept, options))


def lesson_document(lesson: Lesson) -> dict[str, Any]:
    """The entry of a run in `evaluate --learn --json`; null without rows."""

    def rounded(value: float) -> float | None:
        return round(value, 5) if math.isfinite(value) else None

    return {
        "run": lesson.run, "rows": {f"ring{ring}": n for ring, n in lesson.rows.items()}, "impacts": lesson.impacts,
        "pace": lesson.pace, "why_not": lesson.why or None, "error_m_s2": rounded(lesson.error),
        "fixed_error_m_s2": rounded(lesson.fixed),
        "trusted": lesson.trusted,
    }  # fmt: skip


def lesson_line(lesson: Lesson) -> str:
    """The same for people; empty for a run from which the model learned as usual."""
    if lesson.why:
        return f"run {lesson.run}: not learned from: {lesson.why}"
    if not lesson.trusted:
        return (
            f"run {lesson.run}: what was learned has predicted the last runs worse than the model of the beginning "
            "did, which is therefore used"
        )
    return ""
