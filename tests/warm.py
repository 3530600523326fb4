"""Programs in processes of their own that begin warm.

A command that drives a rig takes three seconds to import libraries and to load compiled code. A server process does
both once. Each program is a fork of it, with its own folder, arguments, streams and memory. Where the start is itself
the subject, use `commands.start`.
"""

from __future__ import annotations

import multiprocessing
import os
import runpy
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from functools import cache
from multiprocessing.forkserver import ensure_running
from pathlib import Path
from types import ModuleType

import pytest

LIMIT_S = 300.0  # of one program
TESTS = Path(__file__).resolve().parent
SERVER = multiprocessing.get_context("forkserver")


def found() -> dict[str, str]:
    """The environment, in which Python finds the package and the modules of the tests."""
    folders = [str(TESTS.parent), str(TESTS), os.environ.get("PYTHONPATH", "")]
    return {**os.environ, "PYTHONPATH": os.pathsep.join(folders)}


@cache
def _started() -> None:
    """Start the server. It finds modules by the environment alone (CPython issue 126631)."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("PYTHONPATH", found()["PYTHONPATH"])
        SERVER.set_forkserver_preload(["warm_modules"])
        ensure_running()


def run(words: Sequence[str], cwd: Path) -> subprocess.CompletedProcess[str]:
    """The result of `python -m WORDS`, or of `python -c TEXT` for the words ("-c", text). Raises TimeoutExpired."""
    _started()
    with tempfile.TemporaryDirectory() as folder:
        streams = [Path(folder, name) for name in ("stdout", "stderr")]
        process = SERVER.Process(target=_program, args=(list(words), str(cwd), *map(str, streams)))
        process.start()
        process.join(LIMIT_S)
        if process.exitcode is None:
            process.kill()
            raise subprocess.TimeoutExpired(list(words), LIMIT_S)
        out, err = (stream.read_text(encoding="utf-8") for stream in streams)
        return subprocess.CompletedProcess(list(words), process.exitcode, out, err)


def _program(words: list[str], cwd: str, *streams: str) -> None:
    """The program itself, in its process."""
    for number, path in enumerate(streams, start=1):
        file = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
        os.dup2(file, number)
    os.chdir(cwd)
    sys.path.insert(0, cwd)  # as `python -m` and `python -c` do
    if words[0] == "-c":
        sys.argv, sys.modules["__main__"] = ["-c"], (program := ModuleType("__main__"))
        exec(compile(words[1], "<program>", "exec"), vars(program))
    else:
        sys.argv = words
        runpy.run_module(words[0], run_name="__main__", alter_sys=True)
