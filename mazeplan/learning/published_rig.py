"""Recover measurements from the published Gaussian-process models of the circular-maze rig.

The authors of the rig published, for each ring, a regression of the ball's acceleration in exact dual form: inputs X,
weights alpha of the kernel, weights w of seven features of the ball's equation. This form determines its training data:

    y = s K alpha + Phi w + s v alpha        s: standard deviation of y, v: noise variance in units of s^2

Only v is missing in the files. It is the root at which y has the published standard deviation. Only every 4th, 3rd and
2nd sample of rings 1 to 3 was published: `published_samples` recovers the samples between.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd

from mazeplan.core.errors import ModelError
from mazeplan.core.progress import Advance, no_advance
from mazeplan.core.records import Array
from mazeplan.core.whole_file import whole_file
from mazeplan.learning.gaussian_process import GaussianProcess, Hyperparameters, KernelTerm
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
COLUMNS = {
    "inputs": 9,
    "alpha": 1,
    "lengths": 9,
    "kernel_scale": 1,
    "input_scales": 9,
    "target_scale": 1,
    "weights": 7,
}
MAX_ROWS = 50_000  # the kernel takes rows^2 operations; the published models have at most 5820
MIN_ROWS = 8  # fewer do not show how the recording was thinned
MISFIT = 1e-3  # maximum relative difference from the weights that follow from alpha; matching files have 1e-12
STRANGERS = "do the files of this ring belong together?"


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


def find_models(folder: str | Path) -> dict[int, str]:
    """Ending of the file names of each ring's model; of several models, the one with the largest file of inputs.

    Raises ModelError."""
    folder = Path(folder)
    pattern = re.compile(re.escape(PREFIX["inputs"]) + r"(_ring([0-9]{1,2})_.*\.txt)")
    found: dict[int, tuple[int, str]] = {}
    try:
        for path in sorted(folder.iterdir()):
            match = pattern.fullmatch(path.name)
            if match is not None and path.is_file():
                size = (path.stat().st_size, match[1])
                found[int(match[2])] = max(size, found.get(int(match[2]), size))
    except OSError as problem:
        raise ModelError(f"{problem.strerror}, expected the folder of the published model files", file=folder) from None
    if not found:
        raise ModelError(f"no model in this folder, expected files {PREFIX['inputs']}_ring1_NAME.txt", file=folder)
    return {ring: ending for ring, (_, ending) in sorted(found.items())}


def read_model(folder: str | Path, ring: int, ending: str) -> DualForm:
    """The model whose files end in `ending`. Raises ModelError with the file."""
    paths = {name: Path(folder) / (prefix + ending) for name, prefix in PREFIX.items()}
    read = {name: _numbers(path, COLUMNS[name]) for name, path in paths.items()}
    rows = len(read["inputs"])
    for name, path in paths.items():
        expected, got = (rows if name == "alpha" else 1), len(read[name])
        if got != expected and name != "inputs":
            raise ModelError(f"got {got} rows of {COLUMNS[name]} numbers, expected {expected}", file=path)
    if not MIN_ROWS <= rows <= MAX_ROWS:
        raise ModelError(f"got {rows} rows, expected {MIN_ROWS} to {MAX_ROWS}", file=paths["inputs"])
    for name in ("lengths", "kernel_scale", "input_scales", "target_scale"):
        if not np.all(read[name] > 0.0):
            raise ModelError(f"got {read[name].min():g}, expected numbers > 0", file=paths[name], key=name)
    return DualForm(
        ring=ring,
        file=paths["inputs"],
        inputs=read["inputs"],
        input_scales=read["input_scales"][0],
        lengths=read["lengths"][0],
        kernel_scale=float(read["kernel_scale"][0, 0]),
        alpha=read["alpha"][:, 0],
        weights=read["weights"][0],
        target_scale=float(read["target_scale"][0, 0]),
    )


def _numbers(path: Path, width: int) -> Array:
    """The numbers of a text file, (N, width)."""
    try:
        found = np.array(path.read_text(encoding="ascii").split(), dtype=float)
    except (OSError, ValueError) as problem:
        raise ModelError(f"not a text file of numbers: {problem}", file=path) from None
    if len(found) % width or not np.all(np.isfinite(found)):
        raise ModelError(f"got {len(found)} numbers, expected finite ones, {width} to a row", file=path)
    return found.reshape(-1, width)


def training_data(model: DualForm) -> tuple[Published, float]:
    """The training data of a model, and its noise variance v. Raises ModelError if no noise fits the numbers."""
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
    prior = features.T @ model.alpha  # the weights are `prior` times their common prior variance
    ratio = (prior @ model.weights) / max(prior @ prior, np.finfo(float).tiny)
    if not np.max(np.abs(model.weights - ratio * prior)) < MISFIT * max(np.max(np.abs(model.weights)), 1e-300):
        raise ModelError(f"{PREFIX['weights']} does not follow from {PREFIX['alpha']}; {STRANGERS}", file=model.file)
    return Published(angles, x[:, :3], known + noise * slope), noise


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
    term = KernelTerm(tuple(range(len(model.lengths))), model.lengths, float(np.sqrt(model.kernel_scale)))
    none, hyper = np.zeros((len(vector), 0)), Hyperparameters((term,), 1.0, np.zeros(0))  # its noise has no effect
    process = GaussianProcess(hyper, model.inputs, none, vector, np.zeros(0), np.zeros((0, 0)))
    return process.mean(model.inputs)


def import_ring(model: DualForm, *, advance: Advance = no_advance) -> tuple[pd.DataFrame, dict[str, float]]:
    """The table of a model's measurements, with the samples between the published rows; and its figures:

    step:                  samples from one published row to the next
    published, recovered:  numbers of published rows, and of those between
    segments:              number of uninterrupted segments
    noise:                 standard deviation, rad/s^2
    noise_variance:        v, in units of target_scale^2

    Raises ModelError."""
    data, variance = training_data(model)
    step = sampling_step(data)
    starts = segment_starts(data, step)
    parts = []
    for number, (first, last) in enumerate(zip(starts, [*starts[1:], len(model.alpha)], strict=True)):
        rows = data[int(first) : int(last)]
        parts.append(_segment(rows, recover(rows, step), step, model.ring, number))
        advance(int(last), len(model.alpha))
    table = pd.concat(parts, ignore_index=True)
    published, noise = len(model.alpha), model.target_scale * float(np.sqrt(variance))
    return table, {
        "step": step, "published": published, "recovered": len(table) - published, "segments": len(starts),
        "noise": noise, "noise_variance": variance,
    }  # fmt: skip


def _segment(rows: Published, angles: Array, step: int, ring: int, segment: int) -> pd.DataFrame:
    """The table of one segment, NaN: unknown; every `step`-th row was published."""
    length, at = len(angles), np.arange(len(angles))
    columns = {"ring": np.full(length, ring), "segment": np.full(length, segment), "t": at / RATE_HZ}
    columns |= {"measured": (at % step == 0).astype(int), **dict(zip(AXES, angles.T, strict=True))}
    for order, window in ((1, RATE), (2, ACCELERATION)):
        for axis in AXES:
            derivative = columns[f"{axis}_{'d' * order}ot"] = np.full(length, np.nan)
            if length > 2 * EDGE:
                derivative[EDGE:-EDGE] = np.correlate(columns[axis], window, "valid") * RATE_HZ**order
    names = (*(f"{axis}_dot_pub" for axis in AXES), "theta_ddot_pub")
    for name, values in zip(names, (*rows.rates.T, rows.theta_ddot), strict=True):
        columns[name] = np.full(length, np.nan)
        columns[name][::step] = values
    return pd.DataFrame(columns)


def write_ring(table: pd.DataFrame, path: Path) -> None:
    """Write the table of a ring as CSV, with nine digits and empty cells for NaN. Raises ModelError."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with whole_file(path) as beside:
            table.to_csv(beside, index=False, float_format="%.9g", lineterminator="\n", encoding="utf-8")
    except OSError as problem:
        raise ModelError(f"cannot be written: {problem.strerror}", file=path) from None
