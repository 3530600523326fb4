"""Recover measurements from the published Gaussian-process models of the circular-maze rig.

The authors of the rig published, for each ring, a regression of the ball's acceleration in exact dual form: inputs X,
weights alpha of the kernel, weights w of seven features of the ball's equation. This form determines its training data:

    y = s K alpha + Phi w + s v alpha        s: standard deviation of y, v: noise variance in units of s^2

Only v is missing in the files. It is the root at which y has the published standard deviation. The maximum of the
likelihood, y' alpha = s N, gives a second value; the two are compared. Only every 4th, 3rd and 2nd sample of rings 1 to
3 was published: `published_samples` recovers the samples between.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd

from mazeplan.core import file_kinds
from mazeplan.core.errors import ModelError
from mazeplan.core.progress import Advance, no_advance
from mazeplan.core.records import Array
from mazeplan.core.whole_file import whole_file
from mazeplan.learning.published_samples import (
    ACCELERATION,
    AXES,
    EDGE,
    RATE,
    RATE_HZ,
    Published,
    recover,
    sampling_step,
    segment_starts,
)

GRAVITY = 9.806  # m/s^2, of the published features
PREFIX = {
    "inputs": "data_X_f_acc_SP",
    "alpha": "alpha_hat_SP",
    "lengths": "lengthscales_f_acc_SP",
    "kernel_scale": "scalingfactor_f_acc_SP",
    "input_scales": "std_coef_X_f_acc_NPSP",
    "target_scale": "std_coef_Y_f_acc_SP",
    "weights": "w_hat_SP",
}
WIDTH = {"inputs": 9, "alpha": 1, "lengths": 9, "kernel_scale": 1, "input_scales": 9, "target_scale": 1, "weights": 7}
MAX_ROWS = 50_000  # the kernel takes rows^2 operations; the published models have at most 5820
MAX_BYTES = 64 << 20  # of one file; the published ones have at most 1.4 MB
MIN_ROWS = 8  # fewer do not show how the recording was thinned
MISFIT = 1e-3  # maximum relative difference from the weights that follow from alpha; matching files have 1e-12
STRANGERS = "do the files of this ring belong together?"
BLOCK = 1 << 22  # elements of the kernel matrix computed at a time


@dataclass(frozen=True)
class DualForm:
    """One published model of a ring.

    file:               file of the inputs
    inputs (N, 9):      rates, then sine and cosine, of theta, beta, gamma, in units of input_scales
    input_scales (9,):  units of the inputs
    lengths (9,):       length scales of the kernel, in these units
    kernel_scale:       factor of the kernel
    alpha (N,):         weights of the kernel
    weights (7,):       weights of the features
    target_scale:       s, rad/s^2"""

    ring: int
    file: Path
    inputs: Array
    input_scales: Array
    lengths: Array
    kernel_scale: float
    alpha: Array
    weights: Array
    target_scale: float


@dataclass(frozen=True)
class TrainingData:
    """Training data of a model.

    noise_variance:  v, in units of target_scale^2
    checks:          values that should be 0, by name"""

    rows: Published
    noise_variance: float
    checks: Mapping[str, float]


@dataclass(frozen=True)
class ImportedRing:
    """The table of a ring.

    file:            file of the inputs
    step:            samples from one published row to the next
    columns (M,):    by name; NaN if empty
    segments:        number of uninterrupted segments
    noise:           standard deviation, rad/s^2
    noise_variance:  see `TrainingData`
    checks:          values that should be 0, by name"""

    ring: int
    file: Path
    step: int
    columns: Mapping[str, Array]
    segments: int
    noise: float
    noise_variance: float
    checks: Mapping[str, float]

    @property
    def published(self) -> int:
        """Number of published rows."""
        return int(self.columns["measured"].sum())

    @property
    def recovered(self) -> int:
        """Number of recovered rows between them."""
        return len(self.columns["measured"]) - self.published


def find_models(folder: str | Path) -> dict[int, str]:
    """Ending of the file names of each ring's model; of several models, the one with the largest file of inputs.

    Raises ModelError."""
    folder = Path(folder)
    if not folder.is_dir():
        expected = "the folder of the published model files"
        raise ModelError(file_kinds.refused(folder, expected).replace("no such file", "no such folder"), file=folder)
    pattern = re.compile(re.escape(PREFIX["inputs"]) + r"(_ring([0-9]{1,2})_.*\.txt)")
    found: dict[int, tuple[int, str]] = {}
    try:
        paths = sorted(folder.iterdir())
    except OSError as problem:
        raise ModelError(f"cannot be read: {problem.strerror}", file=folder) from None
    for path in paths:
        match = pattern.fullmatch(path.name)
        if match is not None and path.is_file():
            size = (path.stat().st_size, match[1])
            found[int(match[2])] = max(size, found.get(int(match[2]), size))
    if not found:
        raise ModelError(f"no model in this folder, expected files {PREFIX['inputs']}_ring1_NAME.txt", file=folder)
    return {ring: ending for ring, (_, ending) in sorted(found.items())}


def read_model(folder: str | Path, ring: int, ending: str) -> DualForm:
    """The model whose files end in `ending`. Raises ModelError with file and line."""
    paths = {name: Path(folder) / (prefix + ending) for name, prefix in PREFIX.items()}
    for name, path in paths.items():
        if not path.is_file():
            raise ModelError(f"no such file; ring {ring} needs it beside {paths['inputs'].name}", file=path, key=name)
    read = {name: _numbers(path, rows=name in ("inputs", "alpha"), width=WIDTH[name]) for name, path in paths.items()}
    rows = len(read["inputs"])
    if len(read["alpha"]) != rows:
        raise ModelError(f"got {len(read['alpha'])} rows, expected {rows} as in {paths['inputs']}", file=paths["alpha"])
    for name in ("lengths", "kernel_scale", "input_scales", "target_scale"):
        if not np.all(read[name] > 0.0):
            raise ModelError(f"got {read[name].min():g}, expected numbers > 0", file=paths[name], key=name)
    for pair in (3, 5, 7):
        scaled = read["inputs"][:, pair : pair + 2] * read["input_scales"][pair : pair + 2]
        circle = np.abs(np.hypot(*scaled.T) - 1.0)
        if circle.max() > 1e-6:
            row = int(np.argmax(circle))
            raise ModelError(
                f"columns {pair + 1} and {pair + 2}: got {scaled[row, 0]:g} and {scaled[row, 1]:g} after scaling, "
                "expected a sine and a cosine", file=paths["inputs"], line=row + 1,
            )  # fmt: skip
    return DualForm(
        ring=ring,
        file=paths["inputs"],
        inputs=read["inputs"],
        input_scales=read["input_scales"],
        lengths=read["lengths"],
        kernel_scale=float(read["kernel_scale"][0]),
        alpha=read["alpha"][:, 0],
        weights=read["weights"],
        target_scale=float(read["target_scale"][0]),
    )


def _numbers(path: Path, *, rows: bool, width: int) -> Array:
    """The numbers of a text file: (N, width) with one row a line, or (width,) in lines of any length."""
    try:
        if path.stat().st_size > MAX_BYTES:
            raise ModelError(f"got {path.stat().st_size} bytes, expected at most {MAX_BYTES}", file=path)
        lines = path.read_text(encoding="ascii").rstrip().splitlines()
    except (OSError, UnicodeDecodeError) as problem:
        raise ModelError(f"not a text file of numbers: {problem}", file=path) from None
    table: list[list[float]] = []
    for number, line in enumerate(lines, start=1):
        row = []
        for text in line.split():
            try:
                row.append(float(text))
            except ValueError:
                raise ModelError(f"got {text[:40]!r}, expected a number", file=path, line=number) from None
        if not np.all(np.isfinite(row)):
            raise ModelError(f"got {line.strip()[:40]!r}, expected finite numbers", file=path, line=number)
        if rows and len(row) != width:
            raise ModelError(f"got {len(row)} numbers, expected {width}", file=path, line=number)
        table.append(row)
    if rows:
        if not MIN_ROWS <= len(table) <= MAX_ROWS:
            raise ModelError(f"got {len(table)} rows, expected {MIN_ROWS} to {MAX_ROWS}", file=path)
        return np.array(table)
    flat = np.array([value for row in table for value in row])
    if len(flat) != width:
        raise ModelError(f"got {len(flat)} numbers, expected {width}", file=path)
    return flat


def training_data(model: DualForm) -> TrainingData:
    """The training data of a model. Raises ModelError if no noise fits the published numbers."""
    with np.errstate(over="ignore", invalid="ignore"):  # absurd numbers are refused below
        x = model.inputs * model.input_scales
        angles = np.stack([np.arctan2(x[:, i], x[:, i + 1]) for i in (3, 5, 7)], axis=1)
        features = _features(angles, x[:, :3])
        known = model.target_scale * _kernel_times(model, model.alpha) + features @ model.weights
        slope = model.target_scale * model.alpha  # y = known + v slope
        both = np.mean((known - known.mean()) * (slope - slope.mean()))
        square = np.array([np.var(slope), 2.0 * both, np.var(known) - model.target_scale**2])  # in v: var y = s^2
    if not (np.all(np.isfinite(known)) and np.all(np.isfinite(square))):
        raise ModelError(f"the model is not finite at its own inputs; {STRANGERS}", file=model.file)
    roots = np.roots(square)
    roots = roots[(np.abs(roots.imag) < 1e-12) & (roots.real > 0.0)].real
    if not roots.size:
        raise ModelError(f"no noise gives targets of {model.target_scale:g} rad/s^2; {STRANGERS}", file=model.file)
    noise = float(roots.max())  # the only one: known and slope are positively correlated
    again = (model.target_scale * len(known) - known @ model.alpha) / (slope @ model.alpha)
    prior = features.T @ model.alpha  # the weights are `prior` times their common prior variance
    ratio = (prior @ model.weights) / max(prior @ prior, np.finfo(float).tiny)
    checks = {
        "weights": float(np.max(np.abs(model.weights - ratio * prior)) / max(np.max(np.abs(model.weights)), 1e-300)),
        "noise": float(abs(again / noise - 1.0)),
        "input_scales": float(np.max(np.abs(x.std(axis=0) / model.input_scales - 1.0))),
    }
    if not checks["weights"] < MISFIT:
        raise ModelError(f"{PREFIX['weights']} does not follow from {PREFIX['alpha']}; {STRANGERS}", file=model.file)
    return TrainingData(Published(angles, x[:, :3], known + noise * slope), noise, checks)


def _features(angles: Array, rates: Array) -> Array:
    """Terms of the ball's equation on a plate that tilts, (N, 7): rotation, gravity (per metre of radius), viscous."""
    (theta, beta, gamma), (theta_dot, beta_dot, gamma_dot) = angles.T, rates.T
    coriolis = 2.0 * beta_dot * gamma_dot * np.cos(gamma)
    return np.stack(
        [
            -(beta_dot**2) * np.sin(theta) * np.cos(theta) * np.cos(gamma) ** 2,
            -coriolis * np.cos(theta) ** 2,
            coriolis,
            0.5 * gamma_dot**2 * np.sin(2.0 * theta),
            -GRAVITY * np.sin(beta) * np.sin(theta),
            -GRAVITY * np.sin(gamma) * np.cos(beta) * np.cos(theta),
            -theta_dot,
        ],
        axis=1,
    )


