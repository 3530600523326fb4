"""Folders of policies: `policy.yaml`, which a person can read, and the numbers beside it in `policy.npz`.

    format: 1
    inputs: [turn, near, ...]
    hidden: [64, 64]
    limit: 0.0873          # rad, the tilt that the network calls 1
    reach: 0.83            # distance in scaled inputs that counts as 1
    arrays: {file: policy.npz, sha256: ...}
    trained: {rig: toy, map: cme, seed: 0, ...}

Loading executes nothing: the arrays are read without pickle, and only the file with that sha256 is accepted.
"""

from __future__ import annotations

import hashlib
import io
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import yaml
from pydantic import Field

from mazeplan.control.policy import INPUTS, KNOWN, Policy, Single
from mazeplan.core import file_kinds
from mazeplan.core.errors import ModelError
from mazeplan.core.whole_file import whole_file
from mazeplan.learning.gp_file import arrays_of, content_of, write_content
from mazeplan.maze.sections import Section, read_section
from mazeplan.maze.yamltree import read_yaml

FORMAT = 1
YAML, ARRAYS = "policy.yaml", "policy.npz"
MOST_BYTES = 16 << 20
MOST_LAYERS, WIDEST = 8, 1024


class PolicyFile(Section):
    """The content of policy.yaml."""

    inputs: list[str]
    hidden: list[Annotated[int, Field(ge=1, le=WIDEST)]] = Field(max_length=MOST_LAYERS)
    limit: float = Field(gt=0.0)
    reach: float = Field(gt=0.0)
    arrays: dict[str, Any]
    trained: dict[str, Any] | None


def policy_document(policy: Policy) -> dict[str, Any]:
    """The content of policy.yaml without the entry `arrays`."""
    hidden = [len(bias) for _, bias in policy.layers[:-1]]
    numbers = {"hidden": hidden, "limit": policy.limit, "reach": policy.reach, "trained": policy.facts}
    return {"format": FORMAT, "inputs": list(INPUTS), **numbers}


def save_policy(policy: Policy, folder: str | Path) -> Path:
    """Write the folder, created if missing. Returns the path of its policy.yaml. Raises ModelError."""
    path, stream = Path(folder) / YAML, io.BytesIO()
    arrays: dict[str, Any] = {"mean": policy.mean, "scale": policy.scale, "centres": policy.centres}
    for k, (weights, bias) in enumerate(policy.layers):
        arrays |= {f"weights{k}": weights, f"bias{k}": bias}
    np.savez(stream, **arrays)
    document = policy_document(policy)
    trained = document.pop("trained")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        held = write_content(path.with_name(ARRAYS), stream.getvalue())
        document |= {"arrays": held, "trained": trained}
        with whole_file(path) as beside:
            beside.write_text(yaml.safe_dump(document, sort_keys=False, width=120), encoding="utf-8")
    except OSError as problem:
        raise ModelError(f"cannot be written: {problem.strerror}", file=path) from None
    return path


def load_policy(folder: str | Path) -> Policy:
    """The policy in a folder. Raises ModelError with file, line and key."""
    path = Path(folder) / YAML
    if not path.exists():
        raise ModelError(f"got {file_kinds.got(folder)}, expected a folder with {YAML}", file=folder)
    tree = read_yaml(path, error=ModelError, what=f"a policy ({YAML})")
    file = read_section(PolicyFile, tree, path, ModelError, FORMAT)

    def wrong(problem: str, key: str) -> ModelError:
        return ModelError(problem, file=path, line=tree.line((key,)), key=key)

    if file.inputs != list(INPUTS):
        raise wrong(f"got others, expected {', '.join(INPUTS)}", "inputs")
    try:
        arrays = _arrays(path.with_name(ARRAYS), file.arrays, [len(INPUTS), *file.hidden, 2])
    except (ValueError, TypeError) as problem:
        raise wrong(str(problem), "arrays") from None
    layers = tuple((arrays[f"weights{k}"], arrays[f"bias{k}"]) for k in range(len(file.hidden) + 1))
    return Policy(
        layers, arrays["mean"], arrays["scale"], arrays["centres"], file.reach, file.limit, file.trained or {},
        str(path.parent.absolute()),
    )  # fmt: skip


def policy_sha256(folder: str | Path) -> str:
    """SHA-256 of policy.yaml, which in turn holds the SHA-256 of the arrays; empty if it cannot be read."""
    try:
        return hashlib.sha256((Path(folder) / YAML).read_bytes()).hexdigest()
    except (OSError, ValueError):
        return ""


def _arrays(path: Path, entry: Any, sizes: list[int]) -> dict[str, Single]:
    """Read the arrays of the file and check their shapes. Raises ValueError."""
    if not isinstance(entry, dict) or entry.get("file") != ARRAYS:
        raise ValueError(f"expected file: {ARRAYS} and its sha256")
    content = content_of(path.parent, ARRAYS, str(entry.get("sha256")))
    try:
        found = arrays_of(content, MOST_BYTES)
    except ValueError as problem:
        raise ValueError(f"{ARRAYS} is no such file of arrays: {problem}") from None
    shapes: dict[str, tuple[int, ...]] = {"mean": (sizes[0],), "scale": (sizes[0],)}
    for k, (i, o) in enumerate(pairwise(sizes)):
        shapes |= {f"weights{k}": (o, i), f"bias{k}": (o,)}
    nothing = np.empty(0)
    shapes["centres"] = (max(found.get("centres", nothing).shape[0], 1), KNOWN)
    for name, shape in shapes.items():
        got = found.get(name, nothing)
        good = got.shape == shape and got.dtype == np.float32 and np.isfinite(got).all()
        if not good or (name == "scale" and not (got > 0.0).all()):
            more = ", > 0" if name == "scale" else ""
            raise ValueError(f"{ARRAYS}: {name}: got {got.dtype} {got.shape}, expected float32 {shape}, finite{more}")
    return found
