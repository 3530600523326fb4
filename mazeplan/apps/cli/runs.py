"""One navigation with its progress on the terminal, and the note about a missing model."""

from __future__ import annotations

import shlex
from dataclasses import replace
from typing import TYPE_CHECKING

from mazeplan.apps.cli.output import say

if TYPE_CHECKING:
    from pathlib import Path

    from mazeplan.core.records import NavigationResult
    from mazeplan.learning.modelfile import RigModel
    from mazeplan.run.request import Company, NavigationRequest


def note_missing_model(rig: str, model: str | Path | RigModel | None) -> None:
    """Print how well the model fits its machine, or a note if the run has no fitted model and uses nominal physics.

    Raises InputError for a rig or a model that does not exist."""
    from mazeplan.learning.fits import fits_words
    from mazeplan.learning.modelfile import RigModel, load_model, model_names, model_path
    from mazeplan.rigs.registry import rig_model_hint

    if isinstance(model, RigModel):  # the command has learned it
        return
    if model is not None:
        model_path(model)
        if words := fits_words(load_model(model)):
            say(f"model {model}: {words}")
    if model is None and rig not in model_names() and rig_model_hint(rig) is None:
        say(f"no model for rig {rig}: using nominal physics; fit a model with `mazeplan collect` and `learn`")


def navigate_once(request: NavigationRequest, company: Company) -> NavigationResult:
    """Run one request and show its progress on the terminal. Without `goals` in its company, a key stops a real rig."""
    from mazeplan.apps.cli.emergency import stop_key
    from mazeplan.apps.cli.progress import NavigationProgress
    from mazeplan.core.errors import RigError
    from mazeplan.run.goals import Goals
    from mazeplan.run.navigate import execute

    if company.goals is None:
        goals = Goals(request.maze)
        company = replace(company, goals=goals, guard=lambda machine: stop_key(machine, goals.stop))
    company = replace(company, own_process=True)
    ready = request.resolve(company)
    note_missing_model(str(request.rig), request.model)
    with NavigationProgress() as progress:
        try:
            result = execute(request, ready, replace(company, display=progress))
        except RigError as problem:
            if problem.result is not None and problem.result.success:  # the ball arrived, then the rig failed
                progress.finished(problem.result)
            raise
        progress.finished(result)
    if result.reason == "failed" and not result.failures:
        tree = shlex.quote(request.behavior)
        say(f"the tree ended by itself, and nothing went wrong with the ball: mazeplan behavior check {tree}")
    return result
