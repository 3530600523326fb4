"""Signals end a run with a level plate and a complete log."""

from __future__ import annotations

import signal

import pytest
from commands import start

from mazeplan.core.logs.run_log import read_log

RIG = """
import pathlib, time
from mazeplan.apps.testing.lightrig import LightRig

class Slow(LightRig):
    realtime = True
    def observe(self):
        print("now", flush=True)
        time.sleep(0.03)
        return super().observe()
    def level(self):
        super().level()
        with pathlib.Path("levelled").open("a") as file:
            file.write("x")
"""
ARGUMENTS = ["navigate", "--rig", "slow_rig:Slow", "--model", "ideal", "--log", "run.mcap", "--time-limit", "60"]


@pytest.fixture
def place(tmp_path, monkeypatch):
    (tmp_path / "slow_rig.py").write_text(RIG)
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.slow
@pytest.mark.parametrize(
    ("number", "status", "message"),
    [(signal.SIGINT, 130, "interrupted"), (signal.SIGTERM, 143, "SIGTERM"), (signal.SIGHUP, 129, "SIGHUP")],
)
def test_a_signal_ends_the_run_with_a_level_plate_and_a_complete_log(place, number, status, message):
    process = start(*ARGUMENTS)
    assert process.stdout is not None
    for _ in range(5):
        process.stdout.readline()
    process.send_signal(number)
    _, err = process.communicate(timeout=60)
    assert process.returncode == status
    assert err.splitlines()[-1] == f"mazeplan: {message}"
    assert "Traceback" not in err
    assert (place / "levelled").exists()
    log = read_log(place / "run.mcap")
    assert (log.complete, log.result["reason"]) == (True, "interrupted")
