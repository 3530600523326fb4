"""Search the weights of settings.yaml over many simulated rigs at once. Usage:

    python tools/tune.py -o found.yaml [--generations 30] [--population 12] [--runs 24] [--workers 2] [--seed 1]
        [--dask ADDRESS]

CMA-ES (package `cma`) over the keys of `SEARCHED`, all scaled to [0, 1], from the packaged values. Every generation
drives the same starts on the same rigs with each candidate: the packaged rigs, and rigs drawn at random from the ranges
of `random_rigs`, new ones in each generation, so that nothing is tuned to one rig's faults. A rig that is drawn has the
model that identification would find, with errors as large as its own standard errors (`random_rigs.model_of`). The
price of a candidate is the mean of time over what a good time on that rig is (`GOOD`), a run that does not arrive
counting PENALTY s. The seeds decide everything, wherever the candidates are driven: in processes here, or on the
workers of a Dask scheduler.
"""

from __future__ import annotations

import argparse
import math
import sys
from pathlib import Path
from typing import Any

import numpy as np
import random_rigs
from random_rigs import draw, drive

from mazeplan.apps.cli.output import say
from mazeplan.apps.cli.progress import ProgressBar
from mazeplan.core.errors import MazeplanError, SettingsError
from mazeplan.core.resources import to_install
from mazeplan.run.campaign.executor import open_executor
from mazeplan.run.settings import load_settings

PENALTY = 10.0  # s
MIX = ("ideal", "toy", "rough", "drawn", "ideal", "toy", "ideal", "drawn")
GOOD = {"ideal": 2.6, "toy": 2.9, "rough": 3.6}  # s
GOOD_DRAWN = 3.1  # s
LOST = PENALTY / max(GOOD.values()) - 1e-9  # price from which on a run is lost
SEARCHED = {  # key: lowest, highest, whether its logarithm is searched
    "cost.speed": (0.01, 1.0, True), "cost.arrival": (0.02, 2.0, True), "cost.lean": (0.1, 10.0, True),
    "cost.rate": (0.005, 0.5, True), "cost.control": (0.001, 0.1, True), "cost.control_scale": (0.03, 0.15, True),
    "cost.width_theta": (0.01, 0.1, True), "cost.width_speed": (0.05, 1.0, True),
    "cost.width_lean": (0.005, 0.08, True),
    "cost.arrival_zone": (0.02, 0.3, True), "cost.past": (0.01, 1.0, True), "cost.final_theta": (0.5, 50.0, True),
    "travel.lean_deg": (1.0, 5.0, False), "travel.speed_m_s": (0.01, 0.15, True),
    "travel.fastest_m_s": (0.02, 0.15, True), "travel.blind_rad": (0.02, 0.4, True), "cost.prompt": (0.3, 1.0, False),
    "gate.kp": (20.0, 300.0, True), "gate.kd": (11.0, 40.0, True), "gate.push_deg": (3.0, 7.0, False),
    "gate.window_mm": (4.0, 20.0, False), "gate.window_speed_m_s": (0.03, 0.25, True),
    "gate.lead_s": (0.02, 0.14, False), "rollout.margin_s": (0.005, 0.06, True), "rollout.doubt_mm": (0.1, 2.0, True),
    "gate.entry_s": (0.04, 0.2, False), "settle.damping": (1.0, 15.0, True),
    "estimator.acceleration_sigma": (0.2, 1.5, True),
}  # fmt: skip


def to_unit(values: dict[str, float]) -> np.ndarray:
    """Values as a point in the unit cube."""
    point = []
    for key, (low, high, log) in SEARCHED.items():
        a, b, v = (math.log(low), math.log(high), math.log(values[key])) if log else (low, high, values[key])
        point.append(min(max((v - a) / (b - a), 0.0), 1.0))
    return np.array(point)


def from_unit(point: np.ndarray) -> dict[str, float]:
    """The other way."""
    values = {}
    for x, (key, (low, high, log)) in zip(point, SEARCHED.items(), strict=True):
        x = float(min(max(x, 0.0), 1.0))
        value = math.exp(math.log(low) + x * math.log(high / low)) if log else low + x * (high - low)
        values[key] = float(f"{value:.4g}")
    return values


def sections(values: dict[str, float]) -> dict[str, dict[str, float]]:
    """`{"gate.kp": 1}` as `{"gate": {"kp": 1}}`."""
    out: dict[str, dict[str, float]] = {}
    for key, value in values.items():
        section, name = key.split(".")
        out.setdefault(section, {})[name] = value
    return out


def packaged_values(source: Path | None = None) -> dict[str, float]:
    """What the searched keys are in a file, or now."""
    settings = load_settings(source)
    found: dict[str, float] = {}
    for key in SEARCHED:
        section, name = key.split(".")
        options = settings.estimator if section == "estimator" else getattr(settings.leaves, section)
        found[key] = float(getattr(options, name))
    return found


