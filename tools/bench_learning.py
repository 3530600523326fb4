"""A model that learns between runs, on a rig whose friction changes half way, against the model that it began with.
Used by tools/bench.py; draws docs/learning.png, with --quick build/learning.png.

Usage: python tools/bench_learning.py [--quick]

The rig is `worn`: the toy, whose floor has three times the rolling friction from run 11 on, in MuJoCo, which shares no
equation with the model. Model errors are on records of the excited rig, before and after the change, from which nothing
is learned: what a model expects of one sample, and where it expects the ball after 20 samples of 1/30 s. What is chosen
(steps of the walk, pace of the clock) was chosen on other seeds.
"""

from __future__ import annotations

import math
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from mazeplan.core.logs.table import read_table
from mazeplan.core.palette import COLOURS
from mazeplan.core.records import Array, IntArray, NavigationResult
from mazeplan.learning.modelfile import RigModel, load_model
from mazeplan.learning.online_gp import RULES
from mazeplan.learning.online_rig import RESTING, OnlineOptions, accelerations
from mazeplan.learning.rig_gp import SMOOTHING
from mazeplan.learning.rollout import choose_windows, roll_out
from mazeplan.learning.samples import RingSamples, SampleOptions, ring_samples
from mazeplan.maze.mapfile import load_map
from mazeplan.rigs.registry import make_rig
from mazeplan.run.campaign.evaluate import Campaign, run_one
from mazeplan.run.campaign.online_learning import Learner, Ticks
from mazeplan.run.collect import Collection, run_collection

RIG, MODEL, RUNS, CHANGE = "worn", "toy", 20, 11
SEEDS = tuple(20_000 + 1000 * i for i in range(5))
OTHERS = (90_000, 91_000)  # for the rules of the budget
TIGHT = 100  # rows a ring, so that the rules have something to decide
STEPS, WINDOWS, EVERY = 20, 15, 24  # of a roll-out; windows of a ring; one sample in so many
ROOT = Path(__file__).resolve().parent.parent


