"""A learned policy: a small network that gives the tilt of the plate for a ball on its way to an opening.

It imitates the planner (`run.campaign.imitation`). Inputs and outputs are relative to the ball: outwards from the
centre, and along the ring. Relative to the ball, a ring looks the same from everywhere. Only the limits of the plate
and the servos have fixed axes, so there are angles among the inputs. The decision needs numpy alone:

    z = (x - mean) / scale,   h = tanh(W h + b) for each hidden layer,   tilt = limit (W h + b)

`Policy.distance` measures how far an input is from the training data. It uses the first KNOWN columns, scaled, and
their distance to the nearest of some hundred centres of the training data. The unit is the distance within which 99.9 %
of the training data lie: up to 1, the policy knows such a state.

A folder holds a policy: `policy.yaml`, which a person can read, and the numbers beside it in `policy.npz`.

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
import math
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import yaml
from numpy.typing import NDArray
from pydantic import Field

from mazeplan.control.tilt import Plate
from mazeplan.core import file_kinds
from mazeplan.core.array_file import arrays_of, content_of, write_content
from mazeplan.core.errors import ModelError
from mazeplan.core.records import Array, Command, State
from mazeplan.core.whole_file import whole_file
from mazeplan.maze.geometry import Opening, Ring
from mazeplan.maze.sections import Section, read_section
from mazeplan.maze.yamltree import read_yaml

Single = NDArray[np.float32]

# turn: angle to the opening, in the direction already chosen, rad; near: tanh(turn / NEAR), finer near the opening
# track: radius of the middle of the channel, m; off: radius of the ball beyond that middle, m
# speed_*: m/s; tilt_*: tilt of the plate, rad; rate_*: its rate, rad/s
# inwards: whether the opening leads inwards; passing: whether the ball was already in front of the opening
# cos_n, sin_n: of n times the angle of the ball
INPUTS = (
    "turn", "near", "track", "off", "speed_out", "speed_along", "tilt_out", "tilt_along", "rate_out", "rate_along",
    "inwards", "passing", "cos_1", "sin_1", "cos_2", "sin_2", "cos_4", "sin_4",
)  # fmt: skip
KNOWN = 12
NEAR = 0.15  # rad
FORMAT = 1
YAML, ARRAYS = "policy.yaml", "policy.npz"
MOST_BYTES = 16 << 20
MOST_LAYERS, WIDEST = 8, 1024
COS, SIN = INPUTS.index("cos_1"), INPUTS.index("sin_1")


def policy_inputs(state: State, ring: Ring, opening: Opening, turn: float, passing: bool, plate: Plate) -> Array:
    """INPUTS (18,) for a ball in a channel.

    state:    at the moment when the command acts
    turn:     angle to the opening, in the direction already chosen, rad
    passing:  whether the ball was already in front of the opening"""
    r, theta = max(state.r, 1e-6), state.theta
    c, s = state.x / r, state.y / r
    a, b = state.beta + plate.offset_beta, -(state.gamma + plate.offset_gamma)
    a_dot, b_dot = state.beta_dot, -state.gamma_dot
    return np.array([
        turn, math.tanh(turn / NEAR), ring.track_radius, r - ring.track_radius,
        c * state.vx + s * state.vy, -s * state.vx + c * state.vy,
        c * a + s * b, -s * a + c * b, c * a_dot + s * b_dot, -s * a_dot + c * b_dot,
        float(opening.leads_to(ring.number) == opening.inner), float(passing),
        c, s, math.cos(2.0 * theta), math.sin(2.0 * theta), math.cos(4.0 * theta), math.sin(4.0 * theta),
    ])  # fmt: skip


@dataclass(frozen=True, eq=False)
class Policy:
    """A learned policy.

    mean, scale:  of the inputs, (18,)"""

    layers: tuple[tuple[Single, Single], ...]  # weights (out, in) and bias (out,) of each layer
    mean: Single
    scale: Single
    centres: Single  # centres of the scaled training inputs, (K, KNOWN)
    reach: float  # scaled distance that counts as 1
    limit: float  # tilt that the network calls 1, rad
    facts: dict[str, Any] = field(default_factory=dict)  # how the policy was trained
    source: str | None = None  # folder of the policy; None if no file holds it

    def tilt(self, inputs: Array) -> Array:
        """Tilt outwards and along the ring, (2,) or (N, 2), rad, not limited, for inputs (18,) or (N, 18)."""
        h: Array = (inputs - self.mean) / self.scale
        for weights, bias in self.layers[:-1]:
            h = np.tanh(h @ weights.T + bias)
        weights, bias = self.layers[-1]
        return self.limit * (h @ weights.T + bias)

    def command(self, inputs: Array, plate: Plate) -> Command:
        """The command for inputs (18,), inside the limits."""
        out, along = self.tilt(inputs).tolist()
        c, s = float(inputs[COS]), float(inputs[SIN])
        return plate.clip(c * out - s * along - plate.offset_beta, -(s * out + c * along) - plate.offset_gamma)

    def distance(self, inputs: Array) -> float:
        """Distance of inputs (18,) from the training data; up to 1, the policy knows such inputs."""
        z = (inputs[:KNOWN] - self.mean[:KNOWN]) / self.scale[:KNOWN]
        gap = self.centres - z
        return math.sqrt(float(np.einsum("ij,ij->i", gap, gap).min())) / self.reach


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
