"""Experiments for effects that one record cannot tell apart: a command of `collect`, and what to do first."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from mazeplan.diagnosis.effect_entry import Values
from mazeplan.diagnosis.ring.screening import SURE


@dataclass(frozen=True)
class Experiment:
    """An experiment that tells effects apart.

    effects: their names
    why: why the experiment tells them apart
    preparation: what a person does before
    options: options of `mazeplan collect`"""

    effects: frozenset[str]
    why: str
    preparation: str = ""
    options: str = ""


EXPERIMENTS = tuple(Experiment(frozenset(effects), *rest) for effects, *rest in (
    (("tilt_offset", "surface_profile"), "a wave of the floor turns with the maze, a table that is not level does not",
     "turn the rig by 90 degrees on its table"),
    (("tilt_offset", "surface_bump"), "a hill is passed at every tilt, and needs the ball to come by it often",
     "", "--tilt 4 --highest-hz 0.5"),
    (("constant_torque", "dry_friction"),
     "a torque also acts on a ball at rest: small, slow tilts bring it to rest often", "", "--tilt 1 --highest-hz 0.3"),
    (("constant_torque", "tilt_offset"),
     "a torque acts alike all around, an offset turns its sign: the ball must get all around the ring",
     "", "--tilt 5 --highest-hz 0.7"),
    (("rolling_inertia", "tilt_gain"),
     "the scale of the tilt sensor also scales the rates of the tilt: large, fast tilts show it",
     "measure the scale of the tilt sensor with a clinometer, if there is one", "--tilt 5 --highest-hz 3"),
    (("viscous_friction", "quadratic_drag"),
     "drag grows with the square of the speed: both slow and fast runs are needed", "", "--tilt 5 --highest-hz 0.4"),
    (("viscous_friction", "dry_friction"), "dry friction shows at low speed and at rest",
     "", "--tilt 1.5 --highest-hz 0.5"),
    (("viscous_friction", "friction_drift"), "a drift needs time to show", "", "--seconds 900"),
))  # fmt: skip
FAR = 0.2  # error of a tilt sensor's scale beyond which other causes are likely
SAME = 0.03  # relative difference up to which two scales count as equal; their standard errors may allow more
ANY = Experiment(frozenset(), "more of everything: a longer record, with slow and fast tilts", options="--seconds 900")


def confounded_effects(values: Values, stderr: Values) -> list[tuple[str, ...]]:
    """Groups of effects that look nearly the same at the sizes that were found.

    A sensor with the same large scale on both axes looks like a ball that accelerates less because it rolls. Only the
    rotation of the plate tells them apart, and the effect of this rotation on a rolling ball is hardly known."""
    if "tilt_gain" not in values or "rolling_inertia" in values:
        return []
    (beta, gamma), errors = values["tilt_gain"].values(), stderr["tilt_gain"].values()
    same = abs(beta - gamma) <= max(SAME * 0.5 * (beta + gamma), SURE * math.hypot(*errors))
    far = min(abs(beta - 1.0), abs(gamma - 1.0)) > FAR
    return [("tilt_gain", "rolling_inertia")] if same and far else []


def experiment_for(group: Sequence[str], ring: int | None) -> dict[str, str]:
    """The experiment for a group of effects, the likeliest effect first: {"why", "first", "command"}."""
    names = set(group)
    known = [e for e in EXPERIMENTS if e.effects <= names]
    best = next((e for e in known if group and group[0] in e.effects), known[0] if known else ANY)
    where = f" --ring ring{ring}" if ring else ""
    seconds = "" if "--seconds" in best.options else " --seconds 300"
    command = f"mazeplan collect --rig RIG{where}{seconds} {best.options}".rstrip() + " -o apart.mcap"
    return {"why": best.why, "first": best.preparation, "command": command}
