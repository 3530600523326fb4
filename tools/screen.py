"""Which settings are not worth driving: their plans played thousands of times on a learned model. Used by tune.py.

    python tools/screen.py --model toy --rig toy [--candidates 16] [--runs 16] [--seed 1]

For each candidate the planner plans SCENES ways along each ring with the candidate's costs; each plan is then played
DRAWS times with its own gains (`RingBatch`), the start as far off as the estimate may be and the ball pushed by what
the model does not know. The price of a candidate is the mean time until the ball is in front of the opening, slow
enough for it. What happens in openings no plan tells: keys of the gate and the estimator are not judged.

Run by itself, it says whether the order of candidates by this price is that of driving them: rank correlation on seeds
of its own, and what would have been kept of the best.
"""

from __future__ import annotations

import argparse
import math
import time
from typing import Any

import numpy as np

from mazeplan.core.errors import SettingsError
from mazeplan.core.records import Array
from mazeplan.learning.batch import Plans, RingBatch
from mazeplan.learning.learned_part import noise_of
from mazeplan.learning.modelfile import RigModel
from mazeplan.maze.geometry import Maze
from mazeplan.maze.mapfile import load_map
from mazeplan.run.assembly import planners_of
from mazeplan.run.settings import Settings, load_settings

SCENES, DRAWS = 12, 32  # ways along each ring, and roll-outs of each plan
TURN, SPEED = math.pi / 4, 0.1  # rad, m/s: openings are up to so far away, the ball up to so fast
OFF_M, OFF_M_S = 0.7e-3, 0.02  # of an estimate, one standard deviation
UNKNOWN = 0.06  # m/s^2, standard deviation of what acts in a step besides, where no process tells
PULL = 0.45  # m/s^2 along the ring at 5 degrees: beyond the plan's end the way that is left counts as one from rest
WORST = 4.0  # s; of a plan that failed, or settings that nobody can drive with
JUDGED = ("cost.", "travel.", "gate.window")  # keys that a plan depends on


def scenes(maze: Maze, ring: int, seed: int) -> tuple[Array, Array]:
    """Planner states (SCENES, 6), and where the opening is, theta (SCENES,)."""
    rng, r = np.random.default_rng([seed, ring]), maze.track_radius(ring)
    theta = rng.uniform(-math.pi, math.pi, SCENES)
    states = np.zeros((SCENES, 6))
    states[:, 0], states[:, 1] = theta, rng.uniform(-SPEED, SPEED, SCENES) / r
    states[:, 2], states[:, 4] = rng.uniform(-0.06, 0.06, (2, SCENES))
    return states, theta + rng.uniform(-TURN, TURN, SCENES)


def planned(settings: Settings, maze: Maze, model: RigModel, ring: int, seed: int) -> Plans:
    """The plans of a candidate for the scenes of a ring; a plan that failed stays where it is."""
    planner = planners_of(maze, model, settings.leaves.cost)[ring]
    states, goals = scenes(maze, ring, seed)
    travel, r = settings.leaves.travel, maze.track_radius(ring)
    speed = max(travel.speed_m_s, min(travel.blind_rad * r / max(model.late_s, 0.05), travel.fastest_m_s))
    found = [
        planner.plan(
            state, goal, lean=-math.radians(travel.lean_deg), deadline_ms=1e6,
            goal_theta_dot=math.copysign(speed / r, goal - state[0]),
        )
        for state, goal in zip(states, goals, strict=True)
    ]  # fmt: skip
    return Plans(*(np.array([getattr(p, name) for p in found]) for name in ("controls", "gains", "states")))


def arrivals(states: Array, goals: Array, radius: float, settings: Settings, dt: float) -> Array:
    """Time (B,), s, at which each roll-out (B, T+1, 6) is in front of its goal (B,), slow enough."""
    gate = settings.leaves.gate
    left = (states[:, :, 0] - goals[:, None]) * radius
    there = (np.abs(left) <= 1e-3 * gate.window_mm) & (np.abs(states[:, :, 1]) * radius <= gate.window_speed_m_s)
    late = (states.shape[1] - 1) * dt + 2.0 * np.sqrt(np.abs(left[:, -1]) / PULL)
    return np.minimum(np.where(there.any(axis=1), dt * np.argmax(there, axis=1), late), WORST)


