"""From what a user names to what is meant: rings, and the model that goes with a rig."""

from __future__ import annotations

from pathlib import Path

from mazeplan.errors import InputError
from mazeplan.maze.geometry import Maze
from mazeplan.models.modelfile import RigModel, load_model, model_names
from mazeplan.rigs.registry import rig_model_hint


def ring_number(ring: int | str, maze: Maze) -> int:
    """1 for 1, "1" and "ring1". Raises InputError when the maze has no such ring."""
    text = str(ring).removeprefix("ring")
    if text.isdecimal() and 1 <= int(text) <= len(maze.rings):
        return int(text)
    raise InputError(f"got {ring!r}, expected ring1 to ring{len(maze.rings)}", key="ring")


def resolve_model(model: str | Path | RigModel | None, rig: str | None, maze: Maze) -> RigModel:
    """The model asked for; else the rig's own; else a packaged one of the rig's name; else nominal physics."""
    if isinstance(model, RigModel):
        return model
    source = model_source(model, rig)
    return RigModel.nominal(maze) if source is None else load_model(source)


def model_source(model: str | Path | None, rig: str | None) -> str | None:
    """Folder or packaged name of the model that is meant; None: nominal physics. A folder is told by its whole path,
    so that it is found again from elsewhere."""
    if model is None and rig is not None:
        model = rig_model_hint(rig)
        if model is None and rig in model_names():
            model = rig
    if model is None:
        return None
    return str(Path(model).absolute()) if Path(model).exists() else str(model)
