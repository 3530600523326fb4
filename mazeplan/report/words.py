"""What people read in reports: words for names, one unit for each quantity, one sign for a value that is missing.

Angles and their errors are in degrees, angular speeds in rad/s, angular accelerations in rad/s²; lengths in mm or m.
"""

from __future__ import annotations

import math
import re
from typing import Any

from mazeplan.physics.registry import EFFECTS

MISSING = "–"
HARD = "\u00a0"  # a space at which no line ends
DEG = 180.0 / math.pi
UNITS = {"rad/s^2": "rad/s²", "1/s^2": "1/s²", "m/s^2": "m/s²", "1": ""}
ANGLE, SPEED = "angle of the ball, deg", "angular speed of the ball, rad/s"
BETA, GAMMA = "tilt down at +x (beta), deg", "tilt up at +y (gamma), deg"
SCORES = {
    "nrmse": "relative error of the angular acceleration (nRMSE)",
    "rollout20": "error of the angle after 20 samples, rad", "rollout40": "error of the angle after 40 samples, rad",
    "free_run": "position error of a free run, m",
}  # fmt: skip
KINDS = {
    "rf": "random forest", "p": "bare equation", "pi": "weighted terms", "np": "Gaussian process",
    "npd": "discrete process", "sp": "terms and process", "model": "the model",
}  # fmt: skip
CANDIDATES = {
    "placebo: friction with it": "placebo: friction by tilt played backwards",
    "speed and lean": "no name: by speed and wall", "direction and lean": "no name: by direction and wall",
}  # fmt: skip
_NAME = re.compile(r"\b[a-z]+(?:_[a-z]+)+\b")
_TOLD = {"theta_dd": "angular acceleration", "theta_ddot": "angular acceleration", "theta_dot": "angular speed"}


def spoken(name: str) -> str:
    """Text with names in it (`outer_gates`) as words."""
    return _NAME.sub(lambda found: _TOLD.get(found[0], found[0].replace("_", " ")), name)


def sentence(text: Any) -> str:
    """A remark as a sentence, in words."""
    told = str(text).strip()
    for name, shown in CANDIDATES.items():
        told = told.replace(name, shown)
    words = spoken(told)
    return words[:1].upper() + words[1:] + ("" if words[-1:] in ".:?!" else ".")


def candidate(name: str) -> str:
    """What a candidate of a diagnosis is called."""
    return CANDIDATES.get(name, spoken(name))


def parameter(effect: str, name: str) -> str:
    """What a parameter of an effect is called."""
    wave = re.fullmatch(r"(cos|sin)([0-9]+)", name)
    if wave is not None:
        return f"harmonic {wave[2]}, {'cosine' if wave[1] == 'cos' else 'sine'}"
    known = EFFECTS[effect].parameters.get(name) if effect in EFFECTS else None
    return known.words if known is not None and known.words else spoken(name)


def kind(name: str) -> str:
    """A kind of model, in words and as the commands call it."""
    return KINDS.get(name, name) if name == "model" or name not in KINDS else f"{KINDS[name]} ({name})"


def in_unit(value: float, unit: str) -> tuple[float, str]:
    """A value and its unit as reports have them: angles in degrees."""
    return (DEG * value, "deg") if unit == "rad" else (value, UNITS.get(unit, unit))


def labelled(value: float, label: str) -> float:
    """A value whose label ends in its unit, as `relabelled` shows it."""
    return DEG * value if label.endswith(", rad") else value


def relabelled(label: str) -> str:
    """A label that ends in its unit (`theta, rad`), in words, and in the unit that reports have."""
    words = {"theta, rad": ANGLE, "theta_dot, rad/s": SPEED}.get(label, label)
    words = words.removesuffix("rad") + "deg" if words.endswith(", rad") else words
    return spoken(re.sub(r"\btheta error\b", "error of the angle", words))


def measured(value: float, stderr: float | None, unit: str) -> str:
    """Value ± standard error, both in the unit that follows; as many digits as the error tells."""
    value, shown = in_unit(value, unit)
    error = math.nan if stderr is None else in_unit(stderr, unit)[0]
    after = f"{HARD}{shown}" if shown else ""
    if not (math.isfinite(error) and error > 0.0):
        return f"{value:.4g}{after}"
    places = max(0, 1 - math.floor(math.log10(error)))
    return f"{value:.{places}f}{HARD}±{HARD}{error:.{places}f}{after}"


def number(value: float, places: int) -> str:
    """A number, or the sign for one that is missing."""
    return f"{value:.{places}f}" if math.isfinite(value) else MISSING


def seconds(value: float) -> str:
    """A time in s."""
    return f"{value:.2f} s" if math.isfinite(value) else MISSING
