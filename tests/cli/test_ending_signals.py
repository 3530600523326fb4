"""SIGTERM and SIGHUP end a run as Ctrl-C does: plate level, log complete; and a key at the terminal, at once."""

from __future__ import annotations

import os
import pty
import select
import signal
import subprocess
import sys
import termios
import time

import pytest

from mazeplan.cli.emergency import stop_key
from mazeplan.data.runlog import read_log

MAIN = "import mazeplan.cli, sys; sys.argv = ['mazeplan', *sys.argv[1:]]; mazeplan.cli.main()"
RIG = """
import pathlib, time
from mazeplan.testing.lightrig import LightRig

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


@pytest.mark.parametrize(("number", "status"), [(signal.SIGTERM, 143), (signal.SIGHUP, 129)])
def test_signals_that_end_the_program_level_the_plate_first(place, number, status):
    process = subprocess.Popen(
        [sys.executable, "-c", MAIN, *ARGUMENTS], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
        preexec_fn=lambda: signal.signal(number, signal.SIG_DFL),
    )  # fmt: skip
    assert process.stdout is not None
    for _ in range(5):
        process.stdout.readline()
    process.send_signal(number)
    _, err = process.communicate(timeout=60)
    assert process.returncode == status
    assert err.splitlines()[-1] == f"mazeplan: {number.name}"
    assert "Traceback" not in err
    assert (place / "levelled").exists()
    assert read_log(place / "run.mcap").result["reason"] == "interrupted"


def test_a_key_at_the_terminal_stops_the_rig_at_once_and_leaves_the_terminal_as_it_was(place):
    child, master = pty.fork()  # the child has a terminal of its own, as it would at a person's desk
    if child == 0:
        os.execv(sys.executable, [sys.executable, "-c", MAIN, *ARGUMENTS])
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


def test_rigs_that_cannot_be_stopped_and_programs_without_a_terminal_touch_none(tmp_path):
    class Plain:
        pass

    class Stoppable:
        def stop(self):
            raise AssertionError

    with stop_key(Plain(), lambda: None) as listens:
        assert not listens
    with stop_key(Stoppable(), lambda: None, terminal=str(tmp_path / "none")) as listens:
        assert not listens
    master, slave = pty.openpty()  # a terminal, but not ours
    before = termios.tcgetattr(slave)
    with stop_key(Stoppable(), lambda: None, terminal=os.ttyname(slave)) as listens:
        assert not listens
        os.write(master, b"x\n")
        assert termios.tcgetattr(slave) == before
    os.close(master)
    os.close(slave)
