"""The folder of a model that learns while it drives: model.yaml and ringN.npz as any model has them, `start/` with the
model that it began with, and `learning.npz`, from which it goes on.

Of what lies there only learning.npz and `start/` decide; the model files are what they make, for `--model` and for
people. So they are refused when they are not what was written: an edit would be lost without a word. Which they were is
told in learning.npz: for each file what it was before and what it was to become, as a program may be killed in between.
"""

from __future__ import annotations

import hashlib
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from mazeplan.errors import InputError, ModelError
from mazeplan.maze.geometry import Maze
from mazeplan.maze.mapfile import dump_map
from mazeplan.models.modelfile import save_model
from mazeplan.models.online_rig import OnlineModel, OnlineOptions
from mazeplan.models.onlinefile import ROWS, START, read_about, read_online, write_online

ADVICE = "give another folder with -o, and this one with --model to begin with what it is now"


def keep_learner(online: OnlineModel, folder: Path, rig: str) -> None:
    """Write all of it; killed at any moment, it leaves a folder that goes on. rig: on which it learns. Raises
    ModelError."""
    if not (folder / START).exists():
        save_model(online.start, folder / START)
    try:
        with TemporaryDirectory(prefix=".new-", dir=folder) as place:
            new = sorted(save_model(online.model, place).parent.iterdir())
            files = {p.name: [_sha256(q) for q in (p, folder / p.name) if q.exists()] for p in new}
            about = {"rig": rig, "map": dump_map(online.maze), "map_name": online.maze.name, "files": files}
            write_online(online, folder, about)
            for path in new:
                path.replace(folder / path.name)
    except OSError as problem:
        raise ModelError(f"cannot be written: {problem.strerror}", file=folder) from None


def open_learner(folder: Path, maze: Maze, rig: str, options: OnlineOptions | None = None) -> OnlineModel:
    """Go on with what was kept. Raises InputError for another rig or map than it learned on, ModelError for files that
    are damaged or were changed."""
    about = read_about(folder)
    if not about:
        return read_online(folder, maze, options)
    _check_same(about, folder, maze, rig)
    as_written = [_check_file(folder / str(name), prints) for name, prints in about["files"].items()]
    online = read_online(folder, maze, options)
    if not all(as_written):
        keep_learner(online, folder, rig)
    return online


def _check_file(path: Path, prints: list[str]) -> bool:
    """Whether it is what was to be written last; not where a program was killed before that."""
    if not path.is_file():
        if len(prints) == 1:  # and before it there was none
            return False
        raise ModelError(f"is missing; it belongs to {ROWS}: {ADVICE}", file=path)
    found = _sha256(path)
    if found not in prints:
        raise ModelError(f"is not as it was written, but what drives comes from {ROWS}: {ADVICE}", file=path)
    return found == prints[0]


def _check_same(about: dict[str, Any], folder: Path, maze: Maze, rig: str) -> None:
    if about["map"] != dump_map(maze):
        other = "another map of that name" if about["map_name"] == maze.name else str(about["map_name"])
        raise InputError(f"--map: got {maze.name}, but {folder} has learned on {other}: {ADVICE}")
    if about["rig"] != rig:
        raise InputError(f"--rig: got {rig}, but {folder} has learned on {about['rig']}: {ADVICE}")


def _sha256(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()
