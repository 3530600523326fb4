"""What an open page costs a run: ticks at 30 Hz with and without it, and how often the page moves the ball.

A client that takes all messages over the websocket stands for the browser, as one that draws in software takes both
cores of a small machine; another client never reads. Used by tools/bench.py."""

from __future__ import annotations

import sys
from importlib.util import find_spec
from multiprocessing import freeze_support
from pathlib import Path
from time import monotonic, perf_counter
from typing import Any

import numpy as np

from mazeplan.apps.view.door import Door, listen
from mazeplan.apps.view.link import PageLink
from mazeplan.apps.view.livetab import Offer
from mazeplan.maze.mapfile import load_map
from mazeplan.rigs.paced import PacedRig
from mazeplan.run.navigate import navigate

ROOT = Path(__file__).resolve().parent.parent
BALL = "/maze/plate/ball"
WAYS = ("without a page", "with a page that is read", "with one more that hangs")
RATIO, RATE, START_S = 1.2, 25.0, 1.5  # asked
MOVED_M = 1e-3  # the ball moves when it is so far from where it was first seen


class Timed(PacedRig):
    """Keeps, in ms, what passes from a sample to where the next one is asked for."""

    ticks: list[float]
    _since: float | None = None

    def observe(self) -> Any:
        if self._since is not None:
            self.ticks.append(1e3 * (perf_counter() - self._since))
        sample = super().observe()
        self._since = perf_counter()
        return sample


def one_run(seed: int, ticks: list[float], **more: Any) -> None:
    """On the toy, by the clock on the wall; its ticks are added."""

    def around(rig: Any) -> Any:
        timed = Timed(rig)
        timed.ticks = ticks
        return timed

    navigate(1, 5, rig="toy", seed=seed, around=around, **more)


class Moving:
    """A feed that hands messages on, and tells how long after `began` the ball moved, s, by the clock on the wall."""

    def __init__(self, take: Any) -> None:
        self._take, self.began, self.after = take, monotonic(), float("nan")
        self._first: complex | None = None

    def __call__(self, topic: str, t: float, document: dict[str, Any]) -> None:
        self._take(topic, t, document)
        if topic != "/tick" or document.get("x") is None or not np.isnan(self.after):
            return
        place = complex(document["x"], document["y"])
        self._first = place if self._first is None else self._first
        if abs(place - self._first) > MOVED_M:
            self.after = monotonic() - self.began


def measured(runs: int) -> tuple[dict[str, np.ndarray], list[float], list[float]]:
    """Ticks of each way in ms, run about so that what else the machine does hits all alike; and of each run with a page
    how often it moved the ball, Hz, and how long after its beginning the ball moved, s."""
    from page_client import HungClient, Viewer

    maze, rates, starts = load_map("cme"), [], []
    listening = listen("127.0.0.1", 0)
    port = listening.getsockname()[1]
    ticks: dict[str, list[float]] = {way: [] for way in WAYS}
    one_run(0, [])  # compiles
    with PageLink(Offer(maze, "toy"), Door.at("127.0.0.1", port), listening, lambda order: None) as page:
        listening.close()
        viewer, hung = Viewer(port), None
        if not page.opened.wait(60.0):
            raise SystemExit("the page did not open")
        for seed in range(runs):
            one_run(seed, ticks[WAYS[0]])
            for way in WAYS[1:]:
                if way == WAYS[2]:
                    hung = HungClient(port)
                viewer.moved.clear()
                began = monotonic()
                feed = Moving(page.take)
                one_run(seed, ticks[way], feed=feed)
                starts.append(feed.after)
                moved = [t for t in viewer.moved.get(BALL, []) if t >= began]
                if len(moved) > 1:
                    rates.append((len(moved) - 1) / (moved[-1] - moved[0]))
                if hung is not None:
                    hung.close()
                    hung = None
        viewer.close()
    return {way: np.array(values) for way, values in ticks.items()}, rates, starts


def view_section(quick: bool) -> list[str]:
    """A table of ticks. Needs the extra `view`."""
    if find_spec("viser") is None:
        return ["## The page in the browser", "", "Not measured: pip install 'mazeplan[view]'."]
    runs = 4 if quick else 30
    ticks, rates, starts = measured(runs)
    rows = [
        "## The page in the browser",
        "",
        f"Rig `toy` at 30 Hz by the clock on the wall, {runs} runs each in turn; a tick is all that passes from a "
        "sample to where the next one is waited for. The page is a process of its own.",
        "",
        "| run | ticks | p50 ms | p99 ms | longest ms | p99 to that without |",
        "|---|---|---|---|---|---|",
    ]
    base = np.percentile(ticks[WAYS[0]], 99)
    for way in WAYS:
        p50, p99 = np.percentile(ticks[way], [50, 99])
        rows.append(
            f"| {way} | {len(ticks[way])} | {p50:.2f} | {p99:.2f} | {ticks[way].max():.1f} | {p99 / base:.2f} |"
        )
        print(rows[-1], file=sys.stderr)
    rows += [
        "",
        f"Asked: at most {RATIO:g} times that without. The ball moves on the page {np.median(rates):.1f} times a "
        f"second (median of the runs; least {min(rates):.1f}). Asked: {RATE:g}. From the beginning of a run, with all "
        f"compiled, until the ball has moved by {1e3 * MOVED_M:g} mm pass {np.nanmedian(starts):.2f} s (longest "
        f"{np.nanmax(starts):.2f} s). Asked: {START_S:g} s.",
    ]
    return rows


if __name__ == "__main__":
    freeze_support()
    print("\n".join(view_section("--quick" in sys.argv)))
