"""Every command in README and docs/ runs as it stands there, and does what it says (`pages` has the rules)."""

from __future__ import annotations

import json
import re
import shlex
import subprocess
import sys
import tomllib
from functools import cache
from pathlib import Path
from typing import Any

import pages
import pytest
import typer
import warm
from commands import call
from pages import ROOT, Block

OWN_TESTS = {"docs/trees.md", "docs/testing-trees.md"}  # of their Python and files: test_trees_page, test_testing_page
BLOCKS = {page: pages.blocks(page) for page in pages.pages()}
RUN = {
    page: [b for b in of if b.kind == "console" and not {"not run", "same as"} & set(b.marks)]
    for page, of in BLOCKS.items()
}
FIRST = [page for page, of in RUN.items() if of and any("after" not in b.marks for b in of)]
NOT_RUN = [b for of in BLOCKS.values() for b in of if "not run" in b.marks]
PROGRAMS = {"mazeplan", "cp", "mkdir", "sed", "pytest"}  # that are run
USAGE: type[Exception] = typer.BadParameter.__base__  # of typer's own


def run(words: list[str], cwd: Path) -> subprocess.CompletedProcess[str]:
    if words[0] == "mazeplan":
        return warm.run(words, cwd)
    if words[0] == "pytest":
        words = [sys.executable, "-m", *words]
    return subprocess.run(words, cwd=cwd, capture_output=True, text=True, timeout=300, check=False, env=warm.found())


@pytest.fixture
def desk(tmp_path):
    (tmp_path / "runs").mkdir()
    for folder in ("maps", "behaviors", "examples"):
        (tmp_path / folder).symlink_to(ROOT / folder)
    return tmp_path


def lay_out(page: str, desk: Path) -> None:
    """Write the files that a page shows."""
    for block in BLOCKS[page]:
        if block.file is not None:
            (desk / block.file).write_text(block.text, encoding="utf-8")


def follow(block: Block, desk: Path) -> None:
    """Run the commands of a block; what they are to write must then be there, what they read come from before."""
    for command in block.commands:
        words = block.tried(command)
        assert words[0] in PROGRAMS, f"{block.page}:{block.line}: {command}: not among {', '.join(sorted(PROGRAMS))}"
        words, target = (words[: words.index(">")], words[-1]) if ">" in words else (words, None)
        done = run(words, desk)
        if target is not None:
            (desk / target).write_text(done.stdout, encoding="utf-8")
        where = f"{block.page}:{block.line}: {command}"
        assert done.returncode in block.statuses, f"{where}\n{done.stdout}\n{done.stderr}"
        assert "Traceback" not in done.stderr, f"{where}\n{done.stderr}"
        for option in ("-o", "--log"):
            if option in words:
                written = words[words.index(option) + 1]
                assert (desk / written).exists(), f"{where} did not write {written}"


def after(page: str) -> list[Block]:
    """Blocks of other pages that go on where this one's end."""
    return [b for of in RUN.values() for b in of if f"docs/{b.marks.get('after')}" == page]


@pytest.mark.slow
@pytest.mark.parametrize("page", FIRST)
def test_commands_of_a_page_run_in_order(page, desk):
    lay_out(page, desk)
    for block in RUN[page]:
        if "after" not in block.marks:
            follow(block, desk)
    for block in after(page):
        follow(block, desk)
    assert any(block.commands for block in RUN[page])


def test_no_command_is_lost():
    ran = [b for page in FIRST for b in [*(b for b in RUN[page] if "after" not in b.marks), *after(page)]]
    assert len(ran) == sum(len(of) for of in RUN.values()) > 10
    everywhere = {page: {c for b in of for c in b.commands} for page, of in RUN.items()}
    for page, of in BLOCKS.items():
        for block in of:
            assert not (block.kind == "console" and not block.commands), f"{page}:{block.line}: no command behind $"
            if "same as" in block.marks:
                assert set(block.commands) <= everywhere[f"docs/{block.marks['same as']}"], f"{page}:{block.line}"


def test_words_to_test_with_go_to_the_command_that_they_name():
    marks = "<!-- tested with: fly --runs 1 -->\n<!-- tested with: --low -->\n"
    (block,) = pages.blocks("x", f"{marks}```console\n$ mazeplan fly\n$ mazeplan land\n```")
    assert [block.tried(command)[1:] for command in block.commands] == [
        ["fly", "--runs", "1", "--low"],
        ["land", "--low"],
    ]
    for block in (b for of in BLOCKS.values() for b in of):
        for first in (row.split()[0] for row in block.marks.get("tested with", "").splitlines()):
            named = [command for command in block.commands if command.startswith(f"mazeplan {first} ")]
            assert first.startswith("-") or named, f"{block.page}:{block.line}: tested with {first}, which is not there"


PROGRAM_BLOCKS = [
    b for page, of in BLOCKS.items() if page not in OWN_TESTS for b in of if b.kind == "python" and not b.file
]


@pytest.mark.slow
@pytest.mark.parametrize("block", PROGRAM_BLOCKS, ids=lambda b: f"{b.page}:{b.line}")
def test_programs_run(block, desk):
    done = warm.run(["-c", block.text], desk)
    assert done.returncode == 0, done.stderr
    if "print(" in block.text:
        assert done.stdout.startswith("True ")


# -- what is not run ------------------------------------------------------------------------------------------------


