"""Navigations one after the other with a model that learns from each: `evaluate --learn`, `navigate --learn`.

    learner = Learner.begin(model, maze)        # or Learner.opened(folder, maze) for a stored learner
    outcomes = learn_while(campaign, learner)   # runs in order, each with the model learned from the runs before it

The folder of a stored learner (`-o`) is a model folder that every `--model` takes. Beside model.yaml it holds the first
model, `start/`, and the rows learned since then, `learning.npz`.
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
from mazeplan.run.campaign.lock import exclusive_lock
from mazeplan.run.resolve import resolve_model

LOCK = ".learning.lock"
SEEN = 0.8  # minimum share of the ticks in which the ball was seen
BAD = (FailureKind.RIG_FAILED, FailureKind.BALL_LOST, FailureKind.BALL_OUT, FailureKind.LEAF_FAILED)


@dataclass
class Ticks:
    """Collects the ticks of a run while it goes on; pass it to `navigate` or `run_one` as `feed`."""

    rows: list[dict[str, Any]] = field(default_factory=list)
    camera_delay: float | None = None  # s, as measured on the rig; None: not measured

    def __call__(self, topic: str, t: float, document: Mapping[str, Any]) -> None:
        """Take a message of the run."""
        if topic == "/tick":
            self.rows.append(dict(document))
        elif topic == "/header":
            latency = document["replay"].get("latency")
            self.camera_delay = None if latency is None else float(latency["camera_s"])


@dataclass
class Learner:
    """A model that learns. folder: where it is stored, None: nowhere; rig: name of the rig on which it learns."""

    online: OnlineModel
    folder: Path | None = None
    rig: str = ""

    @classmethod
    def begin(
        cls, start: RigModel, maze: Maze, folder: str | Path | None = None, options: OnlineOptions | None = None,
        rig: str = "",
    ) -> Learner:  # fmt: skip
        """A new learner that begins with the model `start`, on the rig named `rig`.

        Raises InputError if the model cannot learn, ModelError if the folder holds another model or other files."""
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
        """The learner stored in a folder. Raises InputError if it learned on another rig or map, ModelError."""
        return cls(open_learner(Path(folder), maze, rig, options), Path(folder), rig)

    @property
    def model(self) -> RigModel:
        """The model for the next run."""
        return self.online.model

    def learn(self, result: NavigationResult, ticks: Ticks) -> Lesson:
        """Learn from a run that has ended, and store the learner. Raises ModelError if it cannot be stored."""
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
        """Store the learner in its folder, if it has one."""
        if self.folder is not None:
            keep_learner(self.online, self.folder, self.rig)


def learner_of(
    model: str | None, rig: str, maze: Maze, folder: Path | None, options: OnlineOptions | None = None
) -> Learner:
    """The learner for `--model`, `--rig` and `-o`: the one stored in the folder, else a new one. Raises InputError."""
    if folder is not None and (folder / ROWS).exists():
        if model is not None and Path(model).resolve() != folder.resolve():
            raise InputError(f"--model: got {model}, but what {folder} has learned so far goes on: leave --model out")
        return Learner.opened(folder, maze, options, rig_label(rig))
    return Learner.begin(resolve_model(model, rig, maze), maze, folder, options, rig_label(rig))


@contextmanager
def learning_alone(folder: Path | None) -> Iterator[None]:
    """A context in which no other process learns in the folder. It makes the folder, and removes it if nothing was
    written into it. Raises InputError if another process learns there."""
    if folder is None:
        yield
        return
    made = not folder.exists()
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as problem:
        raise InputError(f"-o: got {folder}: {problem.strerror}; expected a folder that can be made") from None
    try:
        with exclusive_lock(folder / LOCK, "-o", "learning"):
            yield
    finally:
        if not (folder / ROWS).exists():
            with suppress(OSError):
                (folder / LOCK).unlink(missing_ok=True)
                if made:
                    folder.rmdir()


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


def learn_while(
    campaign: Campaign,
    learner: Learner,
    *,
    progress: Callable[[int], None] | None = None,
    tell: Callable[[Lesson], None] | None = None,
) -> tuple[list[NavigationResult], list[Lesson]]:
    """The results of a campaign in the order of its runs, and the lesson of each run.

    progress: is called with the number of finished runs after each run
    tell: is called with the lesson after each run

    The numbers of the runs go on from the runs that the learner has seen. So an interrupted campaign goes on as if it
    had not been interrupted."""
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
    """`evaluate --learn` for Python: the campaign's model learns from each run. folder: where the learner is stored."""
    maze = campaign.maze()
    kept = None if folder is None else Path(folder)
    with learning_alone(kept):
        return learn_while(campaign, learner_of(campaign.model, campaign.rig, maze, kept, options))


def lesson_document(lesson: Lesson) -> dict[str, Any]:
    """The entry of a run in `evaluate --learn --json`; errors are null if there are no rows."""

    def rounded(value: float) -> float | None:
        return round(value, 5) if math.isfinite(value) else None

    return {
        "run": lesson.run, "rows": {f"ring{ring}": n for ring, n in lesson.rows.items()}, "impacts": lesson.impacts,
        "pace": lesson.pace, "why_not": lesson.why or None, "error_m_s2": rounded(lesson.error),
        "fixed_error_m_s2": rounded(lesson.fixed),
        "trusted": lesson.trusted,
    }  # fmt: skip


def lesson_line(lesson: Lesson) -> str:
    """A lesson as a line for people; empty for a run from which the model learned as usual."""
    if lesson.why:
        return f"run {lesson.run}: not learned from: {lesson.why}"
    if not lesson.trusted:
        return (
            f"run {lesson.run}: what was learned has predicted the last runs worse than the model of the beginning "
            "did, which is therefore used"
        )
    return ""
