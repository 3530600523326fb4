"""`evaluate --learn`: update the model from the runs."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mazeplan.apps.cli.output import say
from mazeplan.core.errors import InputError

if TYPE_CHECKING:
    from mazeplan.core.records import NavigationResult
    from mazeplan.maze.geometry import Maze
    from mazeplan.run.campaign.evaluate import Campaign
    from mazeplan.run.campaign.online_learning import Learner, Lesson

EXCLUDED = {
    "--faults": "faulty runs must not teach the model",
    "--dask": "each run needs the model of the run before it",
    "--store": "-o keeps the model",
}


def check_learning(
    learn: bool, output: Path | None, workers: int | None = None, others: Mapping[str, object] | None = None
) -> None:
    """Raises InputError for options that exclude each other. others: {option in EXCLUDED: its value, or None}"""
    if output is not None and not learn:
        raise InputError("-o: got a folder without --learn, expected both: -o keeps the model that the runs teach")
    if learn and workers is not None and workers > 1:
        raise InputError(f"--workers: got {workers} with --learn, expected 1: {EXCLUDED['--dask']}")
    for name, value in (others or {}).items():
        if learn and value is not None:
            raise InputError(f"--learn with {name}: {EXCLUDED[name]}; give one of them")


@contextmanager
def open_learner(model: str | None, rig: str, maze: Maze, output: Path | None) -> Iterator[Learner]:
    """The learner for these options. Meanwhile no other process can learn in its folder. Raises InputError."""
    from mazeplan.run.campaign.online_learning import learner_of, learning_alone

    with learning_alone(output):
        yield learner_of(model, rig, maze, output)


def evaluate_learning(campaign: Campaign, output: Path | None) -> tuple[list[NavigationResult], dict[str, Any]]:
    """Run a campaign that learns. Returns the results of its runs, and the entry `learning` of its document."""
    from mazeplan.apps.cli.progress import campaign_progress
    from mazeplan.run.campaign.online_learning import learn_while, lesson_document

    done: list[Lesson] = []

    def on_lesson(lesson: Lesson) -> None:
        done.append(lesson)
        _report(lesson)

    with open_learner(campaign.model, campaign.rig, campaign.maze(), output) as learner:
        try:
            with campaign_progress(campaign.runs) as advance:
                outcomes, lessons = learn_while(campaign, learner, progress=advance, tell=on_lesson)
        except KeyboardInterrupt:
            if output is not None:
                kept, left = f"{len(done)} of {campaign.runs} runs are kept in {output}", campaign.runs - len(done)
                say(f"{kept}; --runs {left} continues with the others")
            raise
        say(_summary(done, learner, output))
    kept = None if output is None else str(output)
    return outcomes, {"runs": [lesson_document(lesson) for lesson in lessons], "model": kept}


def _summary(lessons: Sequence[Lesson], learner: Learner, output: Path | None) -> str:
    rows, used = sum(sum(lesson.rows.values()) for lesson in lessons), sum(not lesson.why for lesson in lessons)
    where = "not kept (give -o FOLDER)" if output is None else f"{output}, {learner.online.now} runs so far"
    return f"learned from {rows} samples of {used} of {len(lessons)} runs: {where}"


def _report(lesson: Lesson) -> None:
    """Print a message if a run taught nothing or made the model worse."""
    from mazeplan.run.campaign.online_learning import lesson_line

    if line := lesson_line(lesson):
        say(line)
