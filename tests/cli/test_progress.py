"""Progress on a terminal and elsewhere."""

from __future__ import annotations

import io
import re
import subprocess
import sys
from contextlib import redirect_stderr
from dataclasses import replace

import pytest
from commands import plain

from mazeplan.apps.cli import progress
from mazeplan.apps.cli.progress import NavigationProgress, ProgressBar
from mazeplan.core.records import Failure, FailureKind, NavigationResult, RingPassage


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


@pytest.fixture(autouse=True)
def terminal_kind(monkeypatch):
    for name, value in (("TERM", "xterm"), ("COLUMNS", "120"), ("LINES", "40")):
        monkeypatch.setenv(name, value)


def outcome(*, success: bool = True) -> NavigationResult:
    failure = Failure(FailureKind.STUCK, "Track", 1.2)
    reason = "arrived" if success else "out_of_time"
    rings = (RingPassage(1, 1.5, "1-2@45"), RingPassage(2, 0.5, None))
    return NavigationResult(success, reason, 2.0, 3, "toy", rings, (failure,), 0, {}, None)


def test_each_event_of_a_run_is_a_plain_line(capsys):
    progress = NavigationProgress("toy")
    progress.ring_entered(1, 0.0)
    for k in range(45):
        progress.tick(k / 30, 1, "Track")
    progress.event(1.2, "stuck, Track")
    progress.passed(1, "1-2@45", 1.5)
    progress.ring_entered(2, 1.5)
    progress.tick(2.0, 2, "Pass [x]")
    progress.finished(outcome())
    assert capsys.readouterr().err.splitlines() == [
        "   0.00 s  in ring 1",
        "   1.20 s  stuck, Track",
        "   1.50 s  left ring 1 by 1-2@45",
        "   1.50 s  in ring 2",
        "   2.00 s  arrived (rig toy, seed 3, 1 failure)",
    ]


@pytest.mark.parametrize(
    ("kinds", "reason", "log", "command"),
    [
        (["missed_opening", "missed_opening", "stuck", "out_of_time"], "out_of_time", "a.mcap", "report a.mcap"),
        (["missed_opening", "out_of_time"], "out_of_time", None, "report run.mcap"),
        (["misfit"], "misfit", "a.mcap", "rig check my/toy.yaml"),
        (["ball_lost", "out_of_time"], "out_of_time", None, "rig check my/toy.yaml"),
        (["no_route"], "no_route", None, "map route"),
        (["out_of_time"], "out_of_time", None, "--time-limit"),
        ([], "failed", None, "behavior check"),
    ],
)
def test_a_run_that_does_not_arrive_ends_with_what_to_look_at_next(capsys, kinds, reason, log, command):
    failures = tuple(Failure(FailureKind(kind), "Track", 1.2) for kind in kinds)
    result = replace(outcome(success=False), failures=failures, reason=reason, log=log)
    NavigationProgress("my/toy.yaml").finished(result)
    last = capsys.readouterr().err.splitlines()[-1]
    assert last.startswith("next: ")
    assert command in last


def campaign():
    with ProgressBar("runs", transient=False) as bar:
        for finished in range(5):
            bar.advance(finished, 4)


def unknown_length():
    with ProgressBar("searching") as bar:
        bar.show("trying [a]")
        bar.advance(1, 4)
        bar.show("trying [b]")
        bar.advance(4, 4)
        bar.show("trying [c]")
        bar.note("found [c]")


def shares():
    with ProgressBar("training", transient=False) as bar:
        bar.advance(0.0, 2.5)
        bar.advance(0.5, 2.5)


@pytest.mark.parametrize(
    ("work", "pattern", "notes"),
    [
        (campaign, r"runs .*100% +0:00:00", ""),
        (unknown_length, r"(?s)\nfound \[c\]\n.*searching .*trying \[c\]", "found [c]\n"),
        (shares, r"training .*20%", ""),
    ],
)
def test_a_bar_shows_step_and_share_on_a_terminal_only_and_notes_everywhere(work, pattern, notes):
    terminal, elsewhere = Terminal(), io.StringIO()
    with redirect_stderr(terminal):
        work()
    assert re.search(pattern, plain(terminal.getvalue()))
    with redirect_stderr(elsewhere):
        work()
    assert elsewhere.getvalue() == notes


def test_rich_and_numpy_are_imported_only_when_used():
    unwanted = "[name for name in ('rich', 'numpy') if name in sys.modules]"
    code = f"import sys, mazeplan.apps.cli.progress, mazeplan.apps.cli.log; sys.exit(bool({unwanted}))"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def test_without_a_terminal_a_new_step_is_a_line_after_a_while(monkeypatch, capsys):
    now = [0.0]
    monkeypatch.setattr(progress, "monotonic", lambda: now[0])
    with ProgressBar("learning") as bar:
        for now[0], step in ((1.0, "reading"), (9.0, "stage"), (10.0, "ball"), (18.0, "judging")):
            bar.show(step)
    assert capsys.readouterr().err == "learning: stage\nlearning: judging\n"
