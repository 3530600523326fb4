from __future__ import annotations

import contextlib
import io
import os
import pty
import re
import subprocess
import sys
import threading

import pytest
from commands import plain
from replayed import planar

from mazeplan.cli.progress import LINES_SHOWN, NavigationProgress, Working, campaign_progress
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


def test_work_of_which_nothing_more_is_known_shows_how_long_it_takes_and_what_is_done():
    stream = Terminal()
    with Working("searching", stream) as shown:
        shown.tell("trying [a]")
        shown.advance(1, 4)
        shown.tell("trying [b]")
        shown.advance(4, 4)
        shown.tell("trying [c]")
        shown.line("found [c]")
    text = plain(stream.getvalue())
    assert re.search(r"searching .*0:00:00 +trying \[c\]", text)
    assert "\nfound [c]\n" in text


def test_a_share_that_is_no_count_is_told_in_percent_and_without_rate():
    stream = Terminal()
    with Working("training", stream, transient=False) as shown:
        shown.advance(0.0, 2.5)
        shown.advance(0.5, 2.5)
    assert re.search(r"training .*20 %  left", plain(stream.getvalue()))
    assert "/s" not in plain(stream.getvalue())


def test_work_is_silent_elsewhere():
    stream = io.StringIO()
    with Working("searching", stream) as shown:
        shown.tell("trying")
        shown.line("found")
        shown.advance(1, 2)
    assert stream.getvalue() == ""


COMPILING = """
import time
from numba import njit
from mazeplan.cli import progress
with progress.Working("work") as shown:
    for limit in (60.0, 0.001, 0.001):
        progress.COMPILING_S = limit
        njit(lambda x: x + 1)(2)
        time.sleep(0.1)
        shown.line(f"limit {limit}")
"""


def test_compiling_that_takes_long_is_told_once():
    drawn = on_terminal(COMPILING)[1]
    assert drawn.count("compiling, once for this machine") == 1
    assert drawn.index("limit 60.0") < drawn.index("compiling, once") < drawn.index("limit 0.001")


def test_compiling_is_told_without_a_terminal_too():
    done = subprocess.run(
        [sys.executable, "-c", COMPILING.replace("60.0", "9.0")], capture_output=True, text=True, check=True
    )
    assert done.stderr == "compiling, once for this machine: up to two minutes\n"


def test_what_is_found_one_by_one_is_shown_while_it_is_sought(monkeypatch):
    monkeypatch.setenv("TERM", "xterm")
    stream = io.StringIO()
    stream.isatty = lambda: True
    found = list(Working("checking", stream, compiles=False).over(["clock", "signs"], lambda name: f"after {name}"))
    assert found == ["clock", "signs"]
    assert "checking" in stream.getvalue()
    assert "after clock" in stream.getvalue()


def on_terminal(script):
    """What a script prints, and what it draws on the terminal that its stderr is."""
    keyboard, screen = pty.openpty()
    drawn: list[bytes] = []

    def read() -> None:
        with contextlib.suppress(OSError):  # so it ends on Linux
            while part := os.read(keyboard, 4096):
                drawn.append(part)

    reader = threading.Thread(target=read)
    reader.start()
    done = subprocess.run([sys.executable, "-c", script], stdout=subprocess.PIPE, stderr=screen, text=True, check=True)
    os.close(screen)
    reader.join()
    os.close(keyboard)
    return done.stdout, b"".join(drawn).decode()


SCRIPT = """
import sys
from mazeplan.cli.progress import NavigationProgress, Working, campaign_progress
with NavigationProgress() as progress:
    progress.ring_entered(1, 0.0)
    print("on stdout")
with campaign_progress(1) as advance:
    advance(1)
with Working("searching") as shown:
    shown.tell("here")
"""


def test_on_a_real_terminal_stdout_stays_clean():
    out, drawn = on_terminal(SCRIPT)
    assert out == "on stdout\n"
    assert "ring 1" in drawn
    assert "1/1" in drawn
    assert re.search(r"searching .*here", plain(drawn))


def test_rich_is_not_imported_before_it_is_needed():
    code = (
        "import sys, mazeplan.cli.progress, mazeplan.cli.log; sys.exit('rich' in sys.modules or 'numpy' in sys.modules)"
    )
    found = subprocess.run([sys.executable, "-c", code], check=False).returncode
    assert found == 0


@pytest.mark.parametrize("words", [("log", "info"), ("report", "-o", "page.html"), ("map", "show", "--log")])
def test_a_log_that_is_read_is_named_on_a_terminal_and_not_elsewhere(words, tmp_path, monkeypatch):
    """The bar is wiped when all is done, so that it is looked for in what was written to the terminal until then."""

    from mazeplan.cli.app import app

    log = tmp_path / "of_half_an_hour.mcap"
    planar(log, start=4)
    told = Terminal()
    for stream, seen in ((io.StringIO(), False), (told, True)):
        monkeypatch.setattr(sys, "stderr", stream)
        monkeypatch.chdir(tmp_path)
        with contextlib.suppress(SystemExit), contextlib.redirect_stdout(io.StringIO()):
            app([*words, str(log)], standalone_mode=False)
        bars = [line for line in stream.getvalue().split("\r") if "of_half_an_hour" in line and "━" in line]
        assert bool(bars) is seen
