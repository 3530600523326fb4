"""`rig check` of a real rig whose board is a script behind a pseudo terminal: its order and exit status."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from fake_board import FakeBoard, accept, silent

from mazeplan.rigs.hardware import check as hardware_check
from mazeplan.rigs.link import board as line
from mazeplan.rigs.link.protocol import encode
from mazeplan.rigs.registry import PACKAGED

TEMPLATE = (PACKAGED / "hardware.yaml").read_text()


class Moving(FakeBoard):
    """Its channels follow the pulses: 1 V for 100 us, unless the servos have no current."""

    current, pulses = True, (15000, 15000)

    def __init__(self, **more):
        super().__init__(C=Moving._move, Z=Moving._level, **more)

    def _move(self, frame):
        self.pulses = (int(frame.fields[1]), int(frame.fields[2]))
        return accept(self, frame)

    def _level(self, frame):
        self.pulses = (15000, 15000)
        return accept(self, frame)

    def report(self):
        whole = [32768 + (int(64 * 1023 / 5 * (p - 15000) / 1000) if self.current else 0) for p in self.pulses]
        fields = super().report()[1:].decode().split("*")[0].split(",")
        return encode("T", *fields[1:3], *whole, *self.pulses, *fields[7:])


@pytest.fixture
def check(call, tmp_path, monkeypatch):
    """`rig check` with a file whose text is given."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(hardware_check, "SETTLE_S", 0.5)

    def run(text, *words):
        Path("mine.yaml").write_text(text)
        status, out, err = call("rig", "check", "mine.yaml", "--yes", *words)
        return status, [line.split()[:3] for line in out.splitlines()], out, err

    return run


@pytest.mark.slow
def test_the_board_can_be_checked_without_calibrations(check):
    with Moving() as board:
        status, rows, out, err = check(TEMPLATE.replace("port: auto", f"port: {board.port}"))
    assert status == 2
    assert [row[:2] for row in rows[:2]] == [["ok", "port"], ["ok", "firmware"]]
    assert rows[2:4] == [["ok", "beta", "servo"], ["ok", "gamma", "servo"]]
    assert "1500 to 1620 us: channel 0 +1.20 V, channel 1 +0.00 V" in out
    assert "1500 to 1620 us: channel 0 +0.00 V, channel 1 +1.20 V" in out
    assert rows[4][:2] == ["FAILED", "calibrations"]
    said = "mazeplan: mine.yaml: not calibrated yet: first mazeplan calibrate tilt and mazeplan calibrate camera"
    assert err.splitlines()[-1].startswith(said)
    assert board.pulses == (15000, 15000)


@pytest.mark.parametrize("as_json", [False, True])
def test_a_board_that_is_silent_or_not_there_is_status_3(check, monkeypatch, as_json):
    monkeypatch.setattr(line.Timeouts, "__init__", _hasty(line.Timeouts.__init__))
    words = ("--json",) if as_json else ()
    with FakeBoard(reports=False, I=silent) as board:
        told = [check(TEMPLATE.replace("port: auto", f"port: {port}"), *words) for port in (board.port, "/dev/nosuch")]
    for (status, rows, out, err), why in zip(told, ("the board does not answer", "cannot be opened"), strict=True):
        assert status == 3
        assert why in err.splitlines()[-1]
        if as_json:
            document = json.loads(out)
            assert document["passed"] is False
            assert [(c["name"], c["passed"]) for c in document["checks"]] == [("port", False)]
            assert why in document["checks"][0]["detail"]
        else:
            assert [row[:2] for row in rows] == [["FAILED", "port"]]


def _hasty(real):
    return lambda self, **more: real(self, **{"answer_s": 0.6, "listen_s": 0.2} | more)
