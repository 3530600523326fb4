"""The tuner's command line; what it finds is in no test."""

from __future__ import annotations

import sys

import pytest
import tune

from mazeplan.core.resources import to_install


def told(monkeypatch, capsys, *words):
    monkeypatch.setattr(sys, "argv", ["tune.py", *words])
    with pytest.raises(SystemExit) as ended:
        tune.main()
    return ended.value.code, capsys.readouterr()


def test_help_needs_no_package(monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "cma", None)
    code, said = told(monkeypatch, capsys, "--help")
    assert code == 0
    assert "candidates of a generation" in said.out
    assert "Usage:" not in said.out


def test_the_package_that_is_missing_is_named(monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "cma", None)
    code, _ = told(monkeypatch, capsys, "-o", "x.yaml")
    assert code == f"tune.py needs cma: {to_install('tune')}"


@pytest.mark.parametrize("words", [("--workers", "0"), ("--runs", "-1"), ("--population", "1")])
def test_numbers_that_cannot_be(monkeypatch, capsys, words):
    code, said = told(monkeypatch, capsys, "-o", "x.yaml", *words)
    assert code == 2
    assert f"{words[0]}: got {words[1]}, expected" in said.err
