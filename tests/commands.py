"""A command as a person would give it: within this process, or in one of its own."""

from __future__ import annotations

import re
import signal
import subprocess
import sys
from typing import Any

import pytest

from mazeplan.apps.cli import main


def call(
    monkeypatch: pytest.MonkeyPatch, capsys: Any, *arguments: object, terminal: bool = False
) -> tuple[int, str, str]:
    """Exit status, stdout and stderr of `mazeplan` with these arguments; terminal: stderr is taken for one."""
    monkeypatch.setattr("mazeplan.apps.cli.progress.is_terminal", lambda stream: terminal)
    monkeypatch.setenv("COLUMNS", "120")
    monkeypatch.setattr(sys, "argv", ["mazeplan", *map(str, arguments)])
    try:
        main()
        code = 0
    except SystemExit as stop:
        code = stop.code or 0
    got = capsys.readouterr()
    return int(code), got.out, got.err


def start(*arguments: object, **options: Any) -> subprocess.Popen[str]:
    """`mazeplan` with these arguments in a process of its own, which takes signals as at a terminal."""

    def listen() -> None:  # a shell lets what it runs in the background ignore Ctrl-C
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
            signal.signal(number, signal.SIG_DFL)

    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    words = [sys.executable, "-m", "mazeplan", *map(str, arguments)]
    return subprocess.Popen(words, preexec_fn=listen, **{**pipes, **options})


def plain(drawn: str) -> str:
    """The text drawn on a terminal, without control codes for cursor and colour."""
    return re.sub(r"\x1b\[[0-9;?]*[A-Za-z]", "", drawn).replace("\r", "\n")
