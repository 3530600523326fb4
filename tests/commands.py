"""A command as a person would give it, within this process."""

from __future__ import annotations

import sys
from typing import Any

import pytest

from mazeplan.cli import main


def call(monkeypatch: pytest.MonkeyPatch, capsys: Any, *arguments: object) -> tuple[int, str, str]:
    """Exit status, stdout and stderr of `mazeplan` with these arguments."""
    monkeypatch.setattr(sys, "argv", ["mazeplan", *map(str, arguments)])
    try:
        main()
        code = 0
    except SystemExit as stop:
        code = stop.code or 0
    got = capsys.readouterr()
    return int(code), got.out, got.err
