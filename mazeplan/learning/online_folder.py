"""The folder of an online model: a model folder, `start/` with the first model, and `learning.npz` with the rows.

learning.npz has the rows and ages of each ring; hyperparameters and effects are those of `start/`. Only these two
decide. The other files are results, for `--model` and for people. An edit of these files would be lost, so changed
files are refused. learning.npz lists two SHA-256 for each file: of the new version and of the version before, because
a program may be killed in between. Loading executes nothing.
"""

from __future__ import annotations

import hashlib
import io
import json
from collections.abc import Mapping
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from mazeplan.core.errors import InputError, ModelError
from mazeplan.core.file_format import format_problem
from mazeplan.learning.features import INPUTS
from mazeplan.learning.gp_file import MOST_BYTES, MOST_ROWS, arrays_of
from mazeplan.learning.modelfile import load_model, save_model
from mazeplan.learning.online_gp import OnlineProcess
from mazeplan.learning.online_rig import OnlineModel, OnlineOptions
from mazeplan.maze.geometry import Maze
from mazeplan.maze.mapfile import dump_map

ROWS, START = "learning.npz", "start"
FORMAT = 1
NAMES = ("inputs", "features", "y", "age")
ADVICE = "give another folder with -o, and this one with --model to begin with what it is now"


def keep_learner(online: OnlineModel, folder: Path, rig: str) -> None:
    """Write the folder, so that learning can go on even if the program is killed at any moment. Raises ModelError.

    rig: the rig on which the model learns."""
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
    """The online model of a folder. Raises InputError for another rig or map, ModelError for damaged files."""
    about = read_about(folder)
    if not about:
        return read_online(folder, maze, options)
    if about["map"] != dump_map(maze):
        other = "another map of that name" if about["map_name"] == maze.name else str(about["map_name"])
        raise InputError(f"--map: got {maze.name}, but {folder} has learned on {other}: {ADVICE}")
    if about["rig"] != rig:
        raise InputError(f"--rig: got {rig}, but {folder} has learned on {about['rig']}: {ADVICE}")
    as_written = [_is_new(folder / str(name), prints) for name, prints in about["files"].items()]
    online = read_online(folder, maze, options)
    if not all(as_written):
        keep_learner(online, folder, rig)
    return online


def _is_new(path: Path, prints: list[str]) -> bool:
    """True for the new version of a file, False for the version before, file or none. Else raises ModelError."""
    if not path.is_file():
        if len(prints) == 1:  # there was none before
            return False
        raise ModelError(f"is missing; it belongs to {ROWS}: {ADVICE}", file=path)
    found = _sha256(path)
    if found not in prints:
        raise ModelError(f"was changed, but the model in use comes from {ROWS}: {ADVICE}", file=path)
    return found == prints[0]


def _sha256(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


def write_online(online: OnlineModel, folder: Path, about: Mapping[str, Any] | None = None) -> Path:
    """Write learning.npz. Returns its path. about: content for `read_about`. Raises ModelError."""
    arrays: dict[str, np.ndarray] = {
        "format": np.array(FORMAT),
        "now": np.array(online.now),
        "clock": np.array(online.clock),
        "watched": np.array(online.watched, dtype=np.float64).reshape(-1, 2),
    }
    if about is not None:
        arrays["about"] = np.array(json.dumps(about))
    for ring, rows in online.rings.items():
        arrays |= {f"ring{ring}_{name}": getattr(rows, name) for name in NAMES}
    stream, path = io.BytesIO(), folder / ROWS
    np.savez_compressed(stream, allow_pickle=False, **arrays)
    try:
        beside = path.with_suffix(".new")
        beside.write_bytes(stream.getvalue())
        beside.replace(path)  # so that the file is always whole
    except OSError as problem:
        raise ModelError(f"cannot be written: {problem.strerror}", file=path) from None
    return path


def read_online(folder: Path, maze: Maze, options: OnlineOptions | None = None) -> OnlineModel:
    """The online model of learning.npz and `start/`. Raises ModelError."""
    arrays = _arrays(folder / ROWS)
    online = OnlineModel(load_model(folder / START), maze, options)
    try:
        _fill(online, arrays)
    except (KeyError, TypeError, ValueError) as problem:
        raise ModelError(f"does not fit the model beside it: {problem}", file=folder / ROWS) from None
    return online


def read_about(folder: Path) -> dict[str, Any]:
    """Rig, map, map_name and files of an online model; {} for files of older versions. Raises ModelError."""
    arrays = _arrays(folder / ROWS)
    if "about" not in arrays:
        return {}
    try:
        about = json.loads(str(arrays["about"]))
        texts, files = [about[name] for name in ("rig", "map", "map_name")], about["files"]
        whole = isinstance(files, dict) and all(isinstance(prints, list) for prints in files.values())
        if not whole or not all(isinstance(text, str) for text in texts):
            raise ValueError("a field is of the wrong kind")
    except (KeyError, TypeError, ValueError, RecursionError) as problem:
        raise ModelError(f"cannot be read: about: {problem}", file=folder / ROWS) from None
    return about


def _arrays(path: Path) -> dict[str, np.ndarray]:
    try:
        if path.stat().st_size > MOST_BYTES:
            raise ValueError(f"it is larger than {MOST_BYTES} bytes")
        arrays = arrays_of(path.read_bytes(), MOST_BYTES)
    except (OSError, ValueError) as problem:
        raise ModelError(f"cannot be read: {' '.join(str(problem).split())}", file=path) from None
    given, version = (arrays[name].tolist() if name in arrays else None for name in ("format", "version"))
    if refused := format_problem(given, FORMAT, version):
        raise ModelError(refused, file=path, key="format")
    return arrays


def _fill(online: OnlineModel, arrays: dict[str, np.ndarray]) -> None:
    """Put the rows into the rings. Raises KeyError, ValueError or ModelError."""
    online.now, online.clock = int(arrays["now"]), float(arrays["clock"])
    watched = arrays["watched"]
    bad = online.now < 0 or not 0.0 <= online.clock < np.inf
    if bad or watched.ndim != 2 or watched.shape[1:] != (2,) or not np.isfinite(watched).all():
        raise ValueError("the numbers of the runs are not valid")
    online.watched.extend((float(a), float(b)) for a, b in watched)
    for ring, empty in online.rings.items():
        parts = [arrays[f"ring{ring}_{name}"] for name in NAMES]
        n = len(parts[2]) if parts[2].ndim == 1 else -1
        shapes = [(n, len(INPUTS)), (n, empty.features.shape[1]), (n,), (n,)]
        if n > MOST_ROWS or [p.shape for p in parts] != shapes or any(p.dtype != np.float64 for p in parts):
            raise ValueError(f"ring {ring}: got {[p.shape for p in parts]}, expected {shapes}")
        if n and not (parts[3].min() >= 0.0 and parts[3].max() <= online.clock):
            raise ValueError(f"ring {ring}: the age of a row is later than the last run")
        online.rings[ring] = OnlineProcess.begin(empty.hyper, empty.walk).added(*parts)
