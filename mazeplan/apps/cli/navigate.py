"""`navigate`: one run; `view`: the page of a rig or of a log; `evaluate`: many runs, also on Dask or with faults."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from typer import Argument

from mazeplan.apps.cli import options as opt
from mazeplan.apps.cli.emergency import stop_key
from mazeplan.apps.cli.output import print_json, print_result, say
from mazeplan.apps.cli.progress import ProgressBar
from mazeplan.core.constants import TIME_LIMIT
from mazeplan.core.errors import InputError, RigError

if TYPE_CHECKING:
    from mazeplan.core.records import NavigationResult
    from mazeplan.run.request import Company, NavigationRequest

ViewedLog = Annotated[Path | None, Argument(metavar="LOG", help="Run log to show.")]
LEARNING_S = 120.0  # s of record: on rigs of eight kinds, a model of 600 s arrives at most 2 % sooner


def navigate(
    start: opt.StartRing = "ring1",
    goal: opt.GoalRing = "centre",
    map_: opt.Map = "cme",
    rig: opt.RigName = "toy",
    model: opt.Model = None,
    learn: opt.FirstModel = None,
    effects: opt.EffectModule = None,
    policy: opt.Policy = None,
    behavior: opt.Behavior = "navigate",
    behavior_module: opt.BehaviorModule = None,
    settings: opt.Settings = None,
    start_angle: opt.StartAngle = None,
    via: opt.Via = None,
    balls: opt.Balls = None,
    close: opt.Close = None,
    seed: opt.Seed = 0,
    time_limit: opt.TimeLimit = TIME_LIMIT,
    log: opt.RunLog = None,
    video: opt.Video = None,
    view: opt.Page = False,
    port: opt.PagePort = opt.PORT,
    force: opt.Force = False,
    as_json: opt.AsJson = False,
) -> None:
    """Bring the ball from one ring to another."""
    from mazeplan.run.request import Company, NavigationRequest

    if learn is not None:
        if model is not None:
            raise InputError("--learn with --model: give one of them")
        learn_first(learn, rig, map_, seed, force)
        model = str(learn)
    request = NavigationRequest(
        start, goal, map_, rig, model, policy, behavior, tuple(behavior_module or ()), effects, settings, start_angle,
        opt.listed(close), opt.listed(via), balls, seed, time_limit, log,
    )  # fmt: skip
    if video is not None and view:
        raise InputError("--video with --view: give one of them")
    if view:
        from mazeplan.apps.cli.live import navigate_live

        sys.exit(navigate_live(request, port, as_json=as_json))
    try:
        with filmed(video) as camera:
            result = navigate_once(request, Company(**camera))
    except RigError as problem:
        if as_json and problem.result is not None:
            print_json(problem.result.json())
        raise
    if as_json:
        print_json(result.json())
    sys.exit(0 if result.success else 1)


def learn_first(folder: Path, rig: str, map_: str, seed: int, force: bool) -> None:
    """Learn a model of the rig into a folder, from LEARNING_S of record, unless the folder holds a model.

    Raises InputError, TableError, RigError."""
    from mazeplan.apps.cli.learning import collect
    from mazeplan.maze.mapfile import load_map
    from mazeplan.rigs.registry import make_rig
    from mazeplan.run.commands.learn import learn

    log = folder / "record.mcap"
    if (folder / "model.yaml").exists():
        return
    if not log.exists():
        opt.check_new("--learn", folder, force)
        make_rig(rig, load_map(map_))  # a wrong name is refused before anything is written
        folder.mkdir(parents=True, exist_ok=True)
        collect(log, rig, LEARNING_S, map_, rings=True, place=True, seed=seed)
    with ProgressBar("learning") as bar:
        learned = learn([log], folder, kind="pi", progress=bar.show, advance=bar.advance)
    say(f"{learned.learned.judgement.words()}; wrote {folder}")


@contextmanager
def filmed(path: Path | None) -> Iterator[dict[str, Any]]:
    """Arguments that let a run be filmed. The film is written when the run is over, however it ended."""
    if path is None:
        yield {}
        return
    from mazeplan.apps.view.film import write_film

    messages: list[tuple[str, dict[str, Any]]] = []
    try:
        yield {"feed": lambda topic, t, document: messages.append((topic, document))}
    finally:
        if any(topic == "/tick" for topic, _ in messages):
            with ProgressBar("filming", compiles=False):
                write_film(messages, path)
            say(f"wrote {path}")


def note_missing_model(rig: str, model: str | None) -> None:
    """Print how well the model fits its machine, or a note if the run has no fitted model and uses nominal physics.

    Raises InputError for a rig or a model that does not exist."""
    from mazeplan.learning.modelfile import load_model, model_names
    from mazeplan.learning.rig_model import fits_words
    from mazeplan.rigs.registry import rig_model_hint

    if model is not None:
        if words := fits_words(load_model(model)):
            say(f"model {model}: {words}")
    elif rig not in model_names() and rig_model_hint(rig) is None:
        say(f"no model for rig {rig}: using nominal physics; fit a model with `mazeplan collect` and `learn`")


def navigate_once(request: NavigationRequest, company: Company) -> NavigationResult:
    """Run one request of the command line and show its progress on the terminal. A key stops a real rig."""
    from mazeplan.apps.cli.progress import NavigationProgress, report_compiling
    from mazeplan.run.execution import execute
    from mazeplan.run.goals import Goals

    goals, progress = company.goals or Goals(request.maze), NavigationProgress(str(request.rig))

    @contextmanager
    def guard(machine: Any) -> Iterator[None]:
        note_missing_model(str(request.rig), None if request.model is None else str(request.model))
        with stop_key(machine, goals.stop):
            yield

    report_compiling()
    try:
        result = execute(request, replace(company, own_process=True, goals=goals, guard=guard, display=progress))
    except RigError as problem:
        if problem.result is not None and problem.result.success:  # the ball arrived, then the rig failed
            progress.finished(problem.result)
        raise
    progress.finished(result)
    return result


def view(
    log: ViewedLog = None,
    map_: opt.Map = "cme",
    rig: opt.RigName = "toy",
    model: opt.Model = None,
    behavior: opt.Behavior = "navigate",
    time_limit: opt.TimeLimit = TIME_LIMIT,
    port: opt.PagePort = opt.PORT,
) -> None:
    """Open the page in the browser: operate a rig, or show a recorded run. Ctrl-C closes it.

    `navigate --view` has more options."""
    if log is not None:
        from mazeplan.apps.view.replay import open_recording, show_log

        with ProgressBar("reading") as bar:
            bar.show(log.name)
            recording = open_recording(log)
        show_log(recording, port)
        return
    from mazeplan.apps.cli.live import navigate_live
    from mazeplan.run.request import NavigationRequest

    request = NavigationRequest(map=map_, rig=rig, model=model, behavior=behavior, time_limit=time_limit)
    sys.exit(navigate_live(request, port, begin=False))


def evaluate(
    runs: opt.Runs = None,
    rig: opt.RigName = "toy",
    map_: opt.Map = "cme",
    model: opt.Model = None,
    effects: opt.EffectModule = None,
    policy: opt.Policy = None,
    behavior: opt.Behavior = "navigate",
    behavior_module: opt.BehaviorModule = None,
    settings: opt.Settings = None,
    start: opt.StartRing = "ring1",
    goal: opt.GoalRing = "centre",
    balls: opt.Balls = None,
    seed: opt.Seed = 0,
    time_limit: opt.TimeLimit = TIME_LIMIT,
    workers: opt.Workers = None,
    dask: opt.Dask = None,
    store: opt.Store = None,
    no_deadline: opt.NoDeadline = False,
    faults: opt.Faults = None,
    compare: opt.Compare = None,
    report: opt.Report = None,
    force: opt.Force = False,
    as_json: opt.AsJson = False,
) -> None:
    """Run many navigations and summarise success, times and failures; with --faults also the response to each fault."""
    if compare is not None:
        _compare(compare, as_json)
        return
    from mazeplan.apps.report.inputs import Input
    from mazeplan.apps.report.page import section_text
    from mazeplan.apps.report.runs import evaluation_section
    from mazeplan.maze.mapfile import load_map
    from mazeplan.rigs.registry import make_rig
    from mazeplan.run.assembly import with_balls
    from mazeplan.run.commands.evaluate import evaluate as run_all

    make_rig(rig, with_balls(load_map(map_), balls))
    note_missing_model(rig, model)
    with ProgressBar("runs", transient=False) as bar:
        done = run_all(
            runs, rig=rig, map=map_, model=model, effects=effects, policy=policy, behavior=behavior,
            behavior_modules=behavior_module or (), settings=settings, start=start, goal=goal, balls=balls, seed=seed,
            time_limit=time_limit, workers=workers, dask=dask, store=store, deadline=not no_deadline, faults=faults,
            own_process=True, say=bar.note, advance=bar.advance,
        )  # fmt: skip
    if report is not None:
        say(f"wrote {done.report(report)}")
    name = done.document["setup"]["rig"] + (" with faults" if faults else "")
    section = evaluation_section(Input("evaluation", Path(name), name, done.json()))
    print_result(as_json, done.document, section_text(section))
    sys.exit(_exit_status(done.document))


def _compare(files: tuple[Path, Path], as_json: bool) -> None:
    from mazeplan.apps.report.inputs import read_document
    from mazeplan.run.campaign.pairs import paired

    a, b = (read_document(file, "the JSON of evaluate") for file in files)
    done = paired(a, b, (str(files[0]), str(files[1])))
    print_result(as_json, done.document, done.sentence)


def _exit_status(document: dict[str, Any]) -> int:
    """0 if all runs arrived, or with faults if all faults ended as they should.

    Raises RigError if a rig failed in a campaign without faults."""
    from mazeplan.core.errors import RigError
    from mazeplan.core.records import FailureKind
    from mazeplan.run.commands.evaluate import good

    if "faults" in document:
        return 0 if good(document["faults"]) else 1
    failures = (failure for result in document["results"] for failure in result["failures"])
    failed = next((failure for failure in failures if failure["kind"] == FailureKind.RIG_FAILED.value), None)
    if failed is not None:
        raise RigError(failed["words"])
    return 0 if document["success"] == document["runs"] else 1
