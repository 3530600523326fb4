"""`navigate` and `evaluate`."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from mazeplan.cli.arguments import BehaviorModule, EffectModule
from mazeplan.cli.campaign import DaskAddress, NoDeadline, StoreFolder, Workers, evaluate_all
from mazeplan.cli.learning import Kept, Learn, check_learning, evaluate_learning, navigate_learning
from mazeplan.cli.output import print_json, say
from mazeplan.cli.viewoptions import HOST, PORT, Host, PagePort

if TYPE_CHECKING:
    from mazeplan.maze.geometry import Maze
    from mazeplan.records import NavigationResult

Map = Annotated[str, typer.Option("--map", help="Packaged map or YAML file.")]
RigName = Annotated[str, typer.Option("--rig", help="Name of a rig (rig list), YAML file, or module:Class.")]
Model = Annotated[str | None, typer.Option("--model", help="Packaged model or folder; default: the rig's own.")]
Behavior = Annotated[str, typer.Option("--behavior", help="Packaged behaviour tree or XML file.")]
HowFile = Annotated[str | None, typer.Option("--settings", help="YAML file of costs, gains and windows.")]
From = Annotated[str, typer.Option("--from", help="Ring to start in, such as ring1.")]
To = Annotated[str, typer.Option("--to", help="Ring to reach, such as ring5; default: the centre.")]
Seed = Annotated[int, typer.Option("--seed", min=0, help="Seed of start angle and simulated noise.")]
FirstSeed = Annotated[
    int,
    typer.Option("--seed", min=0, help="Seed of the first run's noise; start angles: 16 evenly spread, then drawn."),
]
Sense = Annotated[
    str | None,
    typer.Option("--sense", help="How a simulated rig sees the ball: ideal, or camera: in rendered pictures."),
]
TimeLimit = Annotated[float, typer.Option("--time-limit", help="Limit in s of rig time.")]
RUNS, FAULT_RUNS = 16, 10
Json = Annotated[bool, typer.Option("--json", help="Print one JSON document on stdout.")]


def navigate(
    start: From = "ring1",
    goal: To = "centre",
    map_: Map = "cme",
    rig: RigName = "toy",
    model: Model = None,
    effects: EffectModule = None,
    behavior: Behavior = "navigate",
    behavior_module: BehaviorModule = None,
    settings: HowFile = None,
    start_angle: Annotated[
        float | None, typer.Option("--start-angle", help="Start angle in deg; default: by seed.")
    ] = None,
    close: Annotated[list[str] | None, typer.Option("--close", help="Opening not to be used; repeatable.")] = None,
    seed: Seed = 0,
    time_limit: TimeLimit = 20.0,
    log: Annotated[Path | None, typer.Option("--log", help="Write a run log (MCAP).")] = None,
    memory: Annotated[
        Path | None, typer.Option("--memory", help="File that keeps what happened at openings for the next run.")
    ] = None,
    learn: Learn = False,
    output: Kept = None,
    sense: Sense = None,
    view: Annotated[bool, typer.Option("--view", help="Show and operate it on a page in the browser.")] = False,
    host: Host = HOST,
    port: PagePort = PORT,
    as_json: Json = False,
) -> None:
    """Bring the ball from one ring to another."""
    from mazeplan.cli.arguments import finite, positive
    from mazeplan.errors import InputError, RigError
    from mazeplan.maze.mapfile import load_map

    maze = load_map(map_)
    note_missing_model(rig, model, maze, sense)
    angle = None if start_angle is None else finite("--start-angle", start_angle, "degrees")
    job = {
        "start": start, "goal": len(maze.rings) if goal == "centre" else goal, "map": maze, "rig": rig, "model": model,
        "effects": effects, "behavior": behavior, "behavior_modules": tuple(behavior_module or ()),
        "settings": settings, "start_angle_deg": angle, "closed": close or (), "seed": seed,
        "time_limit": positive("--time-limit", time_limit), "log": log, "memory": memory, "sense": sense,
    }  # fmt: skip
    check_learning(learn, output)
    if view:
        from mazeplan.cli.live import navigate_live

        if learn:
            raise InputError("--learn with --view: a run on the page may go on for ever; give one of them")

        sys.exit(navigate_live(job, host, port, as_json=as_json))
    try:
        result = navigate_learning(job, output, navigate_once) if learn else navigate_once(job)
    except RigError as problem:  # the line that says so comes on top of what happened until then
        if as_json and problem.result is not None:
            print_json(problem.result.to_json())
        raise
    if as_json:
        print_json(result.to_json())
    sys.exit(0 if result.success else 1)


def navigate_once(job: dict[str, Any], **more: Any) -> NavigationResult:
    """One run of a job in the words of `mazeplan.navigate`, shown on the terminal; `more` comes on top. Without goals
    among them a key stops a rig of wood and wire."""
    from mazeplan.cli.emergency import stop_key
    from mazeplan.cli.progress import NavigationProgress
    from mazeplan.errors import RigError
    from mazeplan.goals import Goals
    from mazeplan.navigation import navigate as run

    if "goals" not in more:
        goals = Goals(job["map"])
        more = {**more, "goals": goals, "guard": lambda machine: stop_key(machine, goals.stop)}
    with NavigationProgress() as progress:
        try:
            result = run(**job, **more, display=progress, own_process=True)
        except RigError as problem:
            if problem.result is not None and problem.result.success:  # it arrived, and failed when all was done
                progress.finished(problem.result)
            raise
        progress.finished(result)
    return result


def evaluate(
    runs: Annotated[
        int | None, typer.Option("--runs", min=1, help="How many navigations: 16; with --faults 10 for each.")
    ] = None,
    rig: RigName = "toy",
    map_: Map = "cme",
    model: Model = None,
    effects: EffectModule = None,
    behavior: Behavior = "navigate",
    behavior_module: BehaviorModule = None,
    settings: HowFile = None,
    start: From = "ring1",
    goal: To = "centre",
    seed: FirstSeed = 0,
    time_limit: TimeLimit = 20.0,
    workers: Workers = None,
    dask: DaskAddress = None,
    store: StoreFolder = None,
    no_deadline: NoDeadline = False,
    faults: Annotated[
        str | None, typer.Option("--faults", help="YAML file of what is to go wrong, or all: each kind in turn.")
    ] = None,
    learn: Learn = False,
    output: Kept = None,
    sense: Sense = None,
    report: Annotated[Path | None, typer.Option("--report", help="HTML file with pictures of it.")] = None,
    as_json: Json = False,
) -> None:
    """Many navigations: success, times, failures; with --faults what is noticed and got over."""
    from mazeplan.cli.arguments import positive
    from mazeplan.cli.report import check_page, write_report
    from mazeplan.errors import RigError
    from mazeplan.evaluate import Campaign, setup_document, summary
    from mazeplan.maze.mapfile import load_map
    from mazeplan.records import FailureKind

    if report is not None:
        check_page("--report", report)
    check_learning(learn, output, workers, {"--faults": faults, "--dask": dask, "--store": store})
    maze = load_map(map_)
    note_missing_model(rig, model, maze, sense)
    to = len(maze.rings) if goal == "centre" else goal
    limit = positive("--time-limit", time_limit)
    modules = tuple(behavior_module or ())
    count = runs or (RUNS if faults is None else FAULT_RUNS)
    campaign = Campaign(
        count, rig, map_, model, behavior, start, to, seed, limit, settings, modules, True, sense, not no_deadline,
        effects,
    )  # fmt: skip
    if faults is not None:
        from mazeplan.cli.faults import evaluate_faulty

        sys.exit(evaluate_faulty(campaign, faults, workers, dask, store, as_json, report))
    taught: dict[str, Any] = {}
    if learn:
        outcomes, taught["learning"] = evaluate_learning(campaign, output)
    else:
        outcomes = evaluate_all(campaign, workers, dask, store)
    document = {**summary(outcomes), "setup": setup_document(campaign), **taught}
    if report is not None:
        write_report("evaluation", document, report, document["setup"]["rig"])
    if as_json:
        print_json(document)
    else:
        print_summary(document)
    failed = next((f for outcome in outcomes for f in outcome.failures if f.kind is FailureKind.RIG_FAILED), None)
    if failed is not None:
        raise RigError(failed.detail)
    sys.exit(0 if document["success"] == count else 1)


def note_missing_model(rig: str, model: str | None, maze: Maze, sense: str | None = None) -> None:
    """Tell the user when textbook physics stand in for a fitted model: no camera delay, no tilt of the table.

    Nothing is said of a rig that cannot be made; that is an error of its own, raised here."""
    from mazeplan.models.modelfile import model_names
    from mazeplan.rigs.registry import make_rig, rig_model_hint

    make_rig(rig, maze, sense)
    if model is None and rig not in model_names() and rig_model_hint(rig) is None:
        say(f"no model for rig {rig}: nominal physics stand in for it; fit one with `mazeplan collect` and `learn`")


def print_summary(document: dict) -> None:
    """A few lines for people."""
    times = document["time_s"]
    print(f"arrived       {document['success']} of {document['runs']}")
    if times["mean"] is not None:
        print(
            "time          " + ", ".join(f"{key} {times[key]:.2f} s" for key in ("mean", "best", "p50", "p95", "worst"))
        )
    failures = document["failures"]
    print("failures      " + (", ".join(f"{kind} {count}" for kind, count in failures.items()) or "none"))
    for key, label in (("planner_ms", "planner"), ("tick_ms", "tick")):
        figures = document[key]
        print(f"{label:13s} p50 {figures['p50']:.2f} ms, p99 {figures['p99']:.2f} ms, max {figures['max']:.2f} ms")
