"""One navigation with its progress on the terminal, and the note about a missing model."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mazeplan.apps.cli.output import say

if TYPE_CHECKING:
    from mazeplan.core.records import NavigationResult
    from mazeplan.maze.geometry import Maze


def navigation_job(
    start: str, goal: str, map_: str, rig: str, model: str | None, balls: int | None = None, *, sense: str | None,
    log: Path | None = None, **more: Any,
) -> dict[str, Any]:  # fmt: skip
    """Arguments of `mazeplan.navigate` from options of the command line. more: further arguments, unchanged"""
    from mazeplan.maze.mapfile import load_map
    from mazeplan.run.balls import with_balls

    maze = with_balls(load_map(map_), balls)
    note_missing_model(rig, model, maze, sense)
    given = {"start": start, "goal": goal, "map": maze, "rig": rig, "model": model}
    return {**given, "sense": sense, "log": log, **more}


def note_missing_model(rig: str, model: str | None, maze: Maze, sense: str | None = None) -> None:
    """Print how well the model fits its machine, or a note if the run has no fitted model and uses nominal physics.

    Raises InputError or RigError for a rig that cannot be made, and for a model that does not exist."""
    from mazeplan.learning.fits import fits_words
    from mazeplan.learning.modelfile import load_model, model_names, model_path
    from mazeplan.rigs.registry import make_rig, rig_model_hint, warn_of_idle_keys

    make_rig(rig, maze, sense)
    warn_of_idle_keys(rig)
    if model is not None:
        model_path(model)
        if words := fits_words(load_model(model)):
            say(f"model {model}: {words}")
    if model is None and rig not in model_names() and rig_model_hint(rig) is None:
        say(f"no model for rig {rig}: using nominal physics; fit a model with `mazeplan collect` and `learn`")


def navigate_once(job: dict[str, Any], **more: Any) -> NavigationResult:
    """Run one job and show its progress on the terminal.

    more: further arguments of `mazeplan.navigate`; without `goals` among them, a key stops a real rig"""
    from mazeplan.apps.cli.emergency import stop_key
    from mazeplan.apps.cli.progress import NavigationProgress
    from mazeplan.core.errors import RigError
    from mazeplan.run.goals import Goals
    from mazeplan.run.navigate import navigate

    if "goals" not in more:
        goals = Goals(job["map"])
        more = {**more, "goals": goals, "guard": lambda machine: stop_key(machine, goals.stop)}
    with NavigationProgress() as progress:
        try:
            result = navigate(**job, **more, display=progress, own_process=True)
        except RigError as problem:
            if problem.result is not None and problem.result.success:  # the ball arrived, then the rig failed
                progress.finished(problem.result)
            raise
        progress.finished(result)
    if result.reason == "failed" and not result.failures:
        tree = shlex.quote(str(job["behavior"]))
        say(f"the tree ended by itself, and nothing went wrong with the ball: mazeplan behavior check {tree}")
    return result
