"""The timeline of a run, as lines for people: leaves that take over, rings, failures, recoveries."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from mazeplan.apps.testing.watch import Tick
from mazeplan.core.events import TimedEvent
from mazeplan.core.maths.angles import place_deg

ROWS = 14  # in an excerpt
HEAD = "     t, s  ring   deg  what"


@dataclass(frozen=True)
class Row:
    """One line of the timeline.

    t: rig time, s
    ring, theta: place of the ball, theta in rad; None if no tick was recorded
    text: what happened"""

    t: float
    ring: int | None
    theta: float | None
    text: str

    def __str__(self) -> str:
        ring = "-" if self.ring is None else str(self.ring)
        angle = "-" if self.theta is None else f"{place_deg(self.theta, 0):.0f}"
        return f"  {self.t:7.3f}  {ring:>4}  {angle:>4}  {self.text}"


def rows(ticks: Sequence[Tick], events: Iterable[TimedEvent], ended: str) -> list[Row]:
    """A row for each change, in order of time. The last row gives the reason `ended`."""
    out: list[Row] = []
    waiting = sorted(events, key=lambda event: event.t)
    last: Tick | None = None
    for tick in ticks:
        changed = []
        if last is None or tick.ring != last.ring:
            changed.append(f"ball in ring {tick.ring}")
        if last is not None and tick.seen != last.seen:
            changed.append("ball seen again" if tick.seen else "ball not seen")
        while waiting and waiting[0].t <= tick.t + 1e-9:
            changed.append(described(waiting.pop(0)))
        if tick.leaf and (last is None or tick.leaf != last.leaf):
            changed.append(f"{tick.leaf} commands")
        out += [Row(tick.t, tick.ring, tick.theta, text) for text in changed]
        last = tick
    ring, theta = (None, None) if last is None else (last.ring, last.theta)
    out += [Row(event.t, ring, theta, described(event)) for event in waiting]
    return [*out, Row(0.0 if last is None else last.t, ring, theta, f"ended: {ended}")]


def described(event: TimedEvent) -> str:
    """An event in a few words."""
    words = []
    for key, value in event.detail.items():
        text = (
            f"{value:.3g}" if isinstance(value, float) else ", ".join(map(str, value)) if key == "openings" else value
        )
        if text not in ("", None):
            words.append(str(text) if key in (event.kind, "kind", "where", "detail", "openings") else f"{key} {text}")
    return " ".join([event.kind, *words])


def excerpt(lines: Sequence[Row], around: float | None = None) -> str:
    """The rows around a moment, s, or the last rows."""
    middle = len(lines) if around is None else sum(row.t < around - 1e-9 for row in lines)
    first = max(0, min(middle - ROWS // 2, len(lines) - ROWS))
    return "\n".join([HEAD, *map(str, lines[first : first + ROWS])])
