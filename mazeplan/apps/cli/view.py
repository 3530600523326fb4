"""`view`: the page of a rig, of recorded runs, or of a map to edit."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

from typer import Argument, Context, Option

from mazeplan.apps.cli import options as opt
from mazeplan.apps.cli.option_checks import given_options
from mazeplan.core.errors import InputError

ViewLogs = Annotated[
    list[Path] | None,
    Argument(metavar="LOG [OTHER]", help="Show a run log, or two side by side. With --edit: the map to edit."),
]
Edit = Annotated[bool, Option("--edit", help="Edit a map on the page, cme if none is given; move no rig.")]


def view(
    ctx: Context,
    logs: ViewLogs = None,
    start: opt.StartRing = "ring1",
    goal: opt.GoalRing = "centre",
    map_: opt.Map = "cme",
    rig: opt.RigName = "toy",
    model: opt.Model = None,
    behavior: opt.Behavior = "navigate",
    behavior_module: opt.BehaviorModule = None,
    settings: opt.Settings = None,
    seed: opt.Seed = 0,
    time_limit: opt.TimeLimit = 20.0,
    sense: opt.Sense = None,
    host: opt.Host = opt.HOST,
    port: opt.PagePort = opt.PORT,
    edit: Edit = False,
) -> None:
    """Open the page in the browser: operate a rig, show recorded runs, or edit a map. Ctrl-C closes it."""
    if logs or edit:
        from mazeplan.apps.cli.progress import ProgressBar
        from mazeplan.apps.view.serving import edit_map, open_logs, show_logs

        given = given_options(ctx)
        for option in sorted(given - {"logs", "--edit", "--host", "--port"} - ({"--map"} if edit else set())):
            raise InputError(f"has no effect {'with --edit' if edit else 'beside a log'}: leave it out", key=option)
        if edit:
            edit_map(_map_to_edit(logs or [], map_ if "--map" in given else None), host, port)
            return
        _check_logs(logs or [])
        with ProgressBar("reading") as bar:
            runs = open_logs(logs or [], bar.show)
        show_logs(runs, host, port)
        return
    from mazeplan.apps.cli.live import navigate_live
    from mazeplan.apps.cli.runs import navigation_job

    job = navigation_job(
        start, goal, map_, rig, model, sense=sense, behavior=behavior, behavior_modules=tuple(behavior_module or ()),
        settings=settings, seed=seed, time_limit=time_limit,
    )  # fmt: skip
    sys.exit(navigate_live(job, host, port, begin=False))


def _map_to_edit(given: list[Path], map_: str | None) -> str:
    """The map to edit: the argument, or the map of --map, otherwise cme. Raises InputError for several, or a log."""
    if len(given) + (map_ is not None) > 1:
        names = ", ".join(map(str, [*given, *([] if map_ is None else [map_])]))
        raise InputError(f"--edit: got {names}, expected one map")
    if given and given[0].suffix.lower() == opt.RUN_LOG:
        raise InputError(f"--edit: got {given[0]}, a log, expected a map; to see the log, leave out --edit")
    return str(given[0]) if given else map_ or "cme"


def _check_logs(given: list[Path]) -> None:
    """Raises InputError for a map where a log is expected."""
    for path in given:
        if path.suffix.lower() in opt.YAML:
            problem = f"got a YAML file, expected a run log; to edit a map: mazeplan view --edit {path}"
            raise InputError(problem, file=path)