def check_words(words: list[str]) -> None:
    """Whether a command that is not run is at least one. Raises AssertionError."""
    program = words[0]
    if program == "sudo":
        return check_words(words[1:])
    if program == "mazeplan":
        parse(words[1:])
    elif program == "make":
        targets = re.findall(r"^([\w-]+):", (ROOT / "Makefile").read_text(), re.MULTILINE)
        folder = words[words.index("-C") + 1] if "-C" in words else None
        wanted = [w for w in words[1:] if "=" not in w and w not in ("-C", folder)]
        assert set(wanted) <= set(targets), f"make {wanted}: expected {targets}"
        assert folder is None or (ROOT / folder / "Makefile").is_file()
    elif program == "pip":
        extras = set(tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["optional-dependencies"])
        assert set(re.findall(r"\[(.*?)\]", words[-1])[0].split(",")) <= extras, words
    elif program == "apt-get":
        known = (ROOT / "Makefile").read_text() + pages.text_of("docs/hardware.md") + "chromium"
        assert words[1] == "install" and all(package in known for package in words[2:])  # noqa: PT018
    else:
        assert program in (".", "git", "cd", "avrdude"), f"what is {program}?"
    return None


@cache
def whole() -> Any:
    """The whole tree of commands."""
    from mazeplan.apps.cli.app import app

    return typer.main.get_command.__wrapped__(app)  # its own: Click keeps the help options of the first context


def parse(words: list[str]) -> None:
    """Go through the words as the program would, and do nothing."""
    command, path = whole(), "mazeplan"
    while hasattr(command, "commands"):
        assert words, f"{path}: expected a command"
        assert words[0] in command.commands, f"{path} {words[0]}: no such command"
        path, command, words = f"{path} {words[0]}", command.commands[words[0]], words[1:]
    command.make_context(path, list(words))


@pytest.mark.parametrize("block", NOT_RUN, ids=lambda b: f"{b.page}:{b.line}")
def test_what_cannot_be_run_can_be_read(block):
    for command in block.commands:
        check_words(shlex.split(command, comments=True))


def test_words_that_are_wrong_are_noticed():
    for wrong in ("mazeplan fly", "mazeplan navigate --sideways", "mazeplan map", "mazeplan collect --seconds x -o y",
                  "make tea", "pip install 'mazeplan[wings]'", "rm -r x"):  # fmt: skip
        with pytest.raises((AssertionError, USAGE)):
            check_words(shlex.split(wrong))


@pytest.mark.parametrize("page", pages.pages())
def test_commands_within_the_text_know_their_options(page):
    if page == "docs/changes.md":
        return
    text = pages.beyond_fences(page)
    assert not re.search(r"^ {4,}(\$ )?(mazeplan|make|sudo|pip) ", text, re.MULTILINE), (
        "commands stand in fenced blocks"
    )
    for told in re.findall(r"`(mazeplan [^`]*)`", text):
        command, words = whole(), told.split()[1:]
        while hasattr(command, "commands") and words and re.fullmatch(r"[a-z-]+", words[0]):
            assert words[0] in command.commands, f"{page}: {told}"
            command, words = command.commands[words[0]], words[1:]
        options = {option for parameter in command.params for option in parameter.opts} | {"--help"}
        used = {word.strip("[]") for word in words if re.match(r"\[?-{1,2}[a-z]", word)}
        assert hasattr(command, "commands") or used <= options, f"{page}: {told}"


# -- what else README says ------------------------------------------------------------------------------------------


def test_rig_example_has_what_a_rig_needs():
    from mazeplan.maze.mapfile import load_map
    from mazeplan.rigs.interface import Rig

    (text,) = (b.text for b in BLOCKS["docs/rigs.md"] if "class MyRig" in b.text)
    names: dict = {}
    exec(text, names)
    assert isinstance(names["MyRig"](load_map("cme"), {}), Rig)


def test_the_error_shown_is_the_error_got(desk, monkeypatch, capsys):
    shown = re.search(r"`runs/mine\.yaml:\d+: (openings\[\d+\]\.angle_deg: [^`]*)`", pages.text_of("docs/maps.md"))
    assert shown
    lines = (ROOT / "maps" / "cme.yaml").read_text(encoding="utf-8").splitlines()
    index = int(re.search(r"openings\[(\d+)\]", shown.group(1)).group(1))
    rows = [i for i, line in enumerate(lines) if "angle_deg:" in line and not line.lstrip().startswith("#")]
    lines[rows[index]] = re.sub(r"angle_deg: *[\d.]+", "angle_deg: 400", lines[rows[index]])
    (desk / "runs" / "mine.yaml").write_text("\n".join(lines), encoding="utf-8")
    monkeypatch.chdir(desk)
    code, _, err = call(monkeypatch, capsys, "map", "check", "runs/mine.yaml")
    assert code == 2
    assert shown.group(0).strip("`") in err


@pytest.mark.slow
def test_json_is_one_document_with_the_names_of_the_contract(desk):
    done = run(shlex.split("mazeplan navigate --from ring4 --to ring5 --rig ideal --json"), desk)
    document = json.loads(done.stdout)
    wanted = {"success", "reason", "time_s", "seed", "rig", "rings", "failures", "replans", "planner_ms", "log"}
    assert wanted <= set(document)
    assert set(document["rings"][0]) == {"ring", "time_s", "opening"}
    assert {"p50", "p99", "max"} <= set(document["planner_ms"])
    assert document["success"] is True
    assert done.returncode == 0
