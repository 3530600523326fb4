"""Signals and a key at the terminal end a run with a level plate and a complete log."""

from __future__ import annotations

import os
import pty
import select
import signal
import sys
import termios
import threading
import time

import pytest
from commands import start

from mazeplan.apps.cli import emergency
from mazeplan.apps.cli.emergency import stop_key
from mazeplan.core.errors import RigError
from mazeplan.core.logs.run_log_reader import read_log

RIG = """
import pathlib, time
from mazeplan.apps.testing.lightrig import LightRig

class Slow(LightRig):
    realtime = True
    stopped = False
    def observe(self):
        print("now", flush=True)
        time.sleep(0.03)
        return super().observe()
    def command(self, u_beta, u_gamma):
        super().command(0.0 if self.stopped else u_beta, 0.0 if self.stopped else u_gamma)
    def level(self):
        super().level()
        with pathlib.Path("levelled").open("a") as file:
            file.write("x")
    def stop(self):
        self.stopped = True
        pathlib.Path("stopped").write_text(str(time.monotonic()))
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


@pytest.mark.slow
def test_a_key_stops_the_rig_at_once_and_leaves_the_terminal_as_it_was(place):
    child, master = pty.fork()  # the child has a terminal of its own
    if child == 0:
        os.execv(sys.executable, [sys.executable, "-m", "mazeplan", *ARGUMENTS])
    before, said, pressed = termios.tcgetattr(master), b"", 0.0
    while True:
        try:
            ready, _, _ = select.select([master], [], [], 60.0)
            assert ready
            said += os.read(master, 4096)
        except OSError:  # the child has ended
            break
        if not pressed and said.count(b"now") > 5:
            assert not termios.tcgetattr(master)[3] & termios.ICANON
            pressed = time.monotonic()
            os.write(master, b" ")
    _, status = os.waitpid(child, 0)
    assert os.waitstatus_to_exitcode(status) == 1
    assert b"any key stops the rig" in said
    assert b"emergency stop: the plate is level" in said
    assert float((place / "stopped").read_text()) - pressed < 2.0
    assert read_log(place / "run.mcap").result["reason"] == "stopped"
    assert termios.tcgetattr(master)[3] == before[3]
    os.close(master)


@pytest.mark.parametrize("works", [True, False])
def test_a_key_ends_the_run_also_if_the_rig_does_not_stop(monkeypatch, capsys, works):
    class Stoppable:
        def stop(self):
            if not works:
                raise RigError("fake: is not open")

    master, slave = pty.openpty()
    monkeypatch.setattr(emergency, "_foreground", lambda fd: True)
    ended = threading.Event()
    with stop_key(Stoppable(), ended.set, terminal=os.ttyname(slave)) as listens:
        assert listens
        os.write(master, b"x")
        assert ended.wait(5.0)
    said = "emergency stop: the plate is level" if works else "did not stop: fake: is not open; cut its power"
    assert said in capsys.readouterr().err
    os.close(master)
    os.close(slave)
