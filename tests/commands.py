"""A command as a person would give it, within this process."""

from __future__ import annotations

import re
import sys
from typing import Any

import pytest

from mazeplan.cli import main


def call(
    monkeypatch: pytest.MonkeyPatch, capsys: Any, *arguments: object, terminal: bool = False
) -> tuple[int, str, str]:
    """Exit status, stdout and stderr of `mazeplan` with these arguments; terminal: stderr is said to be one."""
    monkeypatch.setattr("mazeplan.cli.progress.is_terminal", lambda stream: terminal)
    monkeypatch.setattr("mazeplan.cli.progress.COMPILING_S", 1e6)  # s; who compiles first is a matter of chance here
    monkeypatch.setenv("COLUMNS", "120")
    monkeypatch.setattr(sys, "argv", ["mazeplan", *map(str, arguments)])
    try:
        main()
        code = 0
    except SystemExit as stop:
        code = stop.code or 0
    got = capsys.readouterr()
    return int(code), got.out, got.err


def plain(drawn: str) -> str:
    """What was drawn on a terminal, without the codes that move the cursor and colour."""
    return re.sub(r"\x1b\[[0-9;?]*[A-Za-z]", "", drawn).replace("\r", "\n")
