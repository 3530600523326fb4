"""Fixtures of the tests of commands."""

from __future__ import annotations

from functools import partial

import commands
import pytest


@pytest.fixture
def call(monkeypatch, capsys):
    """Run a command in this process: `call("map", "check", "cme")` returns exit status, stdout and stderr."""
    return partial(commands.call, monkeypatch, capsys)


@pytest.fixture
def no_reference(monkeypatch):
    """`learn` keeps no reference for later diagnoses, which takes longer than the model."""
    monkeypatch.setattr("mazeplan.run.commands.learn.why_not_whole", lambda tables: "it was not looked at")


@pytest.fixture
def refused(call):
    """Run a command that must be refused as bad input; returns its one line."""

    def run(*words: object) -> str:
        code, out, err = call(*words)
        assert (code, out, err.count("\n")) == (2, "", 1), err
        assert err.startswith("mazeplan: ")
        return err

    return run
