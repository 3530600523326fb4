"""Networks beside a model file: ringN.npz, read without pickle and checked before use, as in `gp_file`.

| array | what |
|---|---|
| format | 1 |
| `networks.ARRAYS` | weights, for inputs `state` |
| noise, rows | noise of a sample, rad/s^2; number of training rows |
"""

from __future__ import annotations

import io
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from mazeplan.core.errors import ModelError
from mazeplan.core.file_format import format_problem
from mazeplan.learning.gp_file import arrays_of, check_entry, content_of, short, write_content
from mazeplan.learning.networks import ARRAYS, Networks

FORMAT = 1
MOST_BYTES = 8 << 20
SHAPES = {"noise": ((), np.float64), "rows": ((), np.int64), "format": ((), np.int64)}


def write_networks(folder: Path, ring: int, networks: Networks) -> dict[str, Any]:
    """Write ringN.npz. Returns its entry for model.yaml. Raises ModelError for inputs other than the state."""
    if networks.inputs != "state":
        raise ModelError(f"got {networks.inputs!r}, expected state", key="inputs")
    stream = io.BytesIO()
    arrays = {name: getattr(networks, name) for name in ARRAYS}
    rows, noise = np.array(networks.rows, dtype=np.int64), np.array(networks.noise)
    np.savez_compressed(stream, format=np.array(FORMAT, dtype=np.int64), rows=rows, noise=noise, **arrays)
    return {**write_content(folder / f"ring{ring}.npz", stream.getvalue()), **_summary(networks)}


def _summary(networks: Networks) -> dict[str, Any]:
    """The entries of model.yaml that describe the networks."""
    members, hidden = networks.last.shape
    noise = {"value": short(networks.noise), "unit": "rad/s^2"}
    return {"rows": networks.rows, "networks": members, "hidden": hidden, "noise": noise}


def read_networks(folder: Path, entry: Mapping[str, Any]) -> Networks:
    """The networks of an entry of model.yaml. Raises ValueError."""
    name = str(entry["file"])
    try:
        held = arrays_of(content_of(folder, entry), MOST_BYTES)
        missing = [key for key in (*SHAPES, *ARRAYS) if key not in held]
        if missing:
            raise ValueError(f"it lacks {', '.join(missing)}")
        for key in (*SHAPES, *ARRAYS):
            shape, dtype = SHAPES.get(key, (held[key].shape, np.float64))
            if held[key].shape != shape or held[key].dtype != dtype:
                raise ValueError(f"{key}: got {held[key].dtype} {held[key].shape}, expected {np.dtype(dtype)} {shape}")
        problem = format_problem(int(held["format"]), FORMAT)
        if problem is not None:
            raise ValueError(f"format: {problem}")
        arrays: dict[str, Any] = {key: held[key] for key in ARRAYS}
        networks = Networks(**arrays, noise=float(held["noise"]), rows=int(held["rows"]))
    except (ModelError, ValueError) as problem:
        raise ValueError(f"{name} is no such file of networks: {problem}") from None
    check_entry(entry, _summary(networks))
    return networks
