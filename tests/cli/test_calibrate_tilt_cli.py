"""`calibrate tilt` as a person would give it: from a table, and at a board that asks back."""

from __future__ import annotations

import json
import math
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import typer
from commands import call

from mazeplan.errors import RigError
from mazeplan.maze.yamltree import read_yaml
from mazeplan.rigs.hardware import tiltreadings
from mazeplan.rigs.hardware.tiltcalibration import read_readings
from mazeplan.rigs.hardware.tiltsensor import TiltSection
from mazeplan.rigs.hardware.truth import Diode

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
    monkeypatch.chdir(tmp_path)
    Path("hardware.yaml").write_text(RIG)
    return tmp_path


def table(path: Path, noise: float = 0.04) -> None:
    rng, rows = np.random.default_rng(0), ["v0,v1,beta_deg,gamma_deg,pulse_beta_us,pulse_gamma_us"]
    for beta in np.linspace(-5.75, 5.75, 7):
        for gamma in np.linspace(-5.75, 5.75, 7):
            v = DIODE.volts(math.radians(beta), math.radians(gamma))
            said = np.array([beta, gamma]) + rng.normal(0.0, noise, 2)
            rows.append(f"{v[0]:.4f},{v[1]:.4f},{said[0]:.1f},{said[1]:.1f},{1510 + 40 * beta},{1490 - 38 * gamma}")
    rows[20] = rows[20].replace(rows[20].split(",")[3], "4.9")
    path.write_text("\n".join(rows) + "\n")


def test_a_table_becomes_a_section_of_the_rigs_file(desk, monkeypatch, capsys):
    table(desk / "r.csv")
    code, out, err = call(monkeypatch, capsys, "calibrate", "tilt", "--readings", "r.csv")
    assert code == 0, err
    assert "r.csv:21: gamma: got 4.9, the others say" in out
    assert "wrote tilt and servo to hardware.yaml" in err
    text = Path("hardware.yaml").read_text()
    assert "port: fake   # mine\n" in text
    assert "   # before it hits the frame\n" in text
    data = read_yaml(Path("hardware.yaml")).data
    assert data["servo"]["slew_us_per_s"] == 5000.0
    assert data["servo"]["beta"]["level_us"] == pytest.approx(1510.0, abs=1.0)
    assert data["servo"]["gamma"]["us_per_deg"] == pytest.approx(-38.0, abs=0.3)
    assert set(data["tilt"]) == set(TiltSection.model_fields)


def test_json_and_a_dry_run(desk, monkeypatch, capsys):
    table(desk / "r.csv")
    code, out, _ = call(monkeypatch, capsys, "calibrate", "tilt", "--readings", "r.csv", "--json", "--dry-run")
    document = json.loads(out)
    assert code == 0
    assert document["error_deg"] < 0.1
    assert [o["line"] for o in document["outliers"]] == [21]
    assert document["rig"] is None
    assert Path("hardware.yaml").read_text() == RIG


def test_a_fit_that_is_not_good_enough_is_status_1_and_says_what_to_do(desk, monkeypatch, capsys):
    table(desk / "r.csv", noise=0.4)
    code, _, err = call(monkeypatch, capsys, "calibrate", "tilt", "--readings", "r.csv")
    assert code == 1
    assert "expected at most 0.1: take more readings, over the whole range" in err
    assert Path("hardware.yaml").read_text() == RIG


@pytest.mark.parametrize(
    ("pulses", "said"),
    [
        ("constant", "servo.beta: what was found cannot be: us_per_deg: got "),
        ("tenths", "servo.beta.level_us: what was found cannot be: got 151"),
    ],
)
def test_what_could_not_be_read_again_is_not_written(desk, monkeypatch, capsys, pulses, said):
    """A servo that does not move the plate; pulses in another unit."""
    table(desk / "r.csv")
    lines = [line.split(",") for line in (desk / "r.csv").read_text().splitlines()]
    for cells in lines[1:]:
        cells[4] = "1510.0" if pulses == "constant" else str(10.0 * float(cells[4]))
    (desk / "r.csv").write_text("\n".join(",".join(cells) for cells in lines) + "\n")
    code, _, err = call(monkeypatch, capsys, "calibrate", "tilt", "--readings", "r.csv")
    assert code == 2
    assert said in err.splitlines()[-1]
    assert err.splitlines()[-1].endswith("the file stays as it is")
    assert Path("hardware.yaml").read_text() == RIG


