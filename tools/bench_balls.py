"""Section `balls`: two balls to the centre by `navigate --balls 2`."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from bench_kit import Section, Table, arrivals

import mazeplan
from mazeplan.core.records import FailureKind, NavigationResult, Observation
from mazeplan.maze.mapfile import load_map
from mazeplan.rigs.interface import Rig, RigWrapper
from mazeplan.rigs.registry import make_rig

MAZE = replace(load_map("cme"), balls=2)
LIMIT_S = 20.0  # of a run
OUT_S = 0.5  # s for which a ball that was in the centre is truly outside before it counts as having left
NOTICED = (FailureKind.LEFT_THE_CENTRE, FailureKind.FELL_BACK)


class Witness(RigWrapper):
    """Notes after each sample which balls are truly in the centre: `seen`, (t, (first, second))."""

    def __init__(self, rig: Rig) -> None:
        super().__init__(rig)
        self.seen: list[tuple[float, tuple[bool, ...]]] = []
        wall = MAZE.walls[-1]
        self._middle = 0.5 * (wall.inner_radius + wall.outer_radius)

    def observe(self) -> Observation:
        """As the rig inside."""
        sample = super().observe()
        places = [self.inside.truth()[:2], *(scene[:2] for scene in self.inside.others())]  # pyright: ignore
        self.seen.append((sample.t, tuple(bool(np.hypot(*place) < self._middle) for place in places)))
        return sample

    def left(self) -> list[float]:
        """Times at which a ball that had been in the centre for OUT_S left it for OUT_S, s."""
        need, times = round(OUT_S * self.rate_hz), []
        for ball in range(MAZE.balls):
            inside = [there[ball] for _, there in self.seen]
            times += [
                self.seen[k][0]
                for k in range(need, len(inside) - need)
                if all(inside[k - need : k]) and not any(inside[k : k + need])
            ]
        return times


def unnoticed(result: NavigationResult, times: list[float]) -> int:
    """How many leavings at these times have no failure within 1 s."""
    return sum(not any(f.kind in NOTICED and t - 0.2 <= f.t <= t + 1.0 for f in result.failures) for t in times)


def balls_section(quick: bool) -> Section:
    """A row for each rig."""
    count = 4 if quick else 100
    table = Table(("rig", "arrived", "mean, s", "longest, s", "failures", "left", "unnoticed"))
    for rig in ("toy", "ideal"):
        results, left, missed = [], 0, 0
        for seed in range(count):
            witness = Witness(make_rig(rig, MAZE))
            result = mazeplan.navigate(rig=witness, map=MAZE, model=rig, seed=seed, time_limit=LIMIT_S)
            results.append(result)
            left += len(witness.left())
            missed += unnoticed(result, witness.left())
        arrived, times, failures = arrivals(results)
        table.add(f"`{rig}`", arrived, f"{np.mean(times):.2f}", f"{np.max(times):.2f}", failures, left, missed)
    notes = (
        f"`mazeplan navigate --balls 2`, seeds 0 to {count - 1}, from ring 1 to the centre within {LIMIT_S:g} s.",
        f"Left: how often a ball that had been in the centre for {OUT_S:g} s was truly outside for {OUT_S:g} s.",
        "Unnoticed: without a failure within 1 s.",
    )
    return Section("Two balls (simulated)", notes, (table,))
