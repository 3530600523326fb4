"""The firmware's parser and control, compiled for this machine with sanitizers; shared by tests."""

from __future__ import annotations

import os
import shutil
import subprocess
from pathlib import Path

import pytest

FIRMWARE = Path(__file__).resolve().parent.parent / "tools" / "firmware"
NEEDED = os.environ.get("MAZEPLAN_EMULATOR") == "needed"  # set where the compilers must be: nothing is skipped there


class Native:
    """The program, in three ways to use it."""

    def __init__(self, program: Path) -> None:
        self.program = program

    def run(self, *arguments: str, given: bytes = b"") -> str:
        """Its output. Fails with what the sanitizers say."""
        done = subprocess.run([self.program, *arguments], input=given, capture_output=True, timeout=60, check=False)
        assert done.returncode == 0, done.stderr.decode()
        return done.stdout.decode()

    def frames(self, data: bytes) -> tuple[list[str], int]:
        """Bodies of good frames, and how many were given up."""
        *lines, bad = self.run("frames", given=data).splitlines()
        return [line.split("\t")[0] for line in lines], int(bad.split()[1])

    def control(self, *orders: str) -> list[str]:
        """One line for each order."""
        return self.run("control", given="".join(order + "\n" for order in orders).encode()).splitlines()


@pytest.fixture(scope="session")
def native(tmp_path_factory: pytest.TempPathFactory) -> Native:
    if not NEEDED and not (shutil.which("cc") and shutil.which("make")):
        pytest.skip("no C compiler here")
    folder = tmp_path_factory.getbasetemp() / "native"  # made once, whoever asks
    make = ["make", "-s", "-C", FIRMWARE, f"OUT={folder}", "native"]
    made = subprocess.run(make, capture_output=True, text=True, check=False)
    assert made.returncode == 0, made.stderr
    return Native(folder / "native")
