"""Files and folders of a command line: one rule for all commands, before any work begins."""

from __future__ import annotations

import errno
import os
import re
from pathlib import Path

import pytest
from typer.main import get_command

from mazeplan.apps.cli.app import app
from mazeplan.apps.cli.path_checks import METAVARS
from mazeplan.core.resources import share

MINE = b"mine\n"
OTHER = {  # metavars that name no file or folder
    "DEG", "EFFECT", "HZ", "M", "MM", "N", "NAME", "NxN", "OPENING", "RING", "RINGS", "S", "TEXT", "ADDRESS", "PORT",
    "KINDS", "SYSTEM", "MODULE", "MODULE:FUNCTION", "EFFECT.PARAM=VALUE", "PICTURES",
}  # fmt: skip


ENDINGS = {  # of files to write; others end in .yaml here
    "report -o": ".html", "compare --report": ".html", "evaluate --report": ".html", "compare --curve": ".png",
    "policy export -o": ".h", "new tree -o": ".xml", "record -o": ".parquet", "navigate --log": ".mcap",
    "collect -o": ".mcap", "navigate --video": ".gif", "report --video": ".gif", "log export -o": ".csv",
    "map show -o": ".png", "behavior show -o": ".png", "behavior palette -o": ".xml", "calibrate tilt --keep": ".csv",
    "calibrate camera --sheet": ".pdf",
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


# -- endings, and folders to write into ---------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("line", "ending"),
    [
        ("navigate --log run.csv", ".mcap"), ("navigate --log run", ".mcap"), ("collect -o g.csv", ".mcap"),
        ("navigate --video run.mcap", ".mp4, .gif"), ("report a.mcap -o a.html --video run.avi", ".mp4, .gif"),
        ("navigate --memory run.mcap", ".yaml, .yml, .json"), ("log export a.mcap -o x.mcap", ".csv"),
        ("map show -o map.yaml", ".png, .svg, .pdf"), ("map learn a.csv -o map.csv", ".yaml, .yml"),
        ("behavior show -o tree.xml", ".png, .svg, .pdf"), ("behavior palette -o palette.yaml", ".xml"),
        ("rig check toy -o latency.csv", ".yaml, .yml"), ("calibrate tilt --keep readings.yaml", ".csv"),
        ("calibrate camera --sheet sheet.csv", ".pdf, .svg, .png"),
    ],
)  # fmt: skip
def test_an_ending_of_another_kind_is_refused(refused, tmp_path, monkeypatch, line, ending):
    monkeypatch.chdir(tmp_path)
    name = line.split()[-1]
    assert refused(*line.split()).endswith(f"got '{name}', expected a file that ends in {ending}\n")
    assert not Path(name).exists()


@pytest.mark.parametrize("option", ["--video x.gif", "--memory x.yaml", "--log x.mcap"])
def test_a_folder_that_cannot_be_made_is_seen_before_the_run(refused, desk, option):
    name, file = option.split()
    assert "a.csv is a file; expected a folder that can be made" in refused("navigate", name, f"a.csv/{file}")


