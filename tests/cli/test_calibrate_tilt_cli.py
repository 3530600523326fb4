"""`calibrate tilt` as a person would give it: from a table, and at a board that asks back."""

from __future__ import annotations

import math
from pathlib import Path
from time import monotonic
from types import SimpleNamespace

import numpy as np
import pytest
from emulator.truth import Diode

from mazeplan.core.errors import RigError
from mazeplan.maze.yamltree import read_yaml
from mazeplan.rigs.hardware import tiltcalibration
from mazeplan.rigs.hardware.settings import TiltSensor

RIG = """\
class: mazeplan.rigs.hardware:HardwareRig
port: fake   # mine
servo:
  beta: {min_us: 1200.0, max_us: 1800.0}   # before it hits the frame
  gamma: {min_us: 1200.0, max_us: 1800.0}
  slew_us_per_s: 5000.0
"""
DIODE = Diode.drawn(np.random.default_rng(4))


@pytest.fixture
def desk(tmp_path, monkeypatch):
    """A working folder with the file of a rig."""
    monkeypatch.chdir(tmp_path)
    Path("hardware.yaml").write_text(RIG)
    return tmp_path


def rows(noise: float = 0.04) -> list[list[str]]:
    """Readings at 49 tilts, with a slip in the twentieth."""
    rng, rows = np.random.default_rng(0), []
    for beta in np.linspace(-5.75, 5.75, 7):
        for gamma in np.linspace(-5.75, 5.75, 7):
            v = DIODE.volts(math.radians(beta), math.radians(gamma))
            read = np.array([beta, gamma]) + rng.normal(0.0, noise, 2)
            cells = (
                f"{v[0]:.4f}",
                f"{v[1]:.4f}",
                f"{read[0]:.1f}",
                f"{read[1]:.1f}",
                1510 + 40 * beta,
                1490 - 38 * gamma,
            )
            rows.append([str(cell) for cell in cells])
    rows[19][3] = "4.9"
    return rows


def write(table: list[list[str]]) -> tuple[str, ...]:
    """Write readings; the command that fits them."""
    lines = ["v0,v1,beta_deg,gamma_deg,pulse_beta_us,pulse_gamma_us", *(",".join(cells) for cells in table)]
    Path("r.csv").write_text("\n".join(lines) + "\n")
    return ("calibrate", "tilt", "--readings", "r.csv")


def test_a_table_becomes_a_section_of_the_rigs_file(desk, call):
    code, out, err = call(*write(rows()))
    assert code == 0, err
    assert "r.csv:21: gamma: got 4.9, the others predict" in out
    assert "wrote tilt and servo to hardware.yaml" in err
    text = Path("hardware.yaml").read_text()
    assert "port: fake   # mine\n" in text
    assert "# before it hits the frame\n" in text
    data = read_yaml(Path("hardware.yaml")).data
    assert data["servo"]["slew_us_per_s"] == 5000.0
    assert data["servo"]["beta"]["level_us"] == pytest.approx(1510.0, abs=1.0)
    assert data["servo"]["gamma"]["us_per_deg"] == pytest.approx(-38.0, abs=0.3)
    assert set(data["tilt"]) == set(TiltSensor.model_fields)


def test_a_bad_fit_leaves_the_rigs_file_alone(desk, call):
    code, _, err = call(*write(rows(noise=0.4)))
    assert code == 1
    assert "expected at most 0.1: take more readings, over the whole range" in err
    assert Path("hardware.yaml").read_text() == RIG


class Board:
    """Its diode sees the tilt that the pulses of the moment make. `silent_s`: age of its newest report."""

    port, silent_s = "fake", 0.0

    def __init__(self):
        self.pulses, self.levelled, self.closed, self.lost = (1500.0, 1500.0), 0, 0, False

    def command(self, *pulses):
        if self.lost:
            raise RigError("fake: was lost (unplugged?)")
        self.pulses = pulses

    def recent(self):
        tilt = math.radians((self.pulses[0] - 1500.0) / 40.0), math.radians((self.pulses[1] - 1500.0) / 40.0)
        newest = monotonic() - self.silent_s
        return [SimpleNamespace(volts=DIODE.volts(*tilt), received_s=newest - 0.01 * (99 - k)) for k in range(100)]

    def level(self):
        self.levelled += 1

    def close(self):
        self.closed += 1


@pytest.fixture
def board(monkeypatch):
    board = Board()
    monkeypatch.setattr("mazeplan.rigs.link.board.open_board", lambda port, limits: board)
    for name in ("SETTLE_S", "AVERAGE_S", "AGAIN_S"):
        monkeypatch.setattr(tiltcalibration, name, 0.002)
    monkeypatch.setattr(tiltcalibration, "sleep", lambda seconds: __import__("time").sleep(0.01))
    return board


def test_at_a_board_each_tilt_is_asked_for_and_a_slip_again(call, desk, board, monkeypatch):
    asked = []

    def prompt(text, **more):
        asked.append(text)
        if len(asked) == 2:
            return "1.2 x"
        if len(asked) == 3:
            return ""
        beta, gamma = ((pulse - 1500.0) / 40.0 for pulse in board.pulses)
        return f"{beta:.1f}, {gamma:.1f}"

    monkeypatch.setattr("typer.prompt", prompt)
    code, _, err = call("calibrate", "tilt", "--grid", "5")
    assert code == 0, err
    assert asked[0] == "1 of 25: beta gamma"
    assert asked[1] == asked[2] == "2 of 25: beta gamma"
    assert "expected two finite numbers, such as: -2.3 0.4" in err
    assert len(Path("hardware-readings.csv").read_text().splitlines()) == 25  # a header, and 24 readings
    assert (board.levelled >= 1, board.closed) == (True, 1)
    assert "tilt" in read_yaml(Path("hardware.yaml")).data


def test_a_lost_board_and_ctrl_c_leave_a_level_plate(call, desk, board, monkeypatch):
    board.lost = True
    monkeypatch.setattr("typer.prompt", lambda text, **more: "0 0")
    code, _, err = call("calibrate", "tilt")
    assert (code, err.splitlines()[-1]) == (3, "mazeplan: fake: was lost (unplugged?)")
    assert board.closed == 1
    board.lost = False

    def interrupted(text, **more):
        if text.startswith("3"):
            raise KeyboardInterrupt
        return "0.5 0.5"

    monkeypatch.setattr("typer.prompt", interrupted)
    code, _, _ = call("calibrate", "tilt")
    assert code == 130
    assert len(Path("hardware-readings.csv").read_text().splitlines()) == 3  # a header, and what was said until then
    assert (board.levelled >= 1, board.closed) == (True, 2)
    assert Path("hardware.yaml").read_text() == RIG
