"""A recorded run on the page (`mazeplan view LOG`): the moments of its log, the time that is shown, and the tab.

The time is that of the rig's clock, s.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from mazeplan.apps.view.page import RunView, draw_loop, html, open_page
from mazeplan.apps.view.server import check_installed, listen, url_of
from mazeplan.apps.view.story import Moment, maze_of, moments
from mazeplan.core.errors import LogError
from mazeplan.core.logs.run_log_reader import checked_fields, read_messages
from mazeplan.core.records import Array

if TYPE_CHECKING:
    from viser import ViserServer

SPEEDS = ("0.1×", "0.25×", "0.5×", "1×", "2×", "4×")  # of the original speed
_NEAR = 1e-6  # s; times that are no farther apart are the same tick


@dataclass(frozen=True)
class RecordedRun:
    """One log."""

    name: str
    moments: Sequence[Moment]  # one for each tick
    times: Array  # of the ticks, (N,), never decreasing
    complete: bool  # whether the program finished the log

    @property
    def failures(self) -> list[float]:
        """Times at which something failed."""
        found = {moment.failure.t for moment in self.moments if moment.failure is not None}
        return sorted(t for t in found if self.times[0] <= t <= self.times[-1])

    def tick_at(self, t: float) -> int:
        """The number, from 0, of the last tick until time t; before the first tick, 0."""
        return max(0, int(np.searchsorted(self.times, t + _NEAR, side="right")) - 1)


def open_recording(path: str | Path) -> RecordedRun:
    """Open a log, also a log that was cut off or that an older version wrote. Raises LogError if it cannot be shown."""
    path = Path(path)
    _, messages, complete = read_messages(path)
    with checked_fields(path):
        shown = moments(messages)
    if not shown:
        raise LogError("holds no tick, there is nothing to show", file=path)
    times = np.array([moment.t for moment in shown])
    if not np.isfinite(times).all():
        raise LogError("damaged: a tick without a time", file=path)
    return RecordedRun(path.name, shown, np.maximum.accumulate(times), complete)


class Playback:
    """The time that a replay shows, s, between the first and the last tick."""

    def __init__(self, first: float, last: float) -> None:
        self.first, self.last = first, last
        self.t, self.playing, self.speed = first, False, 1.0

    def seek(self, t: float) -> None:
        """Go to a time, and stay there."""
        self.playing = False
        self.t = min(max(t, self.first), self.last)

    def toggle(self) -> None:
        """Go on or stop; at the end, go on from the beginning."""
        self.playing = not self.playing
        if self.playing and self.t >= self.last - _NEAR:
            self.t = self.first

    def advance(self, seconds: float) -> None:
        """Let wall time pass, s."""
        if self.playing:
            self.t = min(self.t + self.speed * max(seconds, 0.0), self.last)
            self.playing = self.t < self.last - _NEAR


class ReplayTab:
    """What the page of a recorded run shows."""

    def __init__(self, server: ViserServer, recording: RecordedRun) -> None:
        gui, times = server.gui, recording.times
        self._recording, self._before, self._drawn = recording, 0.0, ()
        self._player = player = Playback(float(times[0]), float(times[-1]))
        self._head = gui.add_html("")
        first, span = round(player.first, 2), max(round(player.last - player.first, 2), 0.01)
        marks = tuple(round(t, 2) for t in recording.failures)
        self._slider = gui.add_slider("Time (s)", first, round(first + span, 2), 0.01, first, marks=marks or None)
        self._slider.on_update(self._seek)
        self._play = gui.add_button("Play", color="blue", hint="space")
        self._play.on_click(lambda event: player.toggle())
        gui.add_command("Play or stop", hotkey="space").on_trigger(lambda event: player.toggle())
        speed = gui.add_dropdown("Speed", SPEEDS, initial_value="1×", hint="1×: as fast as it was")
        speed.on_update(lambda event: setattr(player, "speed", float(event.target.value[:-1])))
        self._view = RunView(server, maze_of(recording.moments[0].header))

    def _seek(self, event: Any) -> None:
        if event.client_id is not None:  # else the program has moved the slider
            self._player.seek(event.target.value)

    def draw(self, now: float) -> None:
        """Let time pass, and draw the moment of the new time; now: monotonic, s."""
        self._player.advance(now - self._before if self._before else 0.0)
        self._before = now
        t, playing = self._player.t, self._player.playing
        self._view.show(self._recording.moments[self._recording.tick_at(t)], now)
        if (shown := (round(t, 2), playing)) != self._drawn:
            self._drawn = shown
            self._slider.value = min(max(round(t, 2), self._slider.min), self._slider.max)
            self._play.label = "Stop" if playing else "Play"
            self._head.content = head_html(self._recording, t)


def head_html(recording: RecordedRun, t: float) -> str:
    """File, rig, map and seed of a run, the tick that is shown, and whether its log is whole."""
    header = recording.moments[0].header
    keys = (("rig", "rig"), ("map", "map_name"), ("seed", "seed"))
    facts = ", ".join(f"{word} {header[key]}" for word, key in keys if header.get(key) not in (None, ""))
    cut = "" if recording.complete else " · the log was cut off"
    tick = f"tick {recording.tick_at(t) + 1} of {len(recording.moments)}{cut}"
    return html("recorded_head", recording.name, facts, tick, t)


def show_log(recording: RecordedRun, port: int) -> None:
    """Show a run until Ctrl-C. Raises InputError for a port that cannot be used, and without viser."""
    check_installed()
    with listen(port) as listening:
        server, ready = open_page(listening)
        tab = ReplayTab(server, recording)
        ready.set()
        try:
            with suppress(OSError):  # stderr may be closed; the page goes on
                print(f"page: {url_of(listening)}", file=sys.stderr, flush=True)
            draw_loop(server, tab.draw, lambda: True)
        except KeyboardInterrupt:  # Ctrl-C is the usual way to end a page
            pass
        finally:
            server.stop()
