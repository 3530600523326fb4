"""Resolves the names that a user gives: rings, and the model that goes with a rig."""

from __future__ import annotations

import math
import re
import warnings
from functools import lru_cache
from pathlib import Path

from mazeplan.core import resources
from mazeplan.core.errors import InputError, ModelError, SettingsError, ShortWarning, one_of
from mazeplan.learning.modelfile import RigModel, is_packaged_model, load_model, model_names, model_path, model_stamp
from mazeplan.learning.rig_model import transfer_model
from mazeplan.maze.geometry import Maze
from mazeplan.maze.mapfile import load_map
from mazeplan.rigs.registry import rig_model_hint, unusable_model

CENTRE = ("centre", "center")
HOME = resources.share("maps") / "cme.yaml"  # the map on which the packaged models were fitted


def ring_number(ring: int | str, maze: Maze, key: str = "ring") -> int:
    """Number of the ring: 1 for 1, "1", "ring1" and "Ring 1"; the innermost one for "centre" and "center".

    Raises InputError when the maze has no such ring. key: for the error"""
    text = str(ring).strip().lower()
    if text in CENTRE:
        return len(maze.rings)
    found = re.fullmatch(r"(?:ring[ _-]?)?([0-9]{1,3})", text, re.ASCII)
    if found is not None and 1 <= int(found[1]) <= len(maze.rings):
        return int(found[1])
    expected = f"expected ring1 to ring{len(maze.rings)} or centre (map {maze.name})"
    raise InputError(f"got {ring!r}, {expected}", key=key)


def opening_name(name: str, maze: Maze) -> str:
    """The name, if the maze has such an opening. Raises SettingsError."""
    names = [opening.name for opening in maze.openings]
    if name not in names:
        raise SettingsError(f"got {name!r}, expected {one_of(names, name)} (map {maze.name})", key="opening")
    return name


def check_start_angle(degrees: float, ring: int, maze: Maze, key: str) -> None:
    """Raises InputError for more than a turn, or if a radial wall leaves a ball no room there. key: for the error."""
    if not abs(degrees) <= 360.0:
        raise InputError(f"got {degrees:g}, expected -360 to 360 degrees", key=key)
    if not maze.has_room(ring, math.radians(degrees)):
        raise InputError(f"got {degrees:g}, where a radial wall leaves the ball no room in ring {ring}", key=key)


def resolve_model(model: str | Path | RigModel | None, rig: str | None, maze: Maze) -> RigModel:
    """The model that was asked for; else the one that the rig names; else a packaged one of the rig's name; else
    nominal physics.

    If the maze has other rings than the map on which a packaged model was fitted, only the model's physics is used."""
    if isinstance(model, RigModel):
        return model
    source = model_source(model, rig)
    if source is None:
        return RigModel.nominal(maze)
    found = model_from(source, maze)
    missing = [ring.number for ring in maze.rings if ring.number not in found.balls and not ring.is_disc]
    if missing:
        warning = f"model {source} does not know ring {', '.join(map(str, missing))} of the map {maze.name}"
        warnings.warn(f"{warning}: numbers of the nearest ring are used", ShortWarning, stacklevel=2)
    return found


def model_from(source: str | Path, maze: Maze) -> RigModel:
    """The model in a folder, or the packaged model of that name, carried over to the maze. Raises ModelError."""
    return _model(str(source), maze, model_stamp(source))


@lru_cache(maxsize=4)
def _model(source: str, maze: Maze, stamp: object) -> RigModel:
    """The model, read once for all runs of a process. stamp: changes when the model's files change"""
    model = load_model(source)
    return transfer_model(model, load_map(HOME), maze) if is_packaged_model(source) else model


def model_source(model: str | Path | None, rig: str | None) -> str | None:
    """Absolute folder, or packaged name, of the model; None: nominal physics.

    Raises SettingsError if the rig's file names a model that does not exist, with the line in that file."""
    if model is None and rig is not None:
        model = rig_model_hint(rig)
        try:
            if model is not None:
                model_path(model)
        except ModelError as problem:
            raise unusable_model(rig, str(problem)) from None
        if model is None and rig in model_names():
            model = rig
    if model is None:
        return None
    there = not is_packaged_model(model) and Path(model).exists()
    return str(Path(model).absolute()) if there else str(model)
