"""Rigs, maps and models that Python gives as objects, for work that needs them by name."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from mazeplan.core.errors import InputError
from mazeplan.learning.modelfile import RigModel, save_model
from mazeplan.maze.geometry import Maze
from mazeplan.maze.mapfile import dump_map
from mazeplan.rigs.interface import Rig
from mazeplan.rigs.registry import named_rig


@dataclass(frozen=True)
class Named:
    """Names of a rig, a map and a model. model: None: the rig's own"""

    rig: str
    map: str
    model: str | None


@contextmanager
def by_name(
    rig: str | Path | Rig | type, map: str | Path | Maze, model: str | Path | RigModel | None, *, alone: bool
) -> Iterator[Named]:
    """Names for a rig, a map and a model, which hold within this context; maps and models get temporary files.

    alone: whether all work is done in this process, and none is kept. Otherwise a rig that is an object raises
        InputError: nobody else could make it."""
    with tempfile.TemporaryDirectory(prefix="mazeplan-") as folder, named_rig(rig) as name:
        if not alone and not isinstance(rig, str | Path):
            problem = "got a rig that is an object, expected a name, a file or module:Class with workers, dask or store"
            raise InputError(problem, key="rig")
        if isinstance(map, Maze):
            path = Path(folder) / f"{map.name or 'map'}.yaml"
            path.write_text(dump_map(map), encoding="utf-8")
            map = path
        if isinstance(model, RigModel):
            model = save_model(model, Path(folder) / "model").parent
        yield Named(name, str(map), None if model is None else str(model))
