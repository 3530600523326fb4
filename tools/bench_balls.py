"""Two balls to the centre by `navigate --balls 2`: the section `balls` of BENCHMARKS.md.

Usage: python tools/bench_balls.py [--quick].
"""

from __future__ import annotations

import sys
from collections import Counter
from dataclasses import dataclass, replace

import numpy as np

import mazeplan
from mazeplan.core.records import FailureKind, NavigationResult, Observation
from mazeplan.maze.mapfile import load_map
from mazeplan.rigs.interface import Rig, RigWrapper
from mazeplan.rigs.registry import make_rig
from mazeplan.rigs.sim.simulated import SimulatedRig

MAZE = replace(load_map("cme"), balls=2)
LIMIT_S = 20.0  # of a run
EPISODE = 500  # pictures
OUT_S = 0.5  # s for which a ball that was in the centre is truly outside before it counts as having left


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


@dataclass
class Runs:
    """Results of many runs; left: times at which a ball truly left the centre, of each run."""

    results: list[NavigationResult]
    left: list[list[float]]

    @property
    def unnoticed(self) -> int:
        """Leavings without a failure left_the_centre, or fell_back of a ball that settles, within 1 s."""
        kinds = (FailureKind.LEFT_THE_CENTRE, FailureKind.FELL_BACK)
        return sum(
            not any(f.kind in kinds and t - 0.2 <= f.t <= t + 1.0 for f in result.failures)
            for result, times in zip(self.results, self.left, strict=True)
            for t in times
        )

    def line(self, rig: str) -> str:
        """A row of the table."""
        times = [r.time_s for r in self.results if r.success]
        kinds = Counter(str(f.kind) for r in self.results for f in r.failures)
        failures = ", ".join(f"{kind} {count}" for kind, count in sorted(kinds.items())) or "none"
        figures = [f"{len(times)} of {len(self.results)}", f"{np.mean(times):.2f}", f"{np.max(times):.2f}"]
        left = sum(map(len, self.left))
        return f"| `{rig}` | {' | '.join(figures)} | {failures} | {left} | {self.unnoticed} |"


def navigations(rig: str, count: int) -> Runs:
    """Runs with seeds 0 to count - 1; start angles drawn by the seed."""
    found = Runs([], [])
    for seed in range(count):
        witness = Witness(make_rig(rig, MAZE))
        found.results.append(mazeplan.navigate(rig=witness, map=MAZE, model=rig, seed=seed, time_limit=LIMIT_S))
        found.left.append(witness.left())
    return found


@dataclass
class Detections:
    """Frames with two balls in rendered pictures: distances from the truth, mm; balls not found; names swapped."""

    frames: int
    off_mm: list[float]
    missed: int = 0
    swapped: int = 0

    def lines(self) -> list[str]:
        """What was found."""
        rms = float(np.sqrt(np.mean(np.square(self.off_mm))))
        worst, far = max(self.off_mm), float(np.mean(np.array(self.off_mm) > 1.0))
        return [
            f"`sense: camera`, random commands, {self.frames} pictures with both balls, from rings 1 to 4 in turn: "
            f"{rms:.3f} mm rms from the true",
            f"place, {100.0 * far:.2f} % of all farther than 1 mm, the farthest {worst:.1f} mm; "
            f"{self.missed} of {2 * self.frames} balls not found; {self.swapped} swapped.",
        ]


def detections(frames: int) -> Detections:
    """Pictures of the ideal rig under random commands, EPISODE at a time."""
    found = Detections(0, [])
    rig = SimulatedRig(MAZE, {"sense": "camera"})
    for episode in range(max(1, frames // EPISODE)):
        rng = np.random.default_rng(episode)
        rig.reset(ring=1 + episode % 4, theta=float(rng.uniform(-np.pi, np.pi)), rng=rng)
        wanted = np.repeat(rng.uniform(-1.0, 1.0, (EPISODE // 10, 2)) * MAZE.tilt_limit, 10, axis=0)
        for command in wanted.tolist():
            sample = rig.observe()
            true = [rig.truth()[:2], rig.others()[0][:2]]
            for ball, seen in enumerate((sample, *sample.others)):
                if seen.x is None:
                    found.missed += 1
                    continue
                off = [float(np.hypot(seen.x - place[0], (seen.y or 0.0) - place[1])) for place in true]
                found.off_mm.append(1e3 * off[ball])
                found.swapped += off[1 - ball] < off[ball]
            found.frames += 1
            rig.command(*command)
    return found


def balls_section(quick: bool) -> list[str]:
    """Everything, as lines of Markdown."""
    count = 4 if quick else 100
    return [
        "## Two balls (simulated)",
        "",
        f"`mazeplan navigate --balls 2`, seeds 0 to {count - 1}, both balls from ring 1 to the centre within "
        f"{LIMIT_S:g} s. Left: how often a ball",
        f"that had been in the centre for {OUT_S:g} s was truly outside for {OUT_S:g} s. Unnoticed: without a failure "
        "within 1 s.",
        "",
        "| rig | arrived | mean, s | longest, s | failures | left | unnoticed |",
        "|---|---|---|---|---|---|---|",
        *(navigations(rig, count).line(rig) for rig in ("toy", "ideal")),
        "",
        *detections(500 if quick else 10_000).lines(),
    ]


if __name__ == "__main__":
    print("\n".join(balls_section("--quick" in sys.argv)))
