"""What a learner has learned, kept beside the model that it makes: rows and ages of each ring, `learning.npz`.

The model that it began with lies in `start/`, a model folder like any; hyperparameters and the effects that rows are
counted from are its. Nothing is executed on loading; a file that does not fit is refused.
"""

from __future__ import annotations

import io
import json
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from mazeplan.errors import ModelError
from mazeplan.maze.geometry import Maze
from mazeplan.models.features import INPUTS
from mazeplan.models.modelfile import load_model
from mazeplan.models.online import OnlineProcess
from mazeplan.models.online_rig import OnlineModel, OnlineOptions
from mazeplan.models.processfile import MOST_BYTES, MOST_ROWS
from mazeplan.records import Array

ROWS, START = "learning.npz", "start"
FORMAT = 1
NAMES = ("inputs", "features", "y", "age")


def write_online(online: OnlineModel, folder: Path, about: Mapping[str, Any] | None = None) -> Path:
    """Write learning.npz into a folder; its path. about: what `read_about` is to tell. Raises ModelError."""
    arrays: dict[str, Array | np.ndarray] = {
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
        beside.replace(path)  # so that there is always a whole one
    except OSError as problem:
        raise ModelError(f"cannot be written: {problem.strerror}", file=path) from None
    return path


def read_online(folder: Path, maze: Maze, options: OnlineOptions | None = None) -> OnlineModel:
    """The learner that was kept in a folder. Raises ModelError."""
    path = folder / ROWS
    arrays = _arrays(path)
    online = OnlineModel(load_model(folder / START), maze, options)
    try:
        _fill(online, arrays)
    except (KeyError, TypeError, ValueError) as problem:
        raise ModelError(f"does not fit the model beside it: {problem}", file=path) from None
    return online


def read_about(folder: Path) -> dict[str, Any]:
    """What else was written of the learner in a folder: rig, map, map_name and files; {} by older versions. Raises
    ModelError."""
    path = folder / ROWS
    arrays = _arrays(path)
    if "about" not in arrays:
        return {}
    try:
        about = json.loads(str(arrays["about"]))
        texts = [about[name] for name in ("rig", "map", "map_name")]
        files = about["files"]
        whole = isinstance(files, dict) and all(isinstance(prints, list) for prints in files.values())
        if not whole or not all(isinstance(text, str) for text in texts):
            raise ValueError("a field is of the wrong kind")
    except (KeyError, TypeError, ValueError, RecursionError) as problem:
        raise ModelError(f"cannot be read: about: {problem}", file=path) from None
    return about


def _arrays(path: Path) -> dict[str, np.ndarray]:
    try:
        if path.stat().st_size > MOST_BYTES:
            raise ValueError(f"it is larger than {MOST_BYTES} bytes")
        with zipfile.ZipFile(path) as archive:
            if sum(member.file_size for member in archive.infolist()) > MOST_BYTES:
                raise ValueError(f"it unpacks to more than {MOST_BYTES} bytes")
        with np.load(path, allow_pickle=False) as held:
            return {name: held[name] for name in held.files}
    except Exception as problem:  # zipfile, zlib and numpy raise a dozen kinds for a damaged or malicious file
        reason = " ".join(str(problem).split())
        raise ModelError(f"cannot be read: {reason}", file=path) from None


def _fill(online: OnlineModel, arrays: dict[str, np.ndarray]) -> None:
    """Put the rows into the rings. Raises KeyError, ValueError or ModelError."""
    if int(arrays["format"]) != FORMAT:
        raise ValueError(f"got format {arrays['format']}, expected {FORMAT}")
    online.now, online.clock = int(arrays["now"]), float(arrays["clock"])
    watched = arrays["watched"]
    bad = online.now < 0 or not 0.0 <= online.clock < np.inf
    if bad or watched.ndim != 2 or watched.shape[1:] != (2,) or not np.isfinite(watched).all():
        raise ValueError("the runs are no numbers")
    online.watched.extend((float(a), float(b)) for a, b in watched)
    for ring, empty in online.rings.items():
        parts = [arrays[f"ring{ring}_{name}"] for name in NAMES]
        n = len(parts[2]) if parts[2].ndim == 1 else -1
        shapes = [(n, len(INPUTS)), (n, empty.features.shape[1]), (n,), (n,)]
        if n > MOST_ROWS or [p.shape for p in parts] != shapes or any(p.dtype != np.float64 for p in parts):
            raise ValueError(f"ring {ring}: got {[p.shape for p in parts]}, expected {shapes}")
        if n and not (parts[3].min() >= 0.0 and parts[3].max() <= online.clock):
            raise ValueError(f"ring {ring}: a row is of a run that has not been")
        online.rings[ring] = OnlineProcess.begin(empty.hyper, empty.walk).added(*parts)