@pytest.mark.parametrize(
    ("column", "factor", "said"),
    [
        (0, 1000.0, "r.csv:2: v0: got "),
        (2, 60.0, "r.csv:2: beta_deg: got "),
        (2, 0.0174, "beta_deg: got -0.1 to 0.1 deg, expected readings over 1 deg at least; are they degrees?"),
    ],
)
def test_readings_in_other_units_are_refused(desk, monkeypatch, capsys, column, factor, said):
    table(desk / "r.csv")
    lines = [line.split(",") for line in (desk / "r.csv").read_text().splitlines()]
    for cells in lines[1:]:
        cells[column] = f"{factor * float(cells[column]):.1f}"
    (desk / "r.csv").write_text("\n".join(",".join(cells) for cells in lines) + "\n")
    code, _, err = call(monkeypatch, capsys, "calibrate", "tilt", "--readings", "r.csv")
    assert (code, err.count("\n")) == (2, 1)
    assert said in err
    assert Path("hardware.yaml").read_text() == RIG


def test_where_readings_cannot_be_kept_nobody_is_asked(desk, board, monkeypatch, capsys):
    monkeypatch.setattr("typer.prompt", lambda text, **more: pytest.fail("it asked"))
    (desk / "file").write_text("")
    code, _, err = call(monkeypatch, capsys, "calibrate", "tilt", "--keep", "file/kept.csv")
    assert (code, err.count("\n")) == (2, 1)
    assert "--keep: got " in err


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--readings", "none.csv"], "none.csv: no such file, expected a table (CSV) with v0"),
        (["--rig", "toy"], "got rig 'toy', expected one on a table"),
        (["--rig", "none.yaml"], "none.yaml: no such file"),
        (["--readings", "few.csv"], "few.csv: got 1 readings, expected at least 8"),
        (["--readings", "still.csv"], "still.csv: v1: got 2.500 to 2.500 V, expected a change"),
        (["--readings", "few.csv", "--map", "nosuch"], "nosuch"),
    ],
)
def test_bad_input_is_one_line_and_status_2(desk, monkeypatch, capsys, arguments, said):
    header = "v0,v1,beta_deg,gamma_deg\n"
    (desk / "few.csv").write_text(f"{header}2.5,2.5,0,0\n")
    (desk / "still.csv").write_text(header + "".join(f"{2.0 + 0.1 * k},2.5,{k},{-k}\n" for k in range(12)))
    code, _, err = call(monkeypatch, capsys, "calibrate", "tilt", *arguments)
    assert code == 2
    assert err.startswith("mazeplan: ")
    assert said in err
    assert err.count("\n") == 1


class Board:
    """Its diode sees the tilt that the pulses of the moment make."""

    def __init__(self):
        self.pulses, self.levelled, self.closed, self.lost = (1500.0, 1500.0), 0, 0, False

    def command(self, *pulses):
        if self.lost:
            raise RigError("fake: was lost (unplugged?)")
        self.pulses = pulses

    def recent(self):
        tilt = math.radians((self.pulses[0] - 1500.0) / 40.0), math.radians((self.pulses[1] - 1500.0) / 40.0)
        counts = [v * 1023.0 / 5.0 for v in DIODE.volts(*tilt)]
        return [SimpleNamespace(counts=counts, received_s=0.01 * k) for k in range(100)]

    def level(self):
        self.levelled += 1

    def close(self):
        self.closed += 1


@pytest.fixture
def board(monkeypatch):
    board = Board()
    monkeypatch.setattr("mazeplan.rigs.hardware.parts.open_board", lambda settings: board)
    for name in ("SETTLE_S", "AVERAGE_S", "AGAIN_S"):
        monkeypatch.setattr(tiltreadings, name, 0.002)
    monkeypatch.setattr(tiltreadings, "sleep", lambda seconds: __import__("time").sleep(0.01))
    return board


