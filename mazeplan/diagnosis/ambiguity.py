"""What would tell effects apart that one record cannot: an excitation, as a command to `collect`, and what to do
first."""

from __future__ import annotations

import shlex
from collections.abc import Mapping, Sequence
from dataclasses import dataclass


@dataclass(frozen=True)
class Experiment:
    """effects: which it tells apart; why; first: what a person does before; options: of `mazeplan collect`."""

    effects: frozenset[str]
    why: str
    first: str = ""
    options: str = ""


EXPERIMENTS = (
    Experiment(
        frozenset({"tilt_offset", "surface_profile"}),
        "a wave of the floor turns with the maze, a table that is not level does not",
        "turn the rig by 90 degrees on its table",
    ),
    Experiment(
        frozenset({"tilt_offset", "surface_bump"}),
        "a hill is passed at every tilt, and needs the ball to come by it often",
        options="--tilt 4 --highest-hz 0.5",
    ),
    Experiment(
        frozenset({"constant_torque", "dry_friction"}),
        "a torque also acts on a ball at rest: small, slow tilts bring it to rest often",
        options="--tilt 1 --highest-hz 0.3",
    ),
    Experiment(
        frozenset({"constant_torque", "tilt_offset"}),
        "a torque acts alike all around, an offset turns its sign: the ball must get all around the ring",
        options="--tilt 5 --highest-hz 0.7",
    ),
    Experiment(
        frozenset({"rolling_inertia", "tilt_gain"}),
        "the scale of the tilt sensor also scales the rates of the tilt: large, fast tilts show it",
        "or measure the scale with a clinometer",
        "--tilt 5 --highest-hz 3",
    ),
    Experiment(
        frozenset({"viscous_friction", "quadratic_drag"}),
        "drag grows with the square of the speed: both slow and fast runs are needed",
        options="--tilt 5 --highest-hz 0.4",
    ),
    Experiment(
        frozenset({"viscous_friction", "dry_friction"}),
        "dry friction shows at low speed and at rest",
        options="--tilt 1.5 --highest-hz 0.5",
    ),
    Experiment(
        frozenset({"viscous_friction", "friction_drift"}),
        "a drift needs time to show",
        options="--seconds 900",
    ),
)
ANY = Experiment(frozenset(), "more of everything: a longer record, with slow and fast tilts", options="--seconds 900")


def on_machine(ways: Sequence[Mapping[str, str]], options: Sequence[str], note: str = "") -> list[dict[str, str]]:
    """The ways of `experiment_for` with options of `collect` that say with which machine; note: of what a person has to
    fill in."""
    told = "".join(f" {shlex.quote(option)}" for option in options)
    start = "mazeplan collect"
    return [
        {**way, "command": way["command"].replace(start, start + told, 1), **({"note": note} if note else {})}
        for way in ways
    ]


def experiment_for(group: Sequence[str], ring: int | None) -> dict[str, str]:
    """What to do about a group of effects, the likeliest first: {"why", "first", "command"}."""
    names = set(group)
    known = [e for e in EXPERIMENTS if e.effects <= names]
    best = next((e for e in known if group and group[0] in e.effects), known[0] if known else ANY)
    where = f" --ring ring{ring}" if ring else ""
    seconds = "" if "--seconds" in best.options else " --seconds 300"
    command = f"mazeplan collect{where}{seconds} {best.options}".rstrip() + " -o apart.mcap"
    return {"why": best.why, "first": best.first, "command": command}
