"""Output of commands: results on stdout (with --json exactly one document), messages on stderr."""

from __future__ import annotations

import json
import os
import sys
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import count
from pathlib import Path
from typing import Any

from mazeplan.core.errors import ShortWarning
from mazeplan.core.results import finite


def print_json(document: Any) -> None:
    """Print one JSON document on stdout."""
    print(json.dumps(finite(document), indent=2), file=sys.stdout)


def print_result(as_json: bool, document: Any, *lines: str) -> None:
    """Print a result on stdout: its document, or lines for a person."""
    if as_json:
        print_json(document)
    elif lines:
        print("\n".join(lines))


def say(text: str) -> None:
    """Print a message on stderr. If stderr cannot be written, this and all later messages are dropped."""
    try:
        print(text, file=sys.stderr, flush=True)
    except OSError:
        sys.stderr = open(os.devnull, "w", encoding="utf-8")  # noqa: SIM115  open until the end


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