def test_at_a_board_it_asks_for_each_tilt_and_a_slip_of_typing_is_asked_again(desk, board, monkeypatch, capsys):
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
    code, _, err = call(monkeypatch, capsys, "calibrate", "tilt", "--grid", "5", "--keep", "kept.csv")
    assert code == 0, err
    assert asked[0] == "1 of 25: beta gamma"
    assert asked[1] == asked[2] == "2 of 25: beta gamma"
    assert "expected two numbers, such as: -2.3 0.4" in err
    assert len(Path("kept.csv").read_text().splitlines()) == 25  # a header, and 24 readings
    assert (board.levelled >= 1, board.closed) == (True, 1)
    assert "tilt" in read_yaml(Path("hardware.yaml")).data


def test_a_board_that_is_lost_and_a_person_who_gives_up_leave_a_level_plate(desk, board, monkeypatch, capsys):
    board.lost = True
    monkeypatch.setattr("typer.prompt", lambda text, **more: "0 0")
    code, _, err = call(monkeypatch, capsys, "calibrate", "tilt")
    assert (code, err.splitlines()[-1]) == (3, "mazeplan: fake: was lost (unplugged?)")
    assert board.closed == 1
    board.lost = False

    def interrupted(text, **more):
        if text.startswith("3"):
            raise KeyboardInterrupt
        return "0.5 0.5"

    monkeypatch.setattr("typer.prompt", interrupted)
    code, _, _ = call(monkeypatch, capsys, "calibrate", "tilt", "--keep", "kept/r.csv")
    assert code == 130
    assert len(Path("kept/r.csv").read_text().splitlines()) == 3  # a header, and what was said until then
    assert (board.levelled >= 1, board.closed) == (True, 2)
    assert Path("hardware.yaml").read_text() == RIG


@pytest.mark.parametrize("last", [3, 12])
def test_ctrl_d_ends_the_asking_and_nothing_that_was_typed_is_lost(desk, board, monkeypatch, capsys, last):
    """What there is is fitted where it is enough; else it says how many are missing, and where the others are."""

    def prompt(text, default, **more):
        if text.startswith(f"{last + 1} "):
            try:
                raise EOFError
            except EOFError:
                raise typer.Abort from None  # as click does
        beta, gamma = ((pulse - 1500.0) / 40.0 for pulse in board.pulses)
        return f"{beta:.2f} {gamma:.2f}"

    monkeypatch.setattr("typer.prompt", prompt)
    (desk / "hardware-readings.csv").write_text("of last year\n")
    code, _, err = call(monkeypatch, capsys, "calibrate", "tilt", "--grid", "4")
    assert len(read_readings(desk / "hardware-readings-2.csv")) == last
    assert (desk / "hardware-readings.csv").read_text() == "of last year\n"
    assert (board.levelled >= 1, board.closed) == (True, 1)
    if last == 3:
        assert code == 2
        wanted = "mazeplan: hardware-readings-2.csv: got 3 readings, expected at least 8: 5 are missing"
        assert err.splitlines()[-1] == wanted
        assert Path("hardware.yaml").read_text() == RIG
    else:
        assert code == 0, err
        assert read_yaml(Path("hardware.yaml")).data["tilt"]["readings"] == 12


def test_nobody_is_asked_where_servos_have_no_limits(desk, board, monkeypatch, capsys):
    Path("hardware.yaml").write_text("class: mazeplan.rigs.hardware:HardwareRig\nport: fake\n")
    monkeypatch.setattr("typer.prompt", lambda text, **more: pytest.fail("it asked"))
    code, _, err = call(monkeypatch, capsys, "calibrate", "tilt")
    assert (code, err.count("\n")) == (2, 1)
    assert "hardware.yaml:1: servo.beta.min_us: is missing: no servo moves without limits" in err
    assert board.closed == 0
