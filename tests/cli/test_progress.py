from __future__ import annotations

import io
import os
import pty
import re
import subprocess
import sys

import pytest

from mazeplan.cli.progress import LINES_SHOWN, NavigationProgress, campaign_progress
from mazeplan.records import Failure, FailureKind, NavigationResult, RingPassage


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


@pytest.fixture(autouse=True)
def terminal_kind(monkeypatch):
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.setenv("COLUMNS", "120")
    monkeypatch.setenv("LINES", "40")


def outcome(*, success: bool = True) -> NavigationResult:
    failure = Failure(FailureKind.STUCK, "Track", 1.2)
    reason = "arrived" if success else "out_of_time"
    rings = (RingPassage(1, 1.5, "1-2@45"), RingPassage(2, 0.5, None))
    return NavigationResult(success, reason, 2.0, 3, "toy", rings, (failure,), 0, {}, None)


def one_run(progress: NavigationProgress) -> None:
    with progress:
        progress.ring_entered(1, 0.0)
        for k in range(45):
            progress.tick(k / 30, 1, "Track")
        progress.event(1.2, "stuck, Track")
        progress.passed(1, "1-2@45", 1.5)
        progress.ring_entered(2, 1.5)
        progress.tick(2.0, 2, "Pass [x]")
        progress.finished(outcome())


def shown(stream: io.StringIO) -> list[str]:
    """The lines of the last picture, without the codes that move the cursor."""
    picture = re.split(r"\x1b\[1A|\r", stream.getvalue())[-1]
    plain = re.sub(r"\x1b\[[0-9;?]*[A-Za-z]", "", stream.getvalue() if "ring" not in picture else picture)
    return [" ".join(line.split()) for line in plain.splitlines() if line.strip()]


def test_elsewhere_than_on_a_terminal_each_event_is_a_plain_line():
    stream = io.StringIO()
    one_run(NavigationProgress(stream))
    assert stream.getvalue().splitlines() == [
        "   0.00 s  in ring 1",
        "   1.20 s  stuck, Track",
        "   1.50 s  left ring 1 by 1-2@45",
        "   1.50 s  in ring 2",
        "   2.00 s  arrived (rig toy, seed 3, 1 failure)",
    ]


def test_a_run_that_did_not_arrive_names_the_reason():
    stream = io.StringIO()
    with NavigationProgress(stream) as progress:
        progress.finished(outcome(success=False))
    assert stream.getvalue() == "   2.00 s  did not arrive: out_of_time (rig toy, seed 3, 1 failure)\n"


def test_on_a_terminal_there_is_a_line_per_ring():
    stream = Terminal()
    one_run(NavigationProgress(stream))
    lines = shown(stream)
    assert "ring 1 1.50 s 1-2@45 stuck, Track" in lines
    assert "ring 2 0.50 s arrived" in lines
    assert lines[-1] == "2.00 s arrived (rig toy, seed 3, 1 failure)"
    assert "left ring 1" not in stream.getvalue()


def test_brackets_in_a_name_are_no_markup():
    stream = Terminal()
    with NavigationProgress(stream) as progress:
        progress.ring_entered(1, 0.0)
        progress.event(0.1, "stuck in [/b] [red]")
    assert "stuck in [/b] [red]" in shown(stream)[-1]


def test_the_current_ring_stays_on_the_screen():
    progress = NavigationProgress(Terminal(), live=True)
    with progress:
        for k in range(40):
            progress.ring_entered(1 + k % 2, float(k))
            for text in ("a", "b", "c", "d"):
                progress.event(float(k), text)
    table = progress._table()
    assert table.row_count == LINES_SHOWN
    assert progress._lines[-1].cells()[-1] == "2 before; c; d"


def test_an_exception_ends_the_picture():
    stream = Terminal()
    progress = NavigationProgress(stream)

    def interrupted():
        with progress:
            progress.ring_entered(1, 0.0)
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    assert progress._live is None
    assert stream.getvalue().endswith("\x1b[?25h")  # the cursor is shown again


@pytest.mark.parametrize("kind", ["dumb", ""])
def test_a_terminal_that_cannot_redraw_gets_plain_lines(monkeypatch, kind):
    monkeypatch.setenv("TERM", kind)
    stream = Terminal()
    one_run(NavigationProgress(stream))
    assert "\x1b" not in stream.getvalue()
    assert "in ring 1" in stream.getvalue()


def test_events_before_the_first_ring_are_no_error():
    stream = io.StringIO()
    with NavigationProgress(stream) as progress:
        progress.tick(0.0, 1, "Wait")
        progress.passed(1, "1-2@45", 0.0)
        progress.event(0.1, "ball_lost")
    assert "ball_lost" in stream.getvalue()


def test_a_campaign_has_a_bar_with_rate_and_time_left_on_a_terminal():
    stream = Terminal()
    with campaign_progress(4, stream) as advance:
        for finished in range(1, 5):
            advance(finished)
    text = re.sub(r"\x1b\[[0-9;?]*[A-Za-z]", "", stream.getvalue())
    assert re.search(r"runs .*4/4 +[\d.]+/s +left +0:00:00", text)


def test_a_campaign_is_silent_elsewhere():
    stream = io.StringIO()
    with campaign_progress(2, stream) as advance:
        advance(1)
        advance(2)
    assert stream.getvalue() == ""


SCRIPT = """
import sys
from mazeplan.cli.progress import NavigationProgress, campaign_progress
with NavigationProgress() as progress:
    progress.ring_entered(1, 0.0)
    print("on stdout")
with campaign_progress(1) as advance:
    advance(1)
"""


def test_on_a_real_terminal_stdout_stays_clean():
    keyboard, screen = pty.openpty()
    done = subprocess.run([sys.executable, "-c", SCRIPT], stdout=subprocess.PIPE, stderr=screen, text=True, check=True)
    os.close(screen)
    drawn = os.read(keyboard, 65536).decode()
    os.close(keyboard)
    assert done.stdout == "on stdout\n"
    assert "ring 1" in drawn
    assert "1/1" in drawn


def test_rich_is_not_imported_before_it_is_needed():
    code = (
        "import sys, mazeplan.cli.progress, mazeplan.cli.log; sys.exit('rich' in sys.modules or 'numpy' in sys.modules)"
    )
    found = subprocess.run([sys.executable, "-c", code], check=False).returncode
    assert found == 0