@dataclass(frozen=True)
class Held:
    """A record of the excited rig: samples and windows by ring."""

    samples: dict[int, RingSamples]
    windows: dict[int, IntArray]

    @classmethod
    def of(cls, run: int, seconds: float, seed: int) -> Held:
        """From a rig that is as it is in some run."""
        maze, rig = load_map("cme"), make_rig(RIG, load_map("cme"))
        rig.begin_run(run)  # type: ignore[attr-defined]  # a simulated one
        with tempfile.TemporaryDirectory() as folder:
            log = Path(folder) / "held.mcap"
            run_collection(rig, maze, Collection(seconds, (1, 2, 3, 4), seed, None, 1.5), log, rig_name=RIG)
            table = read_table(log)
        options = SampleOptions(delay=load_model(MODEL).camera_delay, recompute=True)
        samples = ring_samples(table, maze, SMOOTHING, options)
        windows = {}
        for ring, some in samples.items():
            first = choose_windows(some, np.ones(len(some), dtype=bool)).start
            windows[ring] = first[:: max(1, len(first) // WINDOWS)]
        return cls(samples, windows)

    def errors(self, model: RigModel) -> tuple[float, float]:
        """Median error of the acceleration along the track, m/s^2, and mean error of the place after STEPS samples,
        mm; mean over the rings."""
        one, far = [], []
        for ring, s in self.samples.items():
            rows = np.flatnonzero(s.good & (np.abs(s.k.theta_dot) > RESTING))[::EVERY]
            off = s.theta_ddot[rows] - accelerations(model, ring, s.at(rows))
            one.append(s.k.radius * float(np.median(np.abs(off))))
            at = self.windows[ring]
            rolled = roll_out(lambda k, r=ring: accelerations(model, r, k), s, at, s.k.theta[at], s.k.theta_dot[at])
            far.append(1e3 * s.k.radius * rolled.after(STEPS))
        return float(np.mean(one)), float(np.mean(far))


@dataclass(frozen=True)
class Campaigned:
    """20 runs. errors (N, 2): before each run, by `Held.errors`; ticks: what was learned from."""

    outcomes: list[NavigationResult]
    errors: Array
    ticks: list[Ticks]

    @property
    def times(self) -> Array:
        """s; NaN where it did not arrive."""
        return np.array([o.time_s if o.success else math.nan for o in self.outcomes])


def campaign(seed: int, runs: int, learns: bool, held: dict[bool, Held]) -> Campaigned:
    """One after the other, with a model that learns or with the one that it begins with."""
    what, maze = Campaign(runs, RIG, seed=seed), load_map("cme")
    learner = Learner.begin(load_model(MODEL), maze)
    fixed = {worn: record.errors(learner.online.start) for worn, record in held.items()}
    outcomes, errors, taken = [], [], []
    for index in range(runs):
        worn, model, ticks = index + 1 >= CHANGE, learner.model, Ticks()
        errors.append(held[worn].errors(model) if learns and index else fixed[worn])
        outcomes.append(run_one(what, index, model, ticks))
        taken.append(ticks)
        if learns:
            learner.learn(outcomes[-1], ticks)
    print(f"seed {seed}, {'learns' if learns else 'fixed'}: {[o.time_s for o in outcomes]}", file=sys.stderr)
    return Campaigned(outcomes, np.array(errors), taken)


def rule_row(rule: str, most: int, done: list[Campaigned], held: dict[bool, Held]) -> str:
    """What a rule of the budget makes of the same records: errors before and after the change, mean over the runs."""
    found: dict[bool, list[tuple[float, float]]] = {False: [], True: []}
    for one in done:
        learner = Learner.begin(load_model(MODEL), load_map("cme"), options=OnlineOptions(most=most, keep=rule))
        for number, (outcome, ticks) in enumerate(zip(one.outcomes, one.ticks, strict=True), 1):
            learner.learn(outcome, ticks)
            if number % 3 == 0:
                worn = number >= CHANGE
                found[worn].append(held[worn].errors(learner.online.learned))
    cells = [f"{x:.3f} | {y:.1f}" for x, y in (np.mean(found[worn], axis=0) for worn in (False, True))]
    return f"| {rule} | {' | '.join(cells)} |"


def cell(done: list[Campaigned], part: slice) -> str:
    """Arrived, mean time, errors, of some of the runs."""
    times = np.concatenate([one.times[part] for one in done])
    errors = np.concatenate([one.errors[part] for one in done])
    arrived = np.isfinite(times)
    mean = f"{times[arrived].mean():.2f} s" if arrived.any() else "-"
    worst = f"{times[arrived].max():.2f} s" if arrived.any() else "-"
    one, far = errors.mean(axis=0)
    failures = sum(len(o.failures) for c in done for o in c.outcomes[part])
    return f"{arrived.sum()}/{len(times)} | {mean} | {worst} | {failures} | {one:.3f} | {far:.1f}"


def draw(learned: list[Campaigned], fixed: list[Campaigned], path: Path) -> None:
    """Time, error of a sample and after STEPS samples, against the number of the run."""
    from matplotlib.figure import Figure

    figure = Figure((9.0, 7.6), layout="constrained")
    panels: Any = figure.subplots(3, 1, sharex=True)
    number = np.arange(1, len(learned[0].outcomes) + 1)
    for done, name, style, label in ((fixed, "planned", "--", "fixed model"), (learned, "real", "-", "with --learn")):
        colour, aside = COLOURS[name], -0.12 if name == "planned" else 0.12
        marker = "s" if name == "planned" else "o"
        times = np.array([[o.time_s for o in one.outcomes] for one in done])
        panels[0].plot(number, times.mean(axis=0), style, color=colour, label=f"{label}, mean of {len(done)}")
        for one in done:
            x, arrived = number + aside, np.isfinite(one.times)
            panels[0].plot(x, one.times, marker, color=colour, ms=3.0, alpha=0.6)
            panels[0].plot(x[~arrived], [o.time_s for o in np.array(one.outcomes)[~arrived]], "X", color=colour, ms=7)
        for axes, column in ((panels[1], 0), (panels[2], 1)):
            axes.plot(
                number, np.mean([one.errors[:, column] for one in done], axis=0), style, color=colour, label=label
            )
            for one in done:
                axes.plot(number + aside, one.errors[:, column], marker, color=colour, ms=3.0, alpha=0.6)
    panels[0].set_ylabel("time, s  (X: did not arrive)")
    panels[1].set_ylabel("error of a sample,\nmedian, m/s²")
    panels[2].set_ylabel(f"error after {STEPS} samples,\nmean, mm")
    panels[2].set_xlabel("run")
    panels[2].set_xticks(number)
    for axes in panels:
        axes.set_ylim(bottom=0.0)
        axes.axvline(CHANGE - 0.5, color=COLOURS["neutral"], lw=1.0)
        axes.grid(axis="y", alpha=0.4)
        axes.legend(loc="upper left", fontsize=8)
    panels[0].set_title("Rolling friction three times as large from run 11 on (simulated)", fontsize=10)
    path.parent.mkdir(exist_ok=True)
    figure.savefig(path, dpi=110)


def learning_section(quick: bool) -> list[str]:
    """Everything, as lines of Markdown."""
    seeds, runs = (SEEDS[:1], 12) if quick else (SEEDS, RUNS)
    held = {worn: Held.of(CHANGE if worn else 1, 60.0 if quick else 200.0, 77 + worn) for worn in (False, True)}
    pairs = [(campaign(seed, runs, True, held), campaign(seed, runs, False, held)) for seed in seeds]
    learned, fixed = ([pair[i] for pair in pairs] for i in (0, 1))
    picture = ROOT / ("build" if quick else "docs") / "learning.png"
    draw(learned, fixed, picture)
    rows = ["| runs | model | arrived | mean s | worst | failures | sample, m/s^2 | after 20, mm |", "|---" * 8 + "|"]
    parts = [("1 to 10", slice(0, CHANGE - 1)), ("11", slice(CHANGE - 1, CHANGE)), ("12 to 20", slice(CHANGE, runs))]
    for label, part in parts:
        rows += [f"| {label} | {name} | {cell(done, part)} |" for name, done in (("fixed", fixed), ("learns", learned))]
    streams = [campaign(seed, runs, True, held) for seed in OTHERS[: 1 if quick else None]]
    rules = [rule_row(rule, TIGHT, streams, held) for rule in RULES]
    return [
        "## Learning while running (simulated)",
        "",
        f"`mazeplan evaluate --learn --rig {RIG} --runs {runs} --seed S`, S in {', '.join(map(str, seeds))}, against "
        "the same without",
        "`--learn`. Rolling friction is three times as large from run 11 on; both begin with the packaged model of "
        "`toy`. Errors of the",
        "model are on records of the excited rig from which nothing is learned, as it is in that run: of the "
        "acceleration along the track",
        "(median), and of the place of the ball after 20 samples (mean over windows).",
        "",
        *rows,
        "",
        f"![Time and errors of the model, run by run](docs/{picture.name})",
        "",
        f"Which rows stay, where only {TIGHT} a ring may (by default it is as many as the model was learned from): "
        f"the same {len(streams) * runs} runs",
        f"learned by each rule, seeds {', '.join(map(str, OTHERS[: len(streams)]))}; means over the runs.",
        "",
        "| rule | before: sample, m/s^2 | after 20, mm | from run 11 on: sample | after 20 |",
        "|---" * 5 + "|",
        *rules,
    ]


if __name__ == "__main__":
    print("\n".join(learning_section("--quick" in sys.argv)))
