"""`doctor`: packages by what pyproject.toml asks for; what the emulated board needs, and where a real one may be."""

from __future__ import annotations

import json
import re
import shutil
import tomllib
from email.message import Message

import pytest
from commands import call

from mazeplan.cli import doctor
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
    monkeypatch.setattr("mazeplan.cli.doctor.installed", lambda package: None if package == "pyserial" else "999")
    assert not [line for line in lines(monkeypatch, capsys) if line.startswith("ports")]


@pytest.fixture
def project():
    return tomllib.loads(doctor.resources.CHECKOUT.read_text(encoding="utf-8"))["project"]


def with_versions(monkeypatch, **versions):
    """Everything is installed as it should be, but for these."""
    real = doctor.installed
    changed = {name.replace("_", "-"): value for name, value in versions.items()}
    monkeypatch.setattr(doctor, "installed", lambda package: changed.get(package, real(package) or "999"))


def test_every_package_of_pyproject_is_looked_at_and_every_extra_has_words(monkeypatch, capsys, project):
    code, out, _ = call(monkeypatch, capsys, "doctor", "--json")
    document = json.loads(out)
    groups = {"core": project["dependencies"], **project["optional-dependencies"]}
    assert code == 0
    assert list(document["packages"]) == list(groups)
    for extra, texts in groups.items():
        asked = {re.split(r"[^\w-]", text)[0] for text in texts}
        assert set(document["packages"][extra]) == asked
    assert set(doctor.FEATURES) == set(groups)
    assert document["needed"]["core"]["scipy"] == next(t for t in groups["core"] if "scipy" in t).removeprefix("scipy")
    assert document["features"]["core"]["ready"]


def test_a_package_that_is_too_old_is_said_with_what_is_needed(monkeypatch, capsys):
    with_versions(monkeypatch, viser="0.2.1", torch="2.13.0+cpu")
    told = lines(monkeypatch, capsys)
    (line,) = (line for line in told if line.startswith("view "))
    assert line.startswith(
        "view      viser is 0.2.1, needed <2,>=1.1: the live page in the browser; to have it: pip install"
    )
    assert "'.[view]'" in line
    (line,) = (line for line in told if line.startswith("learn "))
    assert line.startswith("learn     ready: "), "what follows the + is no other version"
    document = json.loads(call(monkeypatch, capsys, "doctor", "--json")[1])
    view = document["features"]["view"]
    assert (view["ready"], view["missing"], view["too_old"]) == (False, [], ["viser"])
    assert document["features"]["learn"]["get"] is None


def test_without_what_everything_needs_the_exit_status_is_one(monkeypatch, capsys):
    real = doctor.installed
    monkeypatch.setattr(doctor, "installed", lambda package: None if package == "mujoco" else real(package))
    code, out, _ = call(monkeypatch, capsys, "doctor")
    assert code == 1
    assert "core      mujoco is missing: " in out


def test_away_from_a_checkout_the_installed_package_is_asked(monkeypatch, tmp_path, project):
    expected = {extra: [str(r) for r in group] for extra, group in doctor.requirements().items()}
    told = Message()
    for text in project["dependencies"]:
        told["Requires-Dist"] = text
    told["Requires-Dist"] = "winonly>=1; sys_platform == 'no such system'"
    for extra, texts in project["optional-dependencies"].items():
        told["Provides-Extra"] = extra
        for text in texts:
            told["Requires-Dist"] = f'{text}; extra == "{extra}"'
    monkeypatch.setattr(doctor, "metadata", lambda name: told)
    monkeypatch.setattr(doctor.resources, "CHECKOUT", tmp_path / "pyproject.toml")
    found = {extra: [str(r).split(";")[0] for r in group] for extra, group in doctor.requirements().items()}
    assert found == expected
    assert doctor.advice("view") == "pip install --upgrade 'mazeplan[view]'"


def test_a_clone_is_told_what_the_doctor_says(monkeypatch):
    from mazeplan.errors import InputError
    from mazeplan.view import server

    monkeypatch.setattr(server, "find_spec", lambda name: None)
    with pytest.raises(InputError) as problem:
        server.check_installed()
    assert str(problem.value) == f"the page needs viser: {doctor.advice('view')}"
    assert "-e '.[view]' in " in str(problem.value)


def test_the_browser_is_told(bare, monkeypatch, capsys):
    assert "browser   missing chromium: tests of the live page; to have them: sudo apt-get install chromium" in lines(
        monkeypatch, capsys
    )
