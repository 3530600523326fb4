"""Arrays of a Gaussian process beside a model file: ringN.npz."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

import numpy as np

from mazeplan.core.array_file import MOST_BYTES, arrays_of, content_of, write_content
from mazeplan.core.errors import ModelError
from mazeplan.learning.features import INPUTS
from mazeplan.learning.gaussian_process import GaussianProcess, Hyperparameters, KernelTerm

MOST_ROWS = 20_000
MOST_NAME = 20  # maximum length of the name of a kernel


def write_process(folder: Path, ring: int, process: GaussianProcess) -> dict[str, Any]:
    """Write ringN.npz into the folder. Returns its entry for model.yaml.

    Inputs are stored in single precision, see `rounded`."""
    h, only, stream = process.hyper, process.hyper.only, io.BytesIO()
    np.savez_compressed(
        stream,
        inputs=process.inputs.astype(np.float32),
        alpha=process.alpha,
        columns=np.array(only.columns, dtype=np.int64),
        lengthscales=np.asarray(only.lengthscales, dtype=np.float64),
        amplitude=np.array(only.amplitude),
        noise=np.array(h.noise),
        family=np.array(h.family),
    )
    return write_content(folder / f"ring{ring}.npz", stream.getvalue())


def rounded(inputs: np.ndarray) -> np.ndarray:
    """Inputs rounded to single precision. Condition on rounded inputs, so that the file loses nothing."""
    return inputs.astype(np.float32).astype(np.float64)


def read_process(folder: Path, file: str, sha256: str) -> GaussianProcess:
    """The Gaussian process in a file that is named in model.yaml. Raises ValueError."""
    content = content_of(folder, file, sha256)
    try:
        held = arrays_of(content, MOST_BYTES)
        inputs, alpha = held["inputs"], held["alpha"]
        columns, lengthscales = tuple(held["columns"].tolist()), held["lengthscales"]
        whole = alpha.shape == inputs.shape[:1] and inputs.shape[1:] == (len(INPUTS),) and 0 < len(alpha) <= MOST_ROWS
        whole &= np.isfinite(inputs).all() and np.isfinite(alpha).all() and lengthscales.shape == (len(columns),)
        whole &= columns == tuple(sorted(set(columns) & set(range(len(INPUTS)))))
        if not whole:
            raise ValueError(f"got inputs {inputs.shape}, alpha {alpha.shape}, columns {columns}")
        term = KernelTerm(columns, lengthscales, float(held["amplitude"]))
        hyper = Hyperparameters((term,), float(held["noise"]), np.zeros(0), str(held["family"])[:MOST_NAME])
    except (ValueError, KeyError, TypeError, ModelError) as problem:
        raise ValueError(f"{file} has no Gaussian process: {' '.join(str(problem).split())}") from None
    none = np.zeros((len(alpha), 0))
    return GaussianProcess(hyper, inputs.astype(np.float64), none, alpha, np.zeros(0), np.zeros((0, 0)))
