"""Arrays of a Gaussian process beside a model file: ringN.npz, read without pickle and checked before use.

model.yaml has the SHA-256 of each file: a file that was changed is refused.
"""

from __future__ import annotations

import hashlib
import io
import zipfile
from pathlib import Path
from typing import Any

import numpy as np

from mazeplan.core.errors import ModelError
from mazeplan.core.whole_file import whole_file
from mazeplan.learning.features import INPUTS
from mazeplan.learning.gaussian_process import GaussianProcess, Hyperparameters, KernelTerm

MOST_ROWS = 20_000
MOST_BYTES = 64 << 20
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


def write_content(path: Path, content: bytes) -> dict[str, Any]:
    """Write a file of arrays. Returns name and hash for its entry."""
    with whole_file(path) as beside:
        beside.write_bytes(content)
    return {"file": path.name, "sha256": hashlib.sha256(content).hexdigest()}


def rounded(inputs: np.ndarray) -> np.ndarray:
    """Inputs rounded to single precision. Condition on rounded inputs, so that the file loses nothing."""
    return inputs.astype(np.float32).astype(np.float64)


def content_of(folder: Path, name: str, sha256: str) -> bytes:
    """The content of a file. Raises ValueError if it is not the file that was saved."""
    path = folder / name
    if Path(name).name != name or path.suffix != ".npz":
        raise ValueError(f"file: got {name!r}, expected the name of an .npz file beside model.yaml")
    try:
        if path.stat().st_size > MOST_BYTES:
            raise ValueError(f"{name} is larger than {MOST_BYTES} bytes")
        content = path.read_bytes()
    except OSError as problem:
        raise ValueError(f"{name} cannot be read: {problem.strerror}") from None
    if hashlib.sha256(content).hexdigest() != sha256:
        raise ValueError(f"{name} is not the file that was saved here (its sha256 differs)")
    return content


def arrays_of(content: bytes, most: int) -> dict[str, np.ndarray]:
    """The arrays of an .npz file of at most `most` bytes, without pickle. Raises ValueError."""
    try:
        with zipfile.ZipFile(io.BytesIO(content)) as archive:
            if sum(member.file_size for member in archive.infolist()) > most:
                raise ValueError(f"it unpacks to more than {most} bytes")
        with np.load(io.BytesIO(content), allow_pickle=False) as held:
            return {name: held[name] for name in held.files}
    except Exception as problem:  # zipfile, zlib and numpy raise a dozen kinds for a damaged or malicious file
        raise ValueError(" ".join(str(problem).split())) from None


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
