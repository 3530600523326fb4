"""Nothing of a user's is overwritten without being asked: one rule for every option that names a new file or folder."""

from __future__ import annotations

import inspect
import json
import subprocess
import sys
import typing
from pathlib import Path

import pytest
from policies import hand_made
from report_documents import a_log, evaluation
from typer.main import get_command

from mazeplan.apps.cli import options as opt
from mazeplan.apps.cli.app import app
from mazeplan.control.policy import save_policy

MINE = b"mine\n"
RIG = "class: mazeplan.rigs.hardware:HardwareRig\nport: fake\n"
IDEAL = ("--rig", "ideal", "--from", "ring4")

# (command, option): further words of the command, and the file, or the folder with a file that the command writes
NEW: dict[tuple[str, str], tuple[tuple[str, ...], str]] = {
    ("navigate", "--log"): (IDEAL, "run.mcap"),
    ("navigate", "--video"): (IDEAL, "run.gif"),
    ("evaluate", "--report"): ((*IDEAL, "--runs", "1"), "page.html"),
    ("collect", "-o"): (("--rig", "ideal", "--seconds", "1"), "run.mcap"),
    ("report", "-o"): (("evaluation.json",), "page.html"),
    ("map show", "-o"): (("cme",), "maze.svg"),
    ("log export", "-o"): (("recorded.mcap",), "run.csv"),
    ("behavior palette", "-o"): ((), "palette.xml"),
    ("new rig", "-o"): (("cart",), "there/cart.py"),
    ("new map", "-o"): (("detour",), "mine.yaml"),
    ("new tree", "-o"): ((), "mine.xml"),
}
# the same, where the work is long: with --force they go on to an input that is not there
LONG: dict[tuple[str, str], tuple[tuple[str, ...], str]] = {
    ("learn", "-o"): (("no.csv",), "model/model.yaml"),
    ("compare", "--report"): (("no.csv",), "page.html"),
    ("diagnose", "-o"): (("no.csv",), "out/report.html"),
    ("improve", "-o"): (("--rig", "no.yaml"), "out/round1/round.json"),
    ("map learn", "-o"): (("no.csv",), "learned.yaml"),
    ("policy train", "-o"): (("--rig", "no.yaml"), "trained/policy.yaml"),
    ("data import-cme", "-o"): (("no",), "tables/ring1.csv"),
}
RENEWED = {  # docs/commands.md lists them
    ("evaluate", "--store"), ("evaluate", "-o"),
}  # fmt: skip


@pytest.fixture(autouse=True)
def desk(tmp_path, monkeypatch):
    """A working folder with what the commands of the table read."""
    monkeypatch.chdir(tmp_path)
    a_log(tmp_path / "recorded.mcap", rig="ideal", detail="")
    Path("evaluation.json").write_text(json.dumps(evaluation("some")))
    Path("hardware.yaml").write_text(RIG)
    save_policy(hand_made(), Path("policy"))
    return tmp_path


def there(name: str) -> tuple[Path, Path]:
    """A file of the user's; and what the option names, the file or its topmost folder."""
    path = Path(name)
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(MINE)
    return path, Path(path.parts[0])


def commands(group, path=()):
    """(name, command) of all commands."""
    for name, inner in getattr(group, "commands", {}).items():
        yield from commands(inner, (*path, name))
    if not hasattr(group, "commands"):
        yield " ".join(path), group


def test_each_output_is_new_or_in_the_list_of_those_that_are_renewed():
    outputs, new = set(), set()
    names = ("-o", "--log", "--video", "--report", "--store")
    for name, command in commands(get_command(app)):
        hints = typing.get_type_hints(inspect.unwrap(command.callback), include_extras=True)
        for param in command.params:
            key = name, min(param.opts, key=len)
            outputs |= {key} & {(name, option) for option in names}
            info = (typing.get_args(hints.get(param.name)) or (None, None))[1]
            if getattr(info, "callback", None) is opt.new_output:
                new.add(key)
                assert any("--force" in p.opts for p in command.params)
    assert new == {*NEW, *LONG}
    assert outputs - new - RENEWED == {("map show", "--log")}  # logs to read


@pytest.mark.parametrize(("command", "option"), [*NEW, *LONG])
def test_what_exists_stays_byte_for_byte(refused, command, option):
    words, name = {**NEW, **LONG}[command, option]
    path, named = there(name)
    before = {file: file.stat().st_mtime_ns for file in Path().rglob("*")}
    what = "files in it" if named.is_dir() else "it"
    line = f"mazeplan: {option}: {named} exists; expected a new name, or --force to replace {what}\n"
    assert refused(*command.split(), *words, option, named) == line
    assert path.read_bytes() == MINE
    assert {file: file.stat().st_mtime_ns for file in Path().rglob("*")} == before, "no work begins"


@pytest.mark.parametrize(
    "line",
    [
        "navigate --settings a.mcap --log a.mcap", "log export recorded.mcap -o link.csv",
        "map learn a.csv --map b.yaml -o ./b.yaml", "navigate --log a.mcap --settings link.yaml",
        "diagnose a.csv --model policy -o policy",
    ],
)  # fmt: skip
def test_an_output_is_never_another_file_of_the_command(refused, line):
    for name in ("b.yaml", "a.csv", "a.mcap"):
        there(name)
    Path("link.csv").symlink_to("recorded.mcap")
    Path("link.yaml").symlink_to("a.mcap")
    before = {file: file.read_bytes() for file in Path().rglob("*") if file.is_file()}
    assert "expected another name" in refused(*line.split(), "--force")
    assert {file: file.read_bytes() for file in Path().rglob("*") if file.is_file()} == before


# -- whole files ----------------------------------------------------------------------------------------------------


def test_stdout_may_be_a_pipe():
    words = [sys.executable, "-m", "mazeplan", "behavior", "palette", "-o", "/dev/stdout"]
    assert b"TreeNodesModel" in subprocess.run(words, capture_output=True, check=False, timeout=60).stdout