def screen(candidates: list[dict[str, dict[str, float]]], model: RigModel, seed: int, device: str = "auto") -> Array:
    """Prices (C,) of candidates, sections of settings each; all of them are played on the same scenes and doubts."""
    maze, prices = load_map("cme"), np.zeros(len(candidates))
    rings = [ring.number for ring in maze.rings if not ring.is_disc]
    for ring in rings:
        radius = maze.track_radius(ring)
        batch = RingBatch.of_model(model, ring, radius, limit=maze.tilt_limit, device=device)
        states, goals = scenes(maze, ring, seed)
        rng = np.random.default_rng([seed, ring, 1])
        starts = np.repeat(states, DRAWS, axis=0)
        starts[:, 0] += OFF_M / radius * rng.standard_normal(len(starts))
        starts[:, 1] += OFF_M_S / radius * rng.standard_normal(len(starts))
        noise = noise_of(batch.process) if batch.process is not None else UNKNOWN / radius
        known: list[tuple[int, Settings, Plans]] = []
        for i, candidate in enumerate(candidates):
            try:
                settings = load_settings().with_values(candidate)
                known.append((i, settings, planned(settings, maze, model, ring, seed)))
            except SettingsError:
                prices[i] += WORST / len(rings)
        if not known:
            continue
        names = ("commands", "gains", "states")
        together = Plans(*(np.concatenate([getattr(p, name) for _, _, p in known]) for name in names))
        pushes = np.tile(noise * rng.standard_normal((len(starts), together.commands.shape[1])), (len(known), 1))
        which = np.repeat(np.arange(len(together.commands)), DRAWS)
        out = batch.roll_out(np.tile(starts, (len(known), 1)), together, which=which, pushes=pushes)
        wide = np.repeat(goals, DRAWS)
        for (i, settings, _), part in zip(known, np.split(out, len(known)), strict=True):
            prices[i] += float(np.mean(arrivals(part, wide, radius, settings, batch.parameters.dt))) / len(rings)
    return prices


def judged(values: dict[str, float]) -> dict[str, dict[str, float]]:
    """Of `{"cost.speed": 1, ...}` what a plan depends on, in sections."""
    out: dict[str, dict[str, float]] = {}
    for key, value in values.items():
        if key.startswith(JUDGED):
            section, name = key.split(".")
            out.setdefault(section, {})[name] = value
    return out


def ranks(values: Array) -> Array:
    """Place of each value (N,) in their order."""
    return np.argsort(np.argsort(values)).astype(float)


def correlation(a: Array, b: Array) -> float:
    """Rank correlation (Spearman) of two columns (N,)."""
    return float(np.corrcoef(ranks(a), ranks(b))[0, 1])


def trial(rig: str, model: RigModel, candidates: int, runs: int, seed: int, spread: float) -> dict[str, Any]:
    """Candidates around the packaged settings, screened and driven: prices of both, rank correlations, seconds of
    both."""
    from tune import SEARCHED, from_unit, packaged_values, price, to_unit

    rng, middle = np.random.default_rng([seed, 5]), to_unit(packaged_values())
    points = [middle + spread * rng.standard_normal(len(middle)) for _ in range(candidates)]
    moved = np.array([any(key.startswith(part) for part in JUDGED) for key in SEARCHED])
    points = [np.where(moved, point, middle) for point in points]  # what screening cannot see stays as it is
    values = [from_unit(point) for point in points]
    began = time.process_time()
    screened = screen([judged(v) for v in values], model, seed)
    middle_s, jobs = time.process_time(), [(rig, 10_000_000 * seed + i) for i in range(runs)]
    driven = np.array([float(np.mean(price((v, jobs)))) for v in values], dtype=np.float64)
    return {
        "screened": screened, "driven": driven, "correlation": correlation(screened, driven),
        "screen_s": middle_s - began, "drive_s": time.process_time() - middle_s,
    }  # fmt: skip


def main() -> None:
    from mazeplan.run.resolve import resolve_model

    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    for name, default in (("candidates", 16), ("runs", 16), ("seed", 1)):
        parser.add_argument(f"--{name}", type=int, default=default)
    parser.add_argument("--rig", default="toy")
    parser.add_argument("--model", default="toy")
    parser.add_argument("--spread", type=float, default=0.12, help="of a candidate, of the range of each key")
    o = parser.parse_args()
    model = resolve_model(o.model, o.rig, load_map("cme"))
    got = trial(o.rig, model, o.candidates, o.runs, o.seed, o.spread)
    for screened, driven in sorted(zip(got["screened"], got["driven"], strict=True), key=lambda pair: pair[1]):
        print(f"driven {driven:.3f}  screened {screened:.3f}")
    best, half = int(np.argmin(got["driven"])), np.argsort(got["screened"])[: o.candidates // 2]
    print(
        f"rank correlation {got['correlation']:.2f}; the best one is {'' if best in half else 'not '}in the better half"
    )
    print(f"screened in {got['screen_s']:.1f} s, driven in {got['drive_s']:.1f} s")


if __name__ == "__main__":
    main()
