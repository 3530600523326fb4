"""Rigs and leaves that hang or break: the program ends by itself, in time, with status 3 and a reason."""

from __future__ import annotations

import json
import sys
import textwrap
import time

import pytest
from commands import start

from mazeplan.core.logs.run_log_reader import read_log
from mazeplan.rigs import watchdog

RIG = """
    import os, pathlib, threading, time
    from mazeplan.rigs.sim.simulated import SimulatedRig

    WHERE, HOW = os.environ["WHERE"], os.environ["HOW"]

    class Bad(SimulatedRig):
        realtime = True
        calls = 0
        def _maybe(self, name):
            if name == WHERE and (name in ("level", "close") or Bad.calls >= int(os.environ.get("AT", 10))):
                print("now", flush=True)
                if HOW == "raise":
                    raise OSError(5, "no answer")
                while True:
                    time.sleep(1000)
        def observe(self):
            Bad.calls += 1
            self._maybe("observe")
            return super().observe()
        def command(self, u_beta, u_gamma):
            self._maybe("command")
            super().command(u_beta, u_gamma)
        def level(self):
            self._maybe("level")
            super().level()
            with pathlib.Path("levelled").open("a") as file:
                file.write("x")
        def close(self):
            self._maybe("close")
            super().close()
"""
LEAF = """
    import os, threading, time
    from mazeplan import MazeLeaf, Status

    class Hang(MazeLeaf):
        def step(self):
            if self.context.now < 0.2:
                return Status.RUNNING
            print("now", flush=True)
            while os.environ["HOW"] == "busy":
                pass
            threading.Event().wait()
"""
TREE = '<root BTCPP_format="4" main_tree_to_execute="M"><BehaviorTree ID="M"><Hang/></BehaviorTree></root>'
NAVIGATE = ("navigate", "--rig", "bad_rig:Bad", "--model", "ideal")


@pytest.fixture
def place(tmp_path, monkeypatch):
    (tmp_path / "bad_rig.py").write_text(textwrap.dedent(RIG))
    (tmp_path / "bad_leaf.py").write_text(textwrap.dedent(LEAF))
    (tmp_path / "tree.xml").write_text(TREE)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", list(sys.path))
    yield tmp_path
    for name in ("bad_rig", "worse", "shut_rig", "wrong_rig"):
        sys.modules.pop(name, None)


@pytest.fixture
def bad(monkeypatch):
    """Say where and how the rig goes wrong, and at which sample."""

    def bad(where, how, at=None):
        for name, value in (("WHERE", where), ("HOW", how), ("AT", at)):
            if value is not None:
                monkeypatch.setenv(name, value)

    return bad


@pytest.mark.slow
@pytest.mark.parametrize(
    ("where", "how", "said", "levelled"),
    [
        ("observe", "hang", "watchdog: observe() of the rig did not return within 0.5 s", True),
        ("observe", "raise", "observe() of the rig raised OSError: [Errno 5] no answer", True),
        ("command", "hang", "watchdog: command() of the rig did not return within 0.2 s", True),
        ("level", "hang", "level() of the rig did not return within 1 s", False),
        ("close", "hang", "close() of the rig did not return within 2 s", True),
        ("leaf", "busy", "watchdog: no command within 0.2 s of the sample at t = 0.200 s (", True),
        ("leaf", "wait", "watchdog: no command within 0.2 s of the sample at t = 0.200 s (", True),
    ],
)
def test_a_hanging_part_ends_the_program_in_time(place, bad, where, how, said, levelled):
    bad(where, how)
    leaf = ("--behavior", "tree.xml", "--behavior-module", "bad_leaf") if where == "leaf" else ("--from", "ring4")
    process = start(*NAVIGATE, "--log", "run.mcap", *leaf)
    assert process.stdout is not None
    assert process.stdout.readline().strip() == "now"
    began = time.monotonic()
    _, err = process.communicate(timeout=60)
    assert time.monotonic() - began < 6.0
    assert process.returncode == 3, err
    last = err.splitlines()[-1]
    assert last.startswith("mazeplan: ")
    assert said in last
    assert (where == "leaf") == ("bad_leaf.py:" in last)
    assert "Traceback" not in err
    assert (place / "levelled").exists() == levelled
    log = read_log("run.mcap")
    assert len(log.ticks["t"]) > 5
    if where == "leaf":  # its loop cannot end the log
        assert log.result is None
    elif where == "close":  # the run was over
        assert log.result["reason"] == "arrived"
    else:
        assert (log.complete, log.result["success"], log.result["reason"]) == (True, False, "rig_failed")
        event = log.events[-1]
        assert (event.kind, event.detail["kind"]) == ("failure", "rig_failed")
        assert event.detail["detail"] in last


@pytest.mark.slow
@pytest.mark.parametrize(
    "arguments",
    [
        ("navigate",),
        ("evaluate", "--runs", "2"),
        ("evaluate", "--runs", "2", "--workers", "2"),
        ("collect", "--seconds", "5", "-o", "log.mcap"),
        ("collect", "--seconds", "5", "-o", "log.mcap", "--rings"),
        ("improve", "--runs", "1", "--seconds", "40"),
    ],
)
def test_every_command_that_moves_a_rig_watches_it(place, bad, monkeypatch, call, arguments):
    bad("observe", "hang", "1")
    monkeypatch.setattr(watchdog, "START_S", 0.2)
    began = time.monotonic()
    code, _, err = call(*arguments, "--rig", "bad_rig:Bad")
    assert code == 3
    assert "watchdog: observe() of the rig did not return within" in err.splitlines()[-1]
    assert (place / "levelled").exists()
    assert time.monotonic() - began < 60.0


def test_rig_check_names_the_call_that_hangs(place, bad, call):
    bad("observe", "hang", "30")
    code, out, _ = call("rig", "check", "bad_rig:Bad")
    lines = [line for line in out.splitlines() if line != "now"]
    assert code == 1
    assert lines[0].startswith("ok      clock")
    assert "watchdog: observe() of the rig did not return within" in lines[1]
    assert lines[-1].startswith("ok      close")


def test_a_failing_rig_leaves_one_document_with_json(place, bad, call):
    bad("observe", "raise")
    code, out, err = call(*NAVIGATE, "--json")
    assert code == 3
    document = json.loads(out.removeprefix("now\n"))
    assert (document["success"], document["reason"]) == (False, "rig_failed")
    assert document["failures"][-1]["kind"] == "rig_failed"
    assert "OSError" in document["failures"][-1]["words"]
    assert document["time_s"] > 0.0
    assert "OSError" in err.splitlines()[-1]
    assert err.count("OSError") == 1
