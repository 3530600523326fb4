"""Names that a shell completes: rings, openings, maps, rigs, models, trees and effects.

If the names cannot be read, the completion is empty, because a shell has no place for a message.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from pathlib import Path
from typing import TYPE_CHECKING

from typer import Context

from mazeplan.core.errors import MazeplanError

if TYPE_CHECKING:
    from mazeplan.maze.geometry import Maze

Completion = Callable[[Context, str], list[str]]


def completed(names: Callable[[Context], Iterable[str]], *endings: str) -> Completion:
    """Completion of names, and of files with one of the endings. Without endings, it completes no files."""

    def complete(ctx: Context, incomplete: str) -> list[str]:
        try:
            found = [name for name in names(ctx) if name.startswith(incomplete)]
        except MazeplanError:
            found = []
        return found + (_files(incomplete, endings) if endings else [])

    return complete


def _files(incomplete: str, endings: tuple[str, ...]) -> list[str]:
    """The folders, and the files with one of the endings, whose path begins with the incomplete word."""
    head = incomplete[: incomplete.rindex("/") + 1] if "/" in incomplete else ""
    folder = Path(head or ".")
    if not folder.is_dir():
        return []
    there = [path for path in sorted(folder.iterdir()) if f"{head}{path.name}".startswith(incomplete)]
    return [f"{head}{path.name}/" if path.is_dir() else f"{head}{path.name}" for path in there
            if path.is_dir() or path.suffix.lower() in endings]  # fmt: skip


def _maze(ctx: Context) -> Maze:
    from mazeplan.maze.mapfile import load_map

    return load_map(ctx.params.get("map_") or "cme")


def _rings(ctx: Context) -> list[str]:
    return [*(f"ring{ring.number}" for ring in _maze(ctx).rings), "centre"]


def _openings(ctx: Context) -> list[str]:
    return [opening.name for opening in _maze(ctx).openings]


def _maps(ctx: Context) -> tuple[str, ...]:
    from mazeplan.maze.mapfile import packaged_maps

    return packaged_maps()


def _rigs(ctx: Context) -> list[str]:
    from mazeplan.rigs.registry import installed_rigs, rig_names

    return [*rig_names(), *installed_rigs()]


def _models(ctx: Context) -> tuple[str, ...]:
    from mazeplan.learning.modelfile import model_names

    return model_names()


def _trees(ctx: Context) -> list[str]:
    from mazeplan.core import resources

    return sorted(path.stem for path in resources.share("behaviors").glob("*.xml"))


def _effects(ctx: Context) -> list[str]:
    from mazeplan.physics.registry import EFFECTS

    return [name for name, effect in EFFECTS.items() if effect.named]


RINGS, OPENINGS = completed(_rings), completed(_openings)
MAPS, RIGS = completed(_maps, ".yaml", ".yml"), completed(_rigs, ".yaml", ".yml")
MODELS, TREES = completed(_models, ""), completed(_trees, ".xml")
EFFECTS = completed(_effects)
LOGS = completed(lambda ctx: (), ".mcap", ".csv")
