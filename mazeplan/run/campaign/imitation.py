"""Trains a policy to imitate the planner, on the states that the policy itself visits (DAgger; Ross, Gordon and
Bagnell, 2011).

In the first round the planner drives. In each further round the policy of the round before drives: it replaces the
commands of the leaves LEARNED. The tree of `navigate` still decides, and the commands that it would have given are the
lesson. After each round a network is fitted to the lessons of all rounds.

Every second run goes from ring 1 to the centre, the others between two rings drawn by the seed. The seed also draws
start angles and the rig's noise. Seeds of training runs begin at SEEDS, those of evaluations at 0.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from mazeplan.behavior.context import RunContext
from mazeplan.btree.tree import BehaviorTree
from mazeplan.control.policy import COS, INPUTS, KNOWN, SIN, Policy, Single, policy_inputs
from mazeplan.control.tilt import Plate
from mazeplan.core.maths.angles import difference, nearest
from mazeplan.core.progress import Advance, Words, no_advance, no_words, piece
from mazeplan.core.records import Array, Command
from mazeplan.learning.policy_training import fit_network
from mazeplan.rigs.registry import rig_label
from mazeplan.run.assembly import plate_of
from mazeplan.run.campaign.executor import open_executor
from mazeplan.run.campaign.one_run import Campaign, run_one
from mazeplan.run.request import Company
from mazeplan.run.specification import Job

LEARNED = ("Track", "Align", "PassOpening")
SEEDS, MOST_RUNS = 10_000_000, 100_000  # seeds of the runs of a training with seed n begin at SEEDS + n MOST_RUNS
CENTRES = 256
KNOWS = 0.999  # share of the training inputs at a distance of at most 1


@dataclass(frozen=True)
class Options:
    """Options of a training."""

    rounds: int = 6  # number of rounds of driving and fitting; in the first the planner drives
    runs: int = 60  # number of runs in each round
    seed: int = 0
    workers: int = 1  # number of processes
    epochs: int = 20  # of a fit; the last fit has twice as many
    hidden: tuple[int, ...] = (64, 64)  # sizes of the hidden layers
    device: str = "cpu"  # of the fits, cpu or cuda


@dataclass(frozen=True)
class Round:
    """Result of a round."""

    number: int  # of the round, from 0
    runs: int  # number of runs
    arrived: int  # number of runs that arrived
    samples: int = 0  # number of samples of all rounds until now
    error: float = math.nan  # of the fit on held-out samples, deg


@dataclass(frozen=True)
class Demonstration:
    """The samples of one run: inputs (N, 18), the planner's commands (N, 2) in rad, and whether the run arrived."""

    inputs: Array
    commands: Array
    arrived: bool


class Teacher:
    """Stands between leaves and rig: keeps the commands of the leaves, and sends those of the policy in their place."""

    def __init__(self, policy: Policy | None) -> None:
        self.policy = policy
        self.rows = list[Array]()
        self.commands = list[Command]()
        self._leg: tuple[str, int] | None = None  # opening, and the ring from which the ball comes to it
        self._turn = 0.0

    def watch(self, tree: BehaviorTree, context: RunContext) -> None:
        """Begin to stand between leaves and rig of this run."""
        steer = context.steer
        context.steer = lambda leaf, command: steer(leaf, self._record_and_replace(context, leaf, command))

    def _record_and_replace(self, run: RunContext, leaf: str, command: Command) -> Command:
        here, opening = run.here, run.leg.opening
        ring = run.maze.ring(here.ring)
        if leaf not in LEARNED or opening is None or ring.is_disc or ring.number not in (opening.outer, opening.inner):
            self._leg = None
            return command
        leg = (opening.name, here.ring)
        if self._leg != leg:
            self._leg = leg
            self._turn = run.turn_to(opening)
        self._turn = nearest(difference(opening.angle, here.theta), self._turn)
        inputs = policy_inputs(here, ring, opening, self._turn, leaf == "PassOpening", run.plate)
        if not np.isfinite(inputs).all():
            return command
        self.rows.append(inputs)
        self.commands.append(command)
        return command if self.policy is None else self.policy.command(inputs, run.plate)


