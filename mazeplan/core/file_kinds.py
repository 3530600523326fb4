"""What kind of file a path holds, by its first bytes; for messages that refuse a wrong file."""

from __future__ import annotations

from pathlib import Path

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
