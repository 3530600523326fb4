"""The main job, for Python: `mazeplan.navigate(...)` finds map, rig and model by name and does one run."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager, nullcontext, suppress
from pathlib import Path

from mazeplan.attempt import run_job
from mazeplan.choices import check_start_angle, model_source, resolve_model, ring_number
from mazeplan.data.runlog import Take
from mazeplan.display import Display
from mazeplan.errors import InputError, RigError
from mazeplan.goals import Goals
from mazeplan.job import TIME_LIMIT, Job, Setup
from mazeplan.maze.geometry import Maze
from mazeplan.maze.mapfile import load_map
from mazeplan.maze.memory import load_memory, save_memory
from mazeplan.models.modelfile import RigModel
from mazeplan.physics.registry import own_effects
from mazeplan.records import NavigationResult
from mazeplan.rigs.interface import Rig, check_ready
from mazeplan.rigs.registry import make_rig, rig_label
from mazeplan.rigs.watchdog import watched
from mazeplan.settings import Settings, load_settings


def navigate(
    start: int | str = 1,
    goal: int | str | None = None,
    *,
    map: str | Path | Maze = "cme",  # the contract's option names
    rig: str | Rig = "toy",
    model: str | Path | RigModel | None = None,
    behavior: str = "navigate",
    behavior_modules: Sequence[str] = (),
    effects: str | None = None,
    settings: str | Path | Settings | None = None,
    start_angle_deg: float | None = None,
    closed: Sequence[str] = (),
    seed: int = 0,
    time_limit: float = TIME_LIMIT,
    log: str | Path | None = None,
    memory: str | Path | None = None,
    display: Display | None = None,
    goals: Goals | None = None,
    own_process: bool = False,
    guard: Callable[[Rig], AbstractContextManager[object]] | None = None,
    sense: str | None = None,
    feed: Take | None = None,
    around: Callable[[Rig], Rig] | None = None,
) -> NavigationResult:
    """Bring the ball from one ring to another and return what happened.

    start, goal: ring numbers (or "ring1"; None: the centre); rig: a packaged name, a YAML file, "module:Class", or a
    rig; model: packaged name or folder (None: the rig's own, else a packaged one of its name, else nominal physics);
    behavior: packaged tree or XML file; behavior_modules: names of modules with leaves that it uses beside the packaged
    ones; effects: "module:function" with effects of your own that the model has; settings: YAML file of costs, gains
    and windows, or Settings (None: the packaged ones); closed: names of openings not to be used; memory: file that
    keeps what happened at openings for the next run; seed: of start angle and simulated noise; time_limit: s of rig
    time for each goal, from when it was given; own_process: whether the watchdog may end the process where nothing else
    ends a leaf that hangs; goals: by which another thread gives other goals meanwhile, closes and opens openings, and
    stops; guard: entered with the rig around the run, such as an emergency stop; sense: how a simulated rig sees the
    ball, "ideal" or "camera": in rendered pictures (None: as its settings say); feed: called with topic, rig time and
    document of each message that a log would get, in the thread of the run; around: puts something around the rig that
    was made, such as the clock on the wall.
    Raises InputError for anything the user gave that cannot be used, RigError when the machine fails.
    """
    if start_angle_deg is not None and not math.isfinite(start_angle_deg):
        raise InputError(f"got {start_angle_deg}, expected a finite number of degrees", key="start angle")
    maze = map if isinstance(map, Maze) else load_map(map)
    known = [opening.name for opening in maze.openings]
    for name in closed:
        if name not in known:
            raise InputError(f"got {name!r}, expected one of {', '.join(known)}", key="closed opening")
    made = make_rig(rig, maze, sense) if isinstance(rig, str) else rig
    machine = watched(made if around is None else around(made), own_process=own_process)
    check_ready(machine)
    label = rig_label(rig) if isinstance(rig, str) else type(rig).__name__
    own_effects(effects)
    chosen = resolve_model(model, rig if isinstance(rig, str) else None, maze)
    job = Job(
        ring_number(start, maze),
        len(maze.rings) if goal is None else ring_number(goal, maze),
        None if start_angle_deg is None else math.radians(start_angle_deg),
        seed,
        time_limit,
        tuple(closed),
    )
    if start_angle_deg is not None:
        check_start_angle(start_angle_deg, job.start, maze, "start angle")
    how = settings if isinstance(settings, Settings) else load_settings(settings)
    kept = None if memory is None else load_memory(Path(memory), known)
    called = "" if isinstance(model, RigModel | None) else str(model)
    source = None if isinstance(model, RigModel) else model_source(model, rig if isinstance(rig, str) else None)
    setup = Setup(maze, chosen, behavior, label, called, how, tuple(behavior_modules), kept, source, effects=effects)
    try:
        with nullcontext() if guard is None else guard(machine):
            result = run_job(machine, setup, job, log=log, display=display, goals=goals, feed=feed)
    except BaseException:
        with suppress(RigError):  # what matters has been said
            machine.close()
        raise
    if kept is not None and memory is not None:
        save_memory(kept, Path(memory), result.time_s)
    try:
        machine.close()
    except RigError as error:  # what the run came to stands
        error.result = result
        raise
    return result
