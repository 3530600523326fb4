"""Looking back in a live run, while it goes on or after its end: a slider for the time, and jumps to failures."""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Callable
from html import escape
from threading import RLock
from typing import TYPE_CHECKING, Any

from mazeplan.apps.view.moment import Moment
from mazeplan.apps.view.page import FONT, pressed
from mazeplan.core.palette import COLOURS

if TYPE_CHECKING:
    from viser import ViserServer

    from mazeplan.core.records import Failure

HZ = 5.0  # maximum rate at which the slider follows the run
MOST, FEWER = 6000, 1000  # maximum number of kept moments; number of oldest moments dropped when there are more
_NEAR = 1e-6  # s


class Past:
    """The drawn moments of a run. Shows the newest moment until `seek` or `jump` selects a time."""

    def __init__(self) -> None:
        self._moments: list[Moment] = []
        self._times: list[float] = []
        self.failures: list[Failure] = []
        self.at: float | None = None  # s; None: the newest

    def keep(self, moment: Moment) -> None:
        """Add the newest moment. A moment of another run drops all earlier ones."""
        last = self._moments[-1] if self._moments else None
        if last is not None and moment.run != last.run:
            self.__init__()
        if not moment.tick:
            return
        if self._moments and moment.tick == self._moments[-1].tick:
            self._moments[-1] = moment  # has the messages since that tick: a tree, an event, the result
        else:
            self._moments.append(moment)
            self._times.append(max(moment.t, self._times[-1]) if self._times else moment.t)
        failure = moment.failure
        if failure is not None and (failure.t, failure.kind) not in {(f.t, f.kind) for f in self.failures}:
            self.failures.append(failure)
        if len(self._moments) > MOST:
            del self._moments[:FEWER], self._times[:FEWER]

    @property
    def last(self) -> float:
        """Time of the newest moment, s."""
        return self._times[-1] if self._times else 0.0

    def shown(self) -> Moment | None:
        """The moment to draw; None before the first."""
        if self.at is None or not self._moments:
            return self._moments[-1] if self._moments else None
        return self._moments[max(0, bisect_right(self._times, self.at + _NEAR) - 1)]

    def seek(self, t: float) -> None:
        """Look at a time, s. A time at the end follows the run again."""
        self.at = t if math.isfinite(t) and t < self.last - _NEAR else None

    def jump(self, direction: int) -> None:
        """Look at the next failure (1) or the previous failure (-1). After the last failure, follow the run again."""
        now = self.last if self.at is None else self.at
        times = [f.t for f in self.failures if direction * (f.t - now) > _NEAR]
        if times:
            self.at = min(times, key=lambda t: abs(t - now))
        elif direction > 0:
            self.at = None


class LookBack:
    """Slider, failures and buttons, in viser's current container."""

    def __init__(self, server: ViserServer) -> None:
        gui, self._lock, self.past = server.gui, RLock(), Past()
        self._slider = gui.add_slider("Time (s)", 0.0, 1.0, 0.01, 0.0, disabled=True, hint="look back in this run")
        self._marks = gui.add_html(marks_html(self.past, 1.0))
        jumps = gui.add_button_group("Failures", ["previous", "next", "now"], hint="keys P and N; now: follow the run")
        self._slider.on_update(self._pressed(lambda event: self.past.seek(event.target.value)))
        jumps.on_click(self._pressed(lambda event: self._jump(event.target.value)))
        gui.add_command("Next failure", hotkey="N").on_trigger(self._pressed(lambda event: self._jump("next")))
        gui.add_command("Previous failure", hotkey="P").on_trigger(self._pressed(lambda event: self._jump("previous")))
        self._drawn_at, self._drawn = 0.0, ()

    def _pressed(self, do: Callable[[Any], object]) -> Callable[[Any], None]:
        return pressed(self._lock, do)

    def _jump(self, what: str) -> None:
        if what == "now":
            self.past.at = None
        else:
            self.past.jump(1 if what == "next" else -1)

    def show(self, moment: Moment, now: float) -> Moment:
        """Keep the newest moment. Returns the moment to draw. now: s of any clock"""
        with self._lock:
            self.past.keep(moment)
            shown = self.past.shown() or moment
            at, last, count = shown.t, self.past.last, len(self.past.failures)
            state = (round(at, 2), round(last, 2), count, self.past.at is None)
            if state != self._drawn and now - self._drawn_at >= 1.0 / HZ:
                self._drawn, self._drawn_at = state, now
                end = max(1.0, float(math.ceil(last)))
                self._slider.disabled = last <= 0.0
                self._slider.max = end
                if self.past.at is None:  # otherwise a person holds the slider
                    self._slider.value = min(round(at, 2), end)
                elif abs(self._slider.value - self.past.at) > 0.01:
                    self._slider.value = round(self.past.at, 2)
                self._marks.content = marks_html(self.past, end)
            return shown


def marks_html(past: Past, end: float) -> str:
    """Failures as crosses below the slider, their number, and the time at which the page looks back, if it does.

    end: time at the right end of the slider, s"""
    ticks = "".join(
        f'<span title="{f.t:.2f} s: {escape(str(f.kind), quote=True)}" style="position:absolute;'
        f'left:{100 * f.t / end:.1f}%;transform:translateX(-50%);color:{COLOURS["bad"]}">✕</span>'
        for f in past.failures
    )
    said = f"{len(past.failures)} failures" if len(past.failures) != 1 else "1 failure"
    where = "" if past.at is None else f" · <b>looks back to {past.at:.2f} s</b>"
    return (
        f'<div style="{FONT}" data-past="{"" if past.at is None else f"{past.at:.2f}"}">'
        f'<div style="position:relative;height:14px;margin:0 56px 0 98px">{ticks}</div>{said}{where}</div>'
    )
