"""`--learn` of `evaluate` and `navigate`: the model learns from the runs."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from mazeplan.cli.output import say
from mazeplan.errors import InputError

if TYPE_CHECKING:
    from mazeplan.evaluate import Campaign
    from mazeplan.learning import Learner, Lesson
    from mazeplan.maze.geometry import Maze
    from mazeplan.records import NavigationResult


def named_folder(text: str) -> Path:
    """The folder of a word on the command line; an empty one, such as a variable that was not set, is none."""
    if not text:
        raise InputError("-o: got '', expected a folder")
    return Path(text)


Learn = Annotated[bool, typer.Option("--learn", help="Let the model learn from each run, for the next one.")]
Kept = Annotated[
    Path | None,
    typer.Option(
        "-o",
        "--output",
        parser=named_folder,
        metavar="FOLDER",
        help="With --learn: folder of the model that learns; one that is there goes on.",
    ),
]


def check_learning(
    learn: bool, output: Path | None, workers: int | None = None, others: Mapping[str, object] | None = None
) -> None:
    """Raises InputError for what does not go together; others: what was given for further options, None for nothing."""
    if not learn:
        if output is not None:
            raise InputError("-o is for the model that learns: give --learn, too")
        return
    if workers is not None and workers > 1:
        problem = f"--workers: got {workers} with --learn, expected 1: each run needs what the one before it taught"
        raise InputError(problem)
    why = {
        "--faults": "nothing is learned from runs that are spoilt on purpose",
        "--dask": "each run needs what the one before it taught",
        "--store": "what is kept is the model that learns, with -o",
    }
    for name, given in (others or {}).items():
        if given is not None:
            raise InputError(f"--learn with {name}: {why[name]}; give one of them")


@contextmanager
def open_learner(model: str | None, rig: str, maze: Maze, output: Path | None) -> Iterator[Learner]:
    """The learner that is meant; checked before anything runs, and nobody else's meanwhile."""
    from mazeplan.cli.arguments import check_folder
    from mazeplan.learning import learner_of, learning_alone

    if output is not None:
        check_folder("-o", output)
    with learning_alone(output):
        yield learner_of(model, rig, maze, output)


def evaluate_learning(campaign: Campaign, output: Path | None) -> tuple[list[NavigationResult], dict[str, Any]]:
    """The results, and what `--json` tells of the learning."""
    from mazeplan.cli.progress import campaign_progress
    from mazeplan.learning import learn_while, lesson_document
    from mazeplan.maze.mapfile import load_map

    taught: list[Lesson] = []

    def told(lesson: Lesson) -> None:
        taught.append(lesson)
        tell(lesson)

    with open_learner(campaign.model, campaign.rig, load_map(campaign.map), output) as learner:
        try:
            with campaign_progress(campaign.runs) as advance:
                outcomes, lessons = learn_while(campaign, learner, progress=advance, tell=told)
        except KeyboardInterrupt:
            if output is not None:
                left = campaign.runs - len(taught)
                say(
                    f"{len(taught)} of {campaign.runs} runs are kept in {output}; --runs {left} goes on with the others"
                )
            raise
        say(_summary(taught, learner, output))
    kept = None if output is None else str(output)
    return outcomes, {"runs": [lesson_document(lesson) for lesson in lessons], "model": kept}


def _summary(lessons: Sequence[Lesson], learner: Learner, output: Path | None) -> str:
    rows, used = sum(sum(lesson.rows.values()) for lesson in lessons), sum(not lesson.why for lesson in lessons)
    where = "kept nowhere (-o FOLDER)" if output is None else f"{output}, {learner.online.now} runs so far"
    return f"learned from {rows} samples of {used} of {len(lessons)} runs: {where}"


def tell(lesson: Lesson) -> None:
    """Say on stderr what is not as usual."""
    from mazeplan.learning import lesson_line

    line = lesson_line(lesson)
    if line:
        say(line)


def navigate_learning(
    job: dict[str, Any], output: Path | None, drive: Callable[..., NavigationResult]
) -> NavigationResult:
    """One run by `drive(job, feed=...)`, of which the model in `output` then learns."""
    from mazeplan.learning import Ticks
    from mazeplan.models.modelfile import load_model

    if output is None:
        raise InputError("--learn needs -o FOLDER: where the model that learned is kept for the next run")
    ticks = Ticks()
    with open_learner(job["model"], job["rig"], job["map"], output) as learner:
        # to the last digit what is kept: a log can hold that
        model = load_model(output) if (output / "model.yaml").exists() else learner.model
        result = drive({**job, "model": model}, feed=ticks)
        lesson = learner.learn(result, ticks)
    tell(lesson)
    if not lesson.why:
        say(f"learned from {sum(lesson.rows.values())} samples: {output}, {lesson.run} runs so far")
    return result