def test_the_folder_of_a_memory_is_made(call, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert call("navigate", "--rig", "ideal", "--from", "ring4", "--memory", "new/doors.yaml")[0] == 0
    assert Path("new/doors.yaml").read_text().startswith("# What happened")


# -- what is written is neither read nor written by another option -------------------------------------------------


@pytest.fixture
def desk(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for name in ("a.yaml", "a.csv", "a.mcap", "model/model.yaml"):
        Path(name).parent.mkdir(exist_ok=True)
        Path(name).write_bytes(MINE)
    Path("a.csv").write_bytes(b"mine, too\n")
    Path("copy.csv").write_bytes(Path("a.csv").read_bytes())
    for ending in ("mcap", "csv", "yaml"):
        Path(f"link.{ending}").symlink_to("a.mcap")
        os.link("a.mcap", f"hard.{ending}")
    os.mkfifo("pipe.mcap")


@pytest.mark.parametrize(
    "line",
    [
        "navigate --map a.mcap --log a.mcap", "navigate --settings ./a.mcap --log model/../a.mcap",
        "log export a.mcap -o link.csv", "log export link.mcap -o hard.csv",
        "map learn a.csv --map a.yaml -o a.yaml", "diagnose a.csv --model model -o model",
        "improve --rig a.yaml --model model -o model", "learn model/model.yaml -o model",
    ],
)  # fmt: skip
def test_what_is_read_is_not_written(refused, desk, line):
    assert "which is read; expected another name" in refused(*line.split(), "--force")
    assert Path("a.mcap").read_bytes() == Path("a.yaml").read_bytes() == MINE


@pytest.mark.parametrize(
    "line",
    [
        "behavior palette --into x.xml -o x.xml", "behavior palette --into a/x.xml -o a/../a/x.xml",
        "navigate --log a.mcap --memory link.yaml", "navigate --log a.mcap --memory hard.yaml",
        "report a.mcap -o x.html --pictures x.html",
    ],
)  # fmt: skip
def test_two_outputs_have_two_names(refused, desk, line):
    assert refused(*line.split(), "--force").endswith(", too; expected two names\n")


@pytest.mark.parametrize(
    ("line", "names"),
    [
        ("learn a.csv a.csv -o out", "a.csv a.csv"), ("map learn a.csv ./a.csv -o out.yaml", "a.csv a.csv"),
        ("learn a.csv a.mcap link.csv -o out", "a.mcap link.csv"), ("score toy a.csv copy.csv", "a.csv copy.csv"),
        ("compare a.csv --test link.mcap --test hard.mcap", "link.mcap hard.mcap"),
        ("compare a.csv --test a.csv", "a.csv a.csv"), ("diagnose a.mcap --reference hard.csv", "hard.csv a.mcap"),
    ],
)  # fmt: skip
def test_a_log_is_given_once(refused, desk, line, names):
    found = re.fullmatch(
        r"mazeplan: (?:LOG|--\w+): (\S+) is given again as \S+ (\S+); expected each log once\n", refused(*line.split())
    )
    assert found is not None
    assert sorted(found.groups()) == sorted(names.split())


def test_where_the_program_runs_may_be_written_what_is_read_there(refused, desk):
    assert "missing columns: t" in refused("learn", "a.csv", "-o", ".", "--force")


@pytest.mark.parametrize(("path", "option", "command"), list(named()))
def test_a_named_pipe_is_refused_before_it_is_opened(refused, desk, path, option, command):
    words = line_with(path, option, command, "pipe")
    Path("pipe.mcap").rename(words[words.index(next(w for w in words if w.startswith("pipe.")))])
    error = refused(*words)
    assert "pipe" in error
    assert "; expected a f" in error


# -- files that are read-only -------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "line",
    [
        "behavior palette --into a.xml", "navigate --memory a.yaml", "behavior palette -o a.xml --force",
        "learn a.csv -o model --force",
    ],
)  # fmt: skip
def test_what_is_read_only_stays(refused, desk, line):
    Path("a.xml").write_text(packaged("navigate"))
    Path("a.xml").chmod(0o444)
    Path("a.yaml").chmod(0o444)
    Path("model").chmod(0o555)
    assert " is read-only; expected a file or folder that may be written to" in refused(*line.split())
    assert Path("a.xml").read_text() == packaged("navigate")
    Path("model").chmod(0o755)


def packaged(tree):
    return (share("behaviors") / f"{tree}.xml").read_text()


@pytest.mark.parametrize(
    ("words", "option"), [(("log", "info", "shut.mcap"), ""), (("view", "shut.mcap"), ""),
                          (("diagnose", "log.csv", "--test", "shut.mcap"), "--test: ")]
)  # fmt: skip
def test_a_file_that_may_not_be_read_is_told_in_our_words(refused, monkeypatch, tmp_path, words, option):
    monkeypatch.chdir(tmp_path)
    for name in ("shut.mcap", "log.csv"):
        (tmp_path / name).touch()
    may = os.access
    monkeypatch.setattr(os, "access", lambda path, *more, **m: "shut" not in str(path) and may(path, *more, **m))
    problem = "shut.mcap: cannot be read: Permission denied; expected a file that you may read: chmod u+r shut.mcap"
    assert refused(*words) == f"mazeplan: {option}{problem}\n"