def _kernel_times(model: DualForm, vector: Array) -> Array:
    """K vector (N,), with K = kernel_scale exp(-|x - x'|^2 / 2) on inputs in units of their lengths."""
    x = (model.inputs - model.inputs.mean(axis=0)) / model.lengths
    square = np.sum(x**2, axis=1)
    out = np.empty(len(x))
    for first in range(0, len(x), max(1, BLOCK // len(x))):
        part = slice(first, first + max(1, BLOCK // len(x)))
        distance = square[part, None] + square - 2.0 * (x[part] @ x.T)
        out[part] = model.kernel_scale * np.exp(-0.5 * np.maximum(distance, 0.0)) @ vector
    return out


def import_ring(model: DualForm, *, advance: Advance = no_advance) -> ImportedRing:
    """The measurements of a model, with the samples between the published rows. Raises ModelError."""
    data = training_data(model)
    step = sampling_step(data.rows)
    starts = segment_starts(data.rows, step)
    parts, squares, counts = [], np.zeros(2), np.zeros(2)
    for number, (first, last) in enumerate(zip(starts, [*starts[1:], len(model.alpha)], strict=True)):
        rows = data.rows[int(first) : int(last)]
        path = recover(rows, step)
        squares, counts = squares + path.squares, counts + path.counts
        parts.append(_columns(rows, path.angles, step, model.ring, number))
        advance(int(first) + len(rows.theta_ddot), len(model.alpha))
    rms = np.sqrt(squares / np.maximum(counts, 1))
    return ImportedRing(
        ring=model.ring,
        file=model.file,
        step=step,
        columns={name: np.concatenate([part[name] for part in parts]) for name in parts[0]},
        segments=len(starts),
        noise=model.target_scale * float(np.sqrt(data.noise_variance)),
        noise_variance=data.noise_variance,
        checks={**data.checks, "rate_filter": float(rms[0]), "acceleration": float(rms[1])},
    )


def _columns(rows: Published, angles: Array, step: int, ring: int, segment: int) -> dict[str, Array]:
    """Columns (M,) of one segment; every `step`-th row was published."""
    length = len(angles)
    columns = {
        "ring": np.full(length, float(ring)),
        "segment": np.full(length, float(segment)),
        "t": np.arange(length) / RATE_HZ,
        "measured": (np.arange(length) % step == 0).astype(float),
    }
    columns |= {axis: angles[:, i] for i, axis in enumerate(AXES)}
    for order, window in ((1, RATE), (2, ACCELERATION)):
        for i, axis in enumerate(AXES):
            derivative = np.full(length, np.nan)
            if length > 2 * EDGE:
                derivative[EDGE:-EDGE] = np.correlate(angles[:, i], window, "valid") * RATE_HZ**order
            columns[axis + "_" + "d" * order + "ot"] = derivative
    for i, axis in enumerate(AXES):
        columns[f"{axis}_dot_pub"] = np.full(length, np.nan)
        columns[f"{axis}_dot_pub"][::step] = rows.rates[:, i]
    columns["theta_ddot_pub"] = np.full(length, np.nan)
    columns["theta_ddot_pub"][::step] = rows.theta_ddot
    return columns


def write_ring(imported: ImportedRing, path: str | Path) -> None:
    """Write the table of a ring as CSV, with nine digits and empty cells for NaN. Raises ModelError."""
    path = Path(path)
    table = pd.DataFrame(imported.columns).astype(dict.fromkeys(("ring", "segment", "measured"), int))
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with whole_file(path) as beside:
            table.to_csv(beside, index=False, float_format="%.9g", lineterminator="\n", encoding="utf-8")
    except OSError as problem:
        raise ModelError(f"cannot be written: {problem.strerror}", file=path) from None
