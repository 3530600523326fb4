"""Files and folders of a command line: one rule for all commands, before any work begins."""

from __future__ import annotations

import errno
import os

import pytest
from typer.main import get_command

from mazeplan.apps.cli.app import app
from mazeplan.apps.cli.path_checks import METAVARS

OTHER = {  # metavars that name no file or folder
    "DEG", "EFFECT", "HZ", "M", "MM", "N", "NAME", "NxN", "OPENING", "RING", "RINGS", "S", "TEXT", "ADDRESS", "PORT",
    "KINDS", "SYSTEM", "MODULE", "MODULE:FUNCTION", "EFFECT.PARAM=VALUE", "PICTURES",
}  # fmt: skip


ENDINGS = {  # of files to write; others end in .yaml here
    "report -o": ".html", "compare --report": ".html", "evaluate --report": ".html", "compare --curve": ".png",
    "policy export -o": ".h", "new tree -o": ".xml", "record -o": ".parquet",
}  # fmt: skip


def commands(group, path=()):
    for name, inner in getattr(group, "commands", {}).items():
        yield from commands(inner, (*path, name))
    if not hasattr(group, "commands"):
        yield path, group


def named():
    """(words of the command, option or None for an argument, metavar) of each file or folder."""
    for path, command in commands(get_command(app)):
        for param in command.params:
            metavar = (getattr(param, "metavar", None) or "").partition(" ")[0]
            if metavar in METAVARS:
                yield path, min(param.opts, key=len) if param.param_type_name == "option" else None, command


def line_with(path, option, command, value):
    """A command line in which one parameter is the file `value` with some ending, and each that is needed is there."""
    words = [*path]
    for param in command.params:
        mine = param.param_type_name == "argument" if option is None else option in param.opts
        if mine or param.required:
            name = [] if param.param_type_name == "argument" else [min(param.opts, key=len)]
            ending = ENDINGS.get(" ".join([*path, *name]), ".yaml")
            words += [*name, f"{value if mine else 'new'}{ending}"]
    return words


@pytest.fixture
def locked(tmp_path, monkeypatch):
    """A folder that may not be entered, also for root, whom the system lets in everywhere."""
    folder, real = tmp_path / "locked", os.stat

    def stat(path, **more):
        if str(path).startswith(f"{folder}/"):
            raise PermissionError(errno.EACCES, os.strerror(errno.EACCES), str(path))
        return real(path, **more)

    folder.mkdir()
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(os, "stat", stat)
    return folder


def test_each_metavar_says_whether_it_names_a_file():
    metavars = {
        (getattr(param, "metavar", None) or "").partition(" ")[0]
        for _, command in commands(get_command(app))
        for param in command.params
    }
    assert {m for m in metavars if m and "|" not in m} == METAVARS | OTHER


@pytest.mark.parametrize(("path", "option", "command"), list(named()))
def test_a_folder_that_may_not_be_entered_is_one_line(refused, locked, path, option, command):
    words = line_with(path, option, command, locked / "a")
    error = refused(*words)
    assert str(locked) in error
    assert "Permission denied; expected a file or folder that you may use" in error


def test_a_name_that_is_too_long_is_one_line(refused):
    assert "File name too long; expected" in refused("learn", f"{'a' * 300}.csv", "-o", "model")
