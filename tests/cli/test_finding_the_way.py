"""Help, lists and completion: how a newcomer finds commands, options and names."""

from __future__ import annotations

import json
import os
import re
import shlex
import subprocess
import sys

import pytest
from typer.main import get_command
from typer.testing import CliRunner

from mazeplan.apps.cli.app import app
from mazeplan.apps.cli.help import HELP
from mazeplan.core import resources
from mazeplan.learning.modelfile import model_names
from mazeplan.maze.mapfile import packaged_maps
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
def test_help_ends_with_examples_and_says_what_to_type(path):
    text = said(*path.split(), "-h")
    assert text == said(*path.split(), "--help")
    examples = text.partition("\nExamples:\n")[2].strip().splitlines()
    assert [line.strip() for line in examples] == [*HELP[path][1:]]
    assert re.findall(r"<[a-z][\w|\[\] ]*>", text) == [], "a type stands where a reader expects what to type"


@pytest.mark.parametrize("line", [line for _, *lines in HELP.values() for line in lines])
def test_examples_are_read_by_the_program(line, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    program, *words = shlex.split(line)
    assert program == "mazeplan"
    path = next(path for path in sorted(HELP, key=len, reverse=True) if words[: len(path.split())] == path.split())
    command_of(path).make_context(path, words[len(path.split()) :])  # raises for an unknown option or a bad value


def test_lists_of_commands_are_not_cut():
    for group in ("", *(name for name, command in get_command(app).commands.items() if hasattr(command, "commands"))):
        assert "..." not in said(*group.split(), "-h", env={"COLUMNS": "80"}).partition("Commands:")[2], group


def test_help_is_as_wide_as_the_terminal():
    def widest(columns):
        ran = subprocess.run(
            [sys.executable, "-m", "mazeplan", "navigate", "-h"], capture_output=True, text=True, check=True,
            env={**os.environ, "COLUMNS": str(columns)},
        )  # fmt: skip
        return max(map(len, ran.stdout.splitlines()))

    assert 60 < widest(80) <= 80 < widest(110) <= 110


@pytest.mark.slow
@pytest.mark.parametrize(
    ("words", "expected"),
    [
        ("navigate --rig to", {"toy"}),
        ("evaluate --map ", set(packaged_maps())),
        ("navigate --map lopsided --from ", {"ring1", "ring2", "ring3", "centre"}),
        ("navigate --close 4", {"4-5@180"}),
        ("effect show dry", {"dry_friction"}),
        ("model show r", {"rough"}),
        ("behavior show way", {"waypoints"}),
        ("navigate --map nothing --close 4", set()),
        ("log info ", {"a.mcap", "folder/"}),
    ],
)
def test_a_shell_completes_names(words, expected, tmp_path):
    (tmp_path / "a.mcap").touch()
    (tmp_path / "a.txt").touch()
    (tmp_path / "folder").mkdir()
    line = f"mazeplan {words}"
    code = "import sys; sys.argv[0] = 'mazeplan'; from mazeplan.__main__ import main; main()"
    ran = subprocess.run(
        [sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, check=False,
        env={
            **os.environ, "_MAZEPLAN_COMPLETE": "complete_bash", "COMP_WORDS": line,
            "COMP_CWORD": str(len(line.split()) - (not line.endswith(" "))),
        },
    )  # fmt: skip
    assert (ran.returncode, ran.stderr) == (0, "")
    assert set(ran.stdout.split()) - {"folder/"} == expected - {"folder/"}


def test_lists_have_a_sentence_for_each_name():
    maps, rigs = said("map", "list"), said("rig", "list")
    for name in packaged_maps():
        assert next(line for line in maps.splitlines() if line.startswith(name)).count(" ") > 8
    for name in rig_names():
        assert next(line for line in rigs.splitlines() if line.split()[:1] == [name]).count(" ") > 4
    assert [row["name"] for row in json.loads(said("map", "list", "--json"))] == list(packaged_maps())
    assert {row["name"]: row["kind"] for row in json.loads(said("model", "list", "--json"))} == {
        "ideal": "pi", "rough": "sp", "toy": "sp",
    }  # fmt: skip
    assert [line.split()[0] for line in said("model", "list").splitlines()] == list(model_names())


def test_a_rig_and_a_model_are_shown():
    text = said("rig", "show", "toy")
    assert "camera_noise_mm              0.5          standard deviation per axis" in text.replace("\n  ", "\n")
    assert "class  mazeplan.rigs.hardware:HardwareRig" in said("rig", "show", "hardware")
    assert json.loads(said("rig", "show", "toy", "--json"))["settings"]["table_x_deg"] == 0.3
    text = said("model", "show", "toy")
    assert "camera_delay_s: 0.0651076 ± 0.0015 s" in text
    assert "ring 5:" in text
    assert json.loads(said("model", "show", "toy", "--json"))["rings"]["1"]["rolling_inertia"]["factor"]["unit"] == "1"


@pytest.mark.slow
def test_what_is_shown_exists_or_is_told_in_one_line():
    for words, told in (
        (("model", "show", "nothing"), "nothing"),
        (("rig", "show", "nothing"), "expected one of hardware"),
        (("rig", "show", "module:Class"), "expected a name from `rig list` or a YAML file"),
    ):
        ran = subprocess.run(
            [sys.executable, "-m", "mazeplan", *words], capture_output=True, text=True, check=False
        )  # fmt: skip
        assert (ran.returncode, ran.stdout) == (2, "")
        assert told in ran.stderr
        assert ran.stderr.count("\n") == 1


def test_every_packaged_file_says_what_it_is():
    from mazeplan.apps.cli.output import headline

    for path in (*resources.share("maps").glob("*.yaml"), *(resources.PACKAGE / "rigs").glob("*.yaml")):
        assert 10 < len(headline(path)) < 160, path
