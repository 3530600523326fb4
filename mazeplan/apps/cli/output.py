"""Output of commands: results on stdout (with --json exactly one document), messages on stderr, and files."""

from __future__ import annotations

import json
import os
import re
import sys
import warnings
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from itertools import count
from pathlib import Path
from typing import Any

from mazeplan.core.errors import InputError, ShortWarning
from mazeplan.core.results import finite
from mazeplan.core.whole_file import is_stream


def print_json(document: Any) -> None:
    """Print one JSON document on stdout."""
    print(json.dumps(finite(document), indent=2), file=sys.stdout)


def say(text: str) -> None:
    """Print a message on stderr. Do nothing if stderr cannot be written."""
    with suppress(OSError):
        print(text, file=sys.stderr)


def check_new(option: str, path: Path, force: bool, *, folder: bool = False) -> None:
    """Raises InputError for a file that exists, or a folder with files that are not hidden, unless `force` is true.

    option: name of the option, for the message
    folder: whether the path is a folder

    Devices and pipes, such as /dev/null, may always be written."""
    if not folder and os.path.isdir(path):
        raise InputError(f"{option}: {path} is a folder; expected the name of a file")
    there = _filled(path) if folder else os.path.lexists(path) and not is_stream(path)
    if there and not force:
        what = "files in it" if folder else "it"
        raise InputError(f"{option}: {path} exists; expected a new name, or --force to replace {what}")


def _filled(folder: Path) -> bool:
    """Whether a folder exists and has files that are not hidden. A folder that cannot be listed counts as filled."""
    try:
        return any(not name.startswith(".") for name in os.listdir(folder))
    except OSError:
        return os.path.isdir(folder)


def free_name(path: Path, number: int = 1) -> Path:
    """The first of the names FILE, FILE-2, FILE-3 ... that no file has. number: the first number to try"""
    names = (path if n == 1 else path.with_stem(f"{path.stem}-{n}") for n in count(number))
    return next(name for name in names if not os.path.lexists(name))


@contextmanager
def short_warnings() -> Iterator[None]:
    """Within this context, each ShortWarning prints one line on stderr, and only once."""
    said = set[str]()
    with warnings.catch_warnings():
        warnings.simplefilter("always", ShortWarning)
        before = warnings.showwarning

        def show(message: Warning | str, category: type[Warning], *more: Any) -> None:
            if not issubclass(category, ShortWarning):
                before(message, category, *more)
            elif str(message) not in said:
                said.add(str(message))
                say(f"mazeplan: {message}")

        warnings.showwarning = show  # pyright: ignore[reportAttributeAccessIssue]
        yield


def plural(count: int, noun: str) -> str:
    """`1 block`, `2 blocks`."""
    return f"{count} {noun}{'s' * (count != 1)}"


def headline(path: Path) -> str:
    """The first sentence of the comment at the beginning of a packaged file; empty without a comment."""
    words = []
    for line in path.read_text(encoding="utf-8").splitlines():
        if not line.startswith("#"):
            break
        words.append(line.lstrip("# "))
    return re.split(r"(?<=[.;])\s", " ".join(words))[0].rstrip(".;")