def price(job: tuple[dict[str, float], list[tuple[Any, int]]]) -> list[float]:
    """Times of one candidate on rigs and run seeds over good ones; PENALTY for a run that did not arrive."""
    values, runs = job
    try:
        # no deadline: what a candidate is worth must not depend on what else the machine is doing
        settings = load_settings().with_values(sections(values | {"travel.deadline_ms": 1e6}))
    except SettingsError:
        return [PENALTY] * len(runs)  # nobody can drive like that
    times = []
    for rig, seed in runs:
        result = drive(rig, settings, seed, time_limit=PENALTY)
        good = GOOD[rig] if isinstance(rig, str) else GOOD_DRAWN
        times.append((result.time_s if result.success else PENALTY) / good)
    return times


def schedule(seed: int, generation: int, runs: int) -> list[tuple[Any, int]]:
    """Rigs and run seeds of a generation, in shares of MIX."""
    first = 1_000_000 * seed + 1000 * generation
    out: list[tuple[Any, int]] = []
    for i in range(runs):
        which = MIX[i % len(MIX)]
        out.append((draw(first + i) if which == "drawn" else which, first + i))
    return out


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0].removesuffix(" Usage:"))
    parser.add_argument("-o", "--output", type=Path, required=True, help="settings file, written after each generation")
    for name, default, what in (
        ("generations", 30, "of the search"), ("population", 12, "candidates of a generation"),
        ("runs", 24, "that each candidate drives"), ("seed", 1, "of rigs, starts and candidates"),
    ):  # fmt: skip
        parser.add_argument(f"--{name}", type=int, default=default, help=f"{what}; default {default}")
    parser.add_argument("--workers", type=int, help="default: 2")
    parser.add_argument("--dask", help="a scheduler's address")
    parser.add_argument("--settings", type=Path, help="where to begin; default: the packaged ones")
    parser.add_argument("--sigma", type=float, default=0.12, help="first step, of the range of each key; default 0.12")
    o = parser.parse_args()
    for name, least in (("generations", 1), ("population", 2), ("runs", 1), ("seed", 0), ("workers", 1)):
        if getattr(o, name) is not None and getattr(o, name) < least:
            parser.error(f"--{name}: got {getattr(o, name)}, expected {least} or more")
    try:
        import cma  # pyright: ignore[reportMissingImports]  (of the extra `tune`)
    except ImportError:
        sys.exit(f"tune.py needs cma: {to_install('tune')}")
    start = packaged_values(o.settings)
    search = cma.CMAEvolutionStrategy(
        to_unit(start), o.sigma, {"bounds": [0, 1], "popsize": o.population, "seed": o.seed, "verbose": -9}
    )
    workers = o.workers or (None if o.dask else 2)
    if o.dask:  # workers elsewhere have no tools/: the functions of random_rigs go there with the tasks
        from cloudpickle import register_pickle_by_value

        register_pickle_by_value(random_rigs)
    with open_executor(workers, o.dask, say=say) as executor, ProgressBar("candidates") as bar:
        for generation in range(o.generations):
            runs = schedule(o.seed, generation, o.runs)
            points = search.ask()
            candidates = [from_unit(p) for p in points] + [from_unit(np.asarray(search.mean)), start]
            found: dict[int, list[float]] = {}
            for index, one in executor.each(price, [((c, runs),) for c in candidates]):
                found[index] = one
                bar.advance(generation * len(candidates) + len(found), o.generations * len(candidates))
            times = [found[index] for index in range(len(candidates))]
            means = [float(np.mean(t)) for t in times]
            search.tell(points, means[: len(points)])
            mean, first = times[-2], times[-1]
            line = f"# generation {generation}: best {min(means):.3f}, mean point {np.mean(mean):.3f}"
            line += f" ({sum(t > LOST for t in mean)} lost), first {np.mean(first):.3f}"
            line += f" ({sum(t > LOST for t in first)} lost), sigma {search.sigma:.3f}"
            print(line, file=sys.stderr, flush=True)
            write(o.output, from_unit(np.asarray(search.mean)), line, o)


def write(path: Path, values: dict[str, float], line: str, options: argparse.Namespace) -> None:
    """The mean of the search as a settings file."""
    text = [f"# tools/tune.py --seed {options.seed} --population {options.population} --runs {options.runs}", line]
    for section, found in sections(values).items():
        text.append(f"{section}:")
        text += [f"  {name}: {value:g}" for name, value in found.items()]
    path.write_text("\n".join(text) + "\n")


if __name__ == "__main__":
    try:
        main()
    except MazeplanError as problem:
        sys.exit(f"tune.py: {problem}")
