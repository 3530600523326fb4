"""What goes where: with --json exactly one document on stdout; everything else that is not a result on stderr."""

from __future__ import annotations

import json
import math
import sys
from contextlib import suppress
from typing import Any


def finite(value: Any) -> Any:
    """The same document with NaN and infinities as null, which JSON has no words for."""
    if isinstance(value, dict):
        return {key: finite(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [finite(item) for item in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value


def print_json(document: Any) -> None:
    """Print one JSON document on stdout."""
    print(json.dumps(finite(document), indent=2), file=sys.stdout)


def say(text: str) -> None:
    """Tell a person something on stderr; what it does not take is dropped."""
    with suppress(OSError):
        print(text, file=sys.stderr)
