"""Output of commands: with --json exactly one document on stdout; messages on stderr; files."""

from __future__ import annotations

import json
import math
import sys
import warnings
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from mazeplan.core.errors import InputError
from mazeplan.core.resources import BothWarning


def finite(value: Any) -> Any:
    """The same document with null for NaN and infinities, which JSON cannot hold."""
    if isinstance(value, dict):
        return {key: finite(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [finite(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def print_json(document: Any) -> None:
    """Print one JSON document on stdout."""
    print(json.dumps(finite(document), indent=2), file=sys.stdout)


def say(text: str) -> None:
    """Print a message on stderr; ignore a stderr that cannot be written."""
    with suppress(OSError):
        print(text, file=sys.stderr)


@contextmanager
def short_warnings() -> Iterator[None]:
    """Within this a BothWarning is one line on stderr, once for each name."""
    said = set[str]()
    with warnings.catch_warnings():
        warnings.simplefilter("always", BothWarning)
        before = warnings.showwarning

        def show(message: Warning | str, category: type[Warning], *more: Any) -> None:
            if not issubclass(category, BothWarning):
                before(message, category, *more)
            elif str(message) not in said:
                said.add(str(message))
                say(f"mazeplan: {message}")

        warnings.showwarning = show  # pyright: ignore[reportAttributeAccessIssue]
        yield


def write_text(path: Path, text: str) -> None:
    """Write a file and the folders above it. Raises InputError."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")
    except OSError as problem:
        raise InputError(f"cannot be written: {problem.strerror or problem}", file=path) from None


def plural(count: int, noun: str) -> str:
    """`1 block`, `2 blocks`."""
    return f"{count} {noun}{'s' * (count != 1)}"