def demonstrate(campaign: Campaign, index: int, policy: Policy | None) -> Demonstration:
    """Do run number `index` and return its lesson. policy: drives; None: the planner drives."""
    teacher = Teacher(policy)
    seed, start, goal = campaign.seed + index, 1, len(campaign.maze.rings)
    if index % 2:
        start, goal = np.random.default_rng(seed).choice(np.arange(1, goal + 1), 2, replace=False)
    job = Job(int(start), int(goal), None, seed, campaign.time_limit)
    result = run_one(campaign, index, Company(watch=teacher.watch), job)
    commands = np.array([(c.u_beta, c.u_gamma) for c in teacher.commands]).reshape(-1, 2)
    return Demonstration(np.array(teacher.rows).reshape(-1, len(INPUTS)), commands, result.success)


def train(
    campaign: Campaign, options: Options, *, show: Words = no_words, advance: Advance = no_advance,
    tell: Callable[[Round], None] = lambda done: None,
) -> Policy:  # fmt: skip
    """Train a policy and return that of the last round.

    campaign: rig, map, model and settings
    show: gets the step under way
    tell: gets the result of each round
    """
    maze = campaign.maze
    plate = plate_of(maze, campaign.resolve().setup.driving_model)
    campaign = replace(campaign, deadline=False, own_process=options.workers > 1)
    first, lessons, policy = SEEDS + MOST_RUNS * options.seed, list[Demonstration](), None
    with open_executor(options.workers) as executor:
        for number in range(options.rounds):
            part = piece(advance, number, 0.8, options.rounds)
            show(f"round {number + 1}: {'the planner' if policy is None else 'the policy'} drives")
            runs = replace(campaign, seed=first + number * options.runs)
            new = dict[int, Demonstration]()
            for index, found in executor.each(demonstrate, [(runs, i, policy) for i in range(options.runs)]):
                new[index] = found
                part(len(new), options.runs)
            lessons += [new[index] for index in sorted(new)]  # in one order for any number of workers
            show(f"round {number + 1}: fitting to {sum(len(of.inputs) for of in lessons)} samples")
            done = Round(number, options.runs, sum(of.arrived for of in new.values()))
            facts = {
                "rig": rig_label(str(campaign.rig)), "map": maze.name, **asdict(options),
                "run_seeds": [first, first + options.rounds * options.runs - 1],
            }  # fmt: skip
            policy = _fitted(lessons, plate, options, facts, done, piece(advance, number + 0.8, 0.2, options.rounds))
            tell(replace(done, samples=policy.facts["samples"], error=policy.facts["error_deg"]))
    assert policy is not None
    return policy


def _fitted(
    lessons: list[Demonstration], plate: Plate, options: Options, facts: dict[str, Any], done: Round, advance: Advance
) -> Policy:
    inputs = np.concatenate([of.inputs for of in lessons])
    commands = np.concatenate([of.commands for of in lessons])
    fit = fit_network(
        inputs, commands, inputs[:, [COS, SIN]], plate.limit, np.array([plate.offset_beta, plate.offset_gamma]),
        hidden=options.hidden, epochs=options.epochs * (1 + (done.number + 1 == options.rounds)),
        seed=options.seed + done.number, device=options.device, advance=advance,
    )  # fmt: skip
    z = ((inputs - fit.mean) / fit.scale)[:, :KNOWN]
    centres, reach = _cover(z.astype(np.float32))
    del facts["workers"]
    facts |= {"hidden": list(options.hidden), "samples": len(inputs), "error_deg": round(math.degrees(fit.error), 4)}
    facts["arrived_in_last_round"] = done.arrived
    return Policy(fit.layers, fit.mean, fit.scale, centres, reach, plate.limit, facts)


def _cover(rows: Single) -> tuple[Single, float]:
    """Centres among rows (N, M), and their reach: the share KNOWS of the rows is nearer than this to a centre.

    Each centre is the row that is farthest from the centres before it."""
    chosen, square = [0], ((rows - rows[0]) ** 2).sum(axis=1)
    while len(chosen) < min(CENTRES, len(rows)):
        chosen.append(int(square.argmax()))
        square = np.minimum(square, ((rows - rows[chosen[-1]]) ** 2).sum(axis=1))
    return rows[chosen], max(math.sqrt(float(np.quantile(square, KNOWS))), 1e-3)
