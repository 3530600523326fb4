"""`new rig`: what it writes is a rig at once, and nothing is written over."""

from __future__ import annotations

import os
import subprocess
import sys
import tomllib

import pytest
from commands import call
from pages import ROOT


@pytest.fixture
def new(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    return lambda *words: call(monkeypatch, capsys, "new", "rig", *words)


def test_what_it_writes_is_a_rig_with_a_test_that_passes_and_arrives(new, tmp_path, monkeypatch, capsys):
    code, out, _ = new("my_table")
    assert code == 0
    assert out == "cd my_table && python -m pytest && mazeplan navigate --rig my_table.yaml\n"
    home = tmp_path / "my_table"
    files = {str(path.relative_to(home)) for path in home.rglob("*") if path.is_file()}
    assert files == {"my_table.py", "my_table.yaml", "tests/test_my_table.py", "pyproject.toml", "README.md"}
    project = tomllib.loads((home / "pyproject.toml").read_text())["project"]
    assert project["entry-points"]["mazeplan.rigs"] == {"my_table": "my_table:MyTableRig"}
    assert project["name"] == "my-table"
    env = {**os.environ, "PYTHONPATH": str(ROOT)}
    for words in (
        ["ruff", "check", "--isolated", "--line-length", "120", "--select", "E,F,I,B,UP", "."],
        ["ruff", "format", "--isolated", "--line-length", "120", "--check", "."],
        ["pytest", "-q", "-p", "no:cacheprovider"],
    ):
        done = subprocess.run(
            [sys.executable, "-m", *words], cwd=home, capture_output=True, text=True, check=False, env=env
        )
        assert done.returncode == 0, done.stdout + done.stderr
    file = home / "my_table.yaml"
    good = file.read_text()
    file.write_text(good.replace("beta_sign: 1", "beta_sign: -1"))  # is what is tested what will be driven?
    words = ["pytest", "-q", "-p", "no:cacheprovider", "-k", "is_a_rig"]
    done = subprocess.run(
        [sys.executable, "-m", *words], cwd=home, capture_output=True, text=True, check=False, env=env
    )
    assert "sign of beta: " in done.stdout
    file.write_text(good)
    monkeypatch.chdir(home)
    monkeypatch.setattr(sys, "path", list(sys.path))
    code, out, err = call(monkeypatch, capsys, "navigate", "--from", "ring4", "--rig", "my_table.yaml", "--json")
    assert code == 0, err
    assert '"rig": "my_table"' in out
    del sys.modules["my_table"]


def test_settings_of_the_new_rig_are_checked_with_their_line(new, tmp_path, monkeypatch, capsys):
    new("other_table", "-o", "here")
    monkeypatch.chdir(tmp_path / "here")
    monkeypatch.setattr(sys, "path", list(sys.path))
    file = tmp_path / "here" / "other_table.yaml"
    text = file.read_text()
    for old, changed, said in (
        ("beta_sign: 1", "beta_sign: 2", "other_table.yaml:5: beta_sign: got 2, expected 1 or -1"),
        ("machine: stand-in", "machine: robot", "other_table.yaml:3: machine: got 'robot', expected one of stand-in"),
        ("rate_hz", "rate", "other_table.yaml:4: rate: unknown key, expected one of machine, rate_hz"),
    ):
        file.write_text(text.replace(old, changed))
        code, _, err = call(monkeypatch, capsys, "navigate", "--rig", "other_table.yaml")
        assert code == 2
        assert said in err
    del sys.modules["other_table"]


@pytest.mark.parametrize("there", ["cart.py", "cart.yaml", "tests/test_cart.py", "pyproject.toml", "README.md"])
def test_nothing_is_written_over(new, tmp_path, there):
    file = tmp_path / "cart" / there
    file.parent.mkdir(parents=True)
    file.write_text("mine")
    code, out, err = new("cart")
    assert (code, out) == (2, "")
    assert err == f"mazeplan: cart/{there} is there already, and nothing is written over; expected another NAME or -o\n"
    assert file.read_text() == "mine"
    assert len([path for path in (tmp_path / "cart").rglob("*") if path.is_file()]) == 1


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("1x", "expected a Python identifier"), ("a-b", "expected a Python identifier"),
        ("../up", "expected a Python identifier"), ("", "expected a Python identifier"),
        ("class", "expected a Python identifier"), ("a" * 41, "expected a Python identifier"),
        ("toy", "which is a packaged rig"), ("json", "which is a module of "), ("numpy", "which is a module of "),
        ("tests", "which is the folder of its tests"),
    ],
)  # fmt: skip
def test_a_name_that_will_not_do_is_one_line_and_two(new, tmp_path, name, said):
    code, out, err = new(name, "-o", "here")
    assert (code, out) == (2, "")
    assert f"NAME: got {name!r}" in err
    assert said in err
    assert len(err.strip().splitlines()) == 1
    assert list(tmp_path.iterdir()) == []


def test_a_file_in_the_place_of_the_folder_is_told(new, tmp_path):
    (tmp_path / "cart").write_text("")
    code, _, err = new("cart")
    assert code == 2
    assert "is a file; expected a folder" in err


def test_it_can_be_driven_from_any_folder(new, tmp_path):
    new("far_table")  # the folder has the name of the module: without the file's own folder it would be taken for it
    away = tmp_path / "away"
    away.mkdir()
    words = ("evaluate", "--from", "ring4", "--runs", "2", "--workers", "2", "--rig")
    for folder, file in ((tmp_path, "far_table/far_table.yaml"), (away, "../far_table/far_table.yaml")):
        done = subprocess.run(
            [sys.executable, "-m", "mazeplan", *words, file],
            cwd=folder, capture_output=True, text=True, check=False, env={**os.environ, "PYTHONPATH": str(ROOT)},
        )  # fmt: skip
        assert done.returncode == 0, done.stderr
        assert "arrived       2 of 2" in done.stdout
    (away / "bla").mkdir()
    (away / "odd.yaml").write_text("class: bla:Rig\n")
    done = subprocess.run(
        [sys.executable, "-m", "mazeplan", "rig", "check", "odd.yaml"],
        cwd=away, capture_output=True, text=True, check=False, env={**os.environ, "PYTHONPATH": str(ROOT)},
    )  # fmt: skip
    assert done.returncode == 2
    assert (
        f"odd.yaml:1: rig 'bla:Rig': module 'bla', for which the folder {away / 'bla'} is taken, has no" in done.stderr
    )
