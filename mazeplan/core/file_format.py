"""Format numbers of mazeplan's files, and the message that refuses a file with another number.

`format: N` stands at the top of a file. A file without it has format 1. A number grows only when an older mazeplan
would read the file wrongly; new keys alone do not change it. A file of a higher format names in `version` the mazeplan
that wrote it. Readers look at the number before anything else in the file.
"""

from __future__ import annotations

from importlib.metadata import version as version_of
from typing import Any


def format_problem(given: Any, reads: int, written_by: Any = None) -> str | None:
    """Why a file with this format number cannot be read, and what to do; None for a file that can be read.

    given:      the number in the file
    reads:      the only number that can be read
    written_by: the version of mazeplan in the file, if the file names one
    """
    if isinstance(given, int) and not isinstance(given, bool):
        if given == reads:
            return None
        if given > reads:
            return f"got {given}, expected {reads}{advice(written_by)}"
    return f"got {str(given)[:40]!r}, expected {reads}" if isinstance(given, str) else f"got {given}, expected {reads}"


def advice(written_by: Any) -> str:
    """End of a message about a file of a newer format: what to do."""
    this = version_of("mazeplan")
    known = isinstance(written_by, str) and written_by.isprintable() and 0 < len(written_by) <= 40
    wanted = f"{written_by} or newer" if known and written_by != this else f"newer than {this}"
    return f", which mazeplan {this} reads; install a mazeplan {wanted} to read this file"
