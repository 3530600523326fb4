"""Files of arrays (.npz) that a YAML file names: read without pickle and checked before use.

The YAML file has the SHA-256 of each file: a file that was changed is refused.
"""

from __future__ import annotations

import hashlib
import io
import zipfile
from pathlib import Path
from typing import Any

import numpy as np

from mazeplan.core.whole_file import whole_file

MOST_BYTES = 64 << 20


def write_content(path: Path, content: bytes) -> dict[str, Any]:
    """Write a file of arrays. Returns name and hash for its entry."""
    with whole_file(path) as beside:
        beside.write_bytes(content)
    return {"file": path.name, "sha256": hashlib.sha256(content).hexdigest()}


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
