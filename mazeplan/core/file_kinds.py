"""Messages that refuse a wrong file: another kind of file, by its first bytes, or one of another format.

`format: N` stands at the top of a file. A file without it has format 1. A number grows only when an older mazeplan
would read the file wrongly; new keys alone do not change it. A file of a higher format names in `version` the mazeplan
that wrote it. Readers look at the number before anything else in the file.
"""

from __future__ import annotations

from importlib.metadata import version as version_of
from pathlib import Path
from typing import Any

HEAD = 4096  # bytes that are read
LOG = "a log (MCAP)"
MAGIC = ((b"\x89MCAP0\r\n", LOG), (b"MATLAB 5.0 MAT-file", "a MATLAB file"))


def got(path: str | Path) -> str:
    """What is at a path, in a few words for `got ..., expected ...`; never raises."""
    try:
        if Path(path).is_dir():
            return "a folder"
        if Path(path).exists() and not Path(path).is_file():
            return "a device or pipe"
        with open(path, "rb") as stream:
            head = stream.read(HEAD)
    except FileNotFoundError:
        return "no such file"
    except (OSError, ValueError) as problem:  # ValueError: a name with a zero byte
        return f"a file that may not be read ({getattr(problem, 'strerror', None) or problem})"
    for magic, name in MAGIC:
        if head.startswith(magic):
            return name
    text = head.decode("utf-8-sig", errors="ignore")  # a character may be cut in two
    if b"\0" in head or len(text.encode()) < len(head) - 8:
        return "a binary file, or text that is not UTF-8"
    if not text.strip():
        return "an empty file"
    first = text.lstrip()[0]
    return "XML" if first == "<" else "JSON" if first in "{[" else "text"


def refused(path: str | Path, expected: str) -> str:
    """The message for a wrong file: what was got, what is expected."""
    what = got(path)
    return f"{what}, expected {expected}" if what == "no such file" else f"got {what}, expected {expected}"


def format_problem(given: Any, reads: int, written_by: Any = None) -> str | None:
    """Why a file with this format number cannot be read, and what to do; None for a file that can be read.

    given:      the number in the file
    reads:      the only number that can be read
    written_by: the version of mazeplan in the file, if the file names one
    """
    if given == reads and not isinstance(given, bool):
        return None
    problem, this = f"got {str(given)[:40]!r}, expected {reads}", version_of("mazeplan")
    if not isinstance(given, int) or given < reads:
        return problem
    wanted = f"newer than {this}"
    if isinstance(written_by, str) and written_by.isprintable() and 0 < len(written_by) <= 40 and written_by != this:
        wanted = f"{written_by} or newer"
    return f"got {given}, expected {reads}, which mazeplan {this} reads; install a mazeplan {wanted} to read this file"
