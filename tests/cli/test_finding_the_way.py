"""Help and lists: how a newcomer finds commands, options and names."""

from __future__ import annotations

import json
import re
import shlex
import subprocess
import sys

import pytest
from typer.main import get_command
from typer.testing import CliRunner

from mazeplan.apps.cli.app import app
from mazeplan.apps.cli.help import HELP
from mazeplan.learning.modelfile import model_names
from mazeplan.rigs.registry import rig_names


def said(*words, **more):
    result = CliRunner().invoke(app, list(words), **more)
    assert result.exit_code == 0, result.output
    return result.output


def command_of(path):
    """A command of one's own: Click keeps the help options of the first context, here those without `-h`."""
    command = get_command.__wrapped__(app)
    for name in path.split():
        command = command.commands[name]
    return command


@pytest.mark.parametrize("path", HELP)
def test_help_ends_with_an_example(path):
    text = said(*path.split(), "-h")
    assert text == said(*path.split(), "--help")
    examples = text.partition("\nExample:\n")[2].strip().splitlines()
    assert [line.strip() for line in examples] == [HELP[path][1]]
    assert re.findall(r"<[a-z][\w|\[\] ]*>", text) == [], "a type stands where a reader expects what to type"


@pytest.mark.parametrize("line", [line for _, line in HELP.values()])
def test_examples_are_read_by_the_program(line, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    program, *words = shlex.split(line)
    assert program == "mazeplan"
    path = next(path for path in sorted(HELP, key=len, reverse=True) if words[: len(path.split())] == path.split())
    command_of(path).make_context(path, words[len(path.split()) :])  # raises for an unknown option or a bad value


def test_lists_of_commands_are_not_cut():
    for group in ("", *(name for name, command in get_command(app).commands.items() if hasattr(command, "commands"))):
        assert "..." not in said(*group.split(), "-h", env={"COLUMNS": "80"}).partition("Commands:")[2], group


def test_lists_have_a_sentence_for_each_name():
    rigs = said("rig", "list")
    for name in rig_names():
        assert next(line for line in rigs.splitlines() if line.split()[:1] == [name]).count(" ") > 4
    assert {row["name"]: row["kind"] for row in json.loads(said("model", "list", "--json"))} == {
        "ideal": "pi", "rough": "sp", "toy": "sp",
    }  # fmt: skip
    assert [line.split()[0] for line in said("model", "list").splitlines()] == list(model_names())


def test_a_model_is_shown():
    text = said("model", "show", "toy")
    assert "camera_delay_s: 0.0651076 ± 0.0015 s" in text
    assert "ring 5:" in text
    assert json.loads(said("model", "show", "toy", "--json"))["rings"]["1"]["rolling_inertia"]["factor"]["unit"] == "1"


@pytest.mark.slow
def test_what_is_shown_exists_or_is_told_in_one_line():
    for words, told in ((("model", "show", "nothing"), "nothing"),):
        ran = subprocess.run(
            [sys.executable, "-m", "mazeplan", *words], capture_output=True, text=True, check=False
        )  # fmt: skip
        assert (ran.returncode, ran.stdout) == (2, "")
        assert told in ran.stderr
        assert ran.stderr.count("\n") == 1
