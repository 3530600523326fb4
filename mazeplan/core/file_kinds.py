"""What kind of file a path holds, by its content; for messages that refuse a wrong file.

path                          got
----------------------------  ------------------------------------------
not there                     no such file
a folder                      a folder | the folder of a model
no bytes                      an empty file
may not be read               a file that may not be read (reason)
FF FE, FE FF                  UTF-16 text, not UTF-8
%PNG, MCAP, PDF, zip ...      a PNG picture | a run log (MCAP) | ...
text                          XML | JSON | YAML | a table (CSV) | text
other bytes                   a binary file
"""

from __future__ import annotations

import os
import re
import stat
from pathlib import Path
from typing import Any

HEAD = 4096  # bytes that are read
LOG = "a log (MCAP)"
MAGIC = (
    (b"\xff\xfe", "UTF-16 text, not UTF-8"),
    (b"\xfe\xff", "UTF-16 text, not UTF-8"),
    (b"\x89PNG\r\n", "a PNG picture"),
    (b"\xff\xd8\xff", "a JPEG picture"),
    (b"GIF8", "a GIF picture"),
    (b"%PDF", "a PDF"),
    (b"\x89MCAP0\r\n", LOG),
    (b"PK\x03\x04", "a zip archive"),
    (b"\x1f\x8b", "a gzip archive"),
    (b"\x89HDF\r\n", "an HDF5 file"),
    (b"MATLAB 5.0 MAT-file", "a MATLAB file"),
    (b"\x7fELF", "a program"),
)
_CONTROL = re.compile(rb"[\x00-\x08\x0e-\x1a\x1c-\x1f]")


def got(path: str | Path) -> str:
    """What is at a path, in a few words for `got ..., expected ...`; never raises."""
    try:
        mode = os.stat(path).st_mode
        if stat.S_ISDIR(mode):
            return "the folder of a model" if (Path(path) / "model.yaml").is_file() else "a folder"
        if not stat.S_ISREG(mode):
            return "a device or pipe"
        with open(path, "rb") as stream:
            return _by_content(stream.read(HEAD))
    except FileNotFoundError:
        return "no such file"
    except (OSError, ValueError) as problem:  # ValueError: a name with a zero byte
        return f"a file that may not be read ({getattr(problem, 'strerror', None) or problem})"


def refused(path: str | Path, expected: str) -> str:
    """The message for a wrong file: what was got, what is expected."""
    what = got(path)
    return f"{what}, expected {expected}" if what == "no such file" else f"got {what}, expected {expected}"


def by_keys(data: Any) -> str:
    """Which kind of YAML file of this program has such content: a map, a model ... Empty if unknown."""
    keys = set(data) if isinstance(data, dict) else set[str]()
    if {"rings", "stage"} <= keys:
        return "a model (model.yaml)"
    if {"rings", "openings"} <= keys or {"rings", "ball"} <= keys:
        return "a map"
    if "class" in keys or {"camera_noise_mm", "tilt_noise_deg"} & keys:
        return "the file of a rig"
    return "a schedule of faults" if keys - {"format"} == {"faults"} else ""


def _by_content(head: bytes) -> str:
    if not head:
        return "an empty file"
    for magic, name in MAGIC:
        if head.startswith(magic):
            return name
    try:
        text = head.decode("utf-8-sig")
    except UnicodeDecodeError as problem:
        if problem.start < len(head) - 4 or len(head) < HEAD:  # else a character was cut in two
            return "a binary file" if _CONTROL.search(head) else "text that is not UTF-8"
        text = head[: problem.start].decode("utf-8-sig")
    if _CONTROL.search(head):
        return "a binary file"
    return _by_text(text)


def _by_text(text: str) -> str:
    if not text.strip():
        return "a file with nothing but blanks"
    rows = [row for row in text.splitlines() if row.strip() and not row.lstrip().startswith("#")]
    first = rows[0] if rows else ""
    if first.lstrip().startswith("<"):
        return "HTML" if re.match(r"\s*<(!doctype html|html)", first, re.IGNORECASE) else "XML"
    if first.lstrip().startswith(("{", "[")):
        return "JSON"
    if re.match(r"\s*(- )?[\w-]+:(\s|$)", first):
        return "YAML"
    return "a table (CSV)" if len(rows) > 1 and first.count(",") == rows[1].count(",") > 0 else "text"
