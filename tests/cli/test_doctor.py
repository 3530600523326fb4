"""`doctor`: what the emulated board needs, and where a real one may be."""

from __future__ import annotations

import json
import shutil

import pytest
from commands import call

from mazeplan.rigs.hardware import chip
from mazeplan.rigs.link import port


@pytest.fixture
def bare(monkeypatch, tmp_path):
    """A machine without compiler, simulator or anything built, and with one board."""
    monkeypatch.setattr(shutil, "which", lambda name: None)
    monkeypatch.setattr(chip, "HEADER", tmp_path / "sim_avr.h")
    monkeypatch.setattr(chip, "PACKAGE", tmp_path / "mazeplan")
    monkeypatch.setattr(port, "ports_found", lambda: ["/dev/ttyACM7"])


def lines(monkeypatch, capsys):
    code, out, _ = call(monkeypatch, capsys, "doctor")
    assert code == 0
    return out.splitlines()


def test_what_is_missing_is_named_with_what_to_do(bare, monkeypatch, capsys):
    (line,) = (line for line in lines(monkeypatch, capsys) if line.startswith("emulator "))
    assert "missing avr-gcc, simavr, firmware, emulator" in line
    assert "sudo apt-get install gcc-avr avr-libc simavr libsimavr-dev libelf-dev, then make emulator" in line
    code, out, _ = call(monkeypatch, capsys, "doctor", "--json")
    assert code == 0
    assert json.loads(out)["emulator"] == dict.fromkeys(("avr-gcc", "simavr", "firmware", "emulator"))
    assert json.loads(out)["ports"] == ["/dev/ttyACM7"]


def test_what_is_built_needs_no_compiler(bare, monkeypatch, capsys, tmp_path):
    for path in chip.paths(tmp_path / "build"):
        path.parent.mkdir(parents=True)
        path.touch()
    (line,) = (line for line in lines(monkeypatch, capsys) if line.startswith("emulator "))
    assert "to have it" not in line
    assert "ports     /dev/ttyACM7: where a board may be plugged in" in lines(monkeypatch, capsys)


def test_without_pyserial_there_are_no_ports_to_tell_of(bare, monkeypatch, capsys):
    monkeypatch.setattr("mazeplan.cli.doctor.installed", lambda package: None if package == "pyserial" else "1")
    assert not [line for line in lines(monkeypatch, capsys) if line.startswith("ports")]
