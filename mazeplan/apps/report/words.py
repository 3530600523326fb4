"""Words of reports: words for names in files, one unit for each quantity, one sign for a missing value.

Angles and their errors are in degrees, angular speeds in rad/s, angular accelerations in rad/s², lengths in m.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from typing import Any

from mazeplan.physics.registry import EFFECTS

MISSING = "–"
HARD = "\u00a0"  # a space at which no line breaks
DEG = 180.0 / math.pi
UNITS = {"rad/s^2": "rad/s²", "1/s^2": "1/s²", "m/s^2": "m/s²", "1": ""}
SCORES = {
    "nrmse": "relative error of the angular acceleration (nRMSE)",
    "rollout20": "error of the angle after 20 samples, rad", "rollout40": "error of the angle after 40 samples, rad",
    "free_run": "position error of a free run, m",
}  # fmt: skip
KINDS = {
    "rf": "random forest", "p": "bare equation", "pi": "weighted terms", "np": "Gaussian process",
    "npd": "discrete process", "sp": "terms and process",
}  # fmt: skip
SETUP = {
    "rig": "rig", "map_name": "map", "model": "model", "behavior": "behaviour tree", "seed": "seed",
    "start_ring": "from ring", "via_rings": "by way of rings", "goal_ring": "to ring",
    "time_limit_s": "time limit", "version": "mazeplan", "platform": "machine",
}  # fmt: skip
_NAME = re.compile(r"\b[a-z]+(?:_[a-z]+)+\b")
_SPOKEN = {"theta_dd": "angular acceleration", "theta_ddot": "angular acceleration", "theta_dot": "angular speed"}
_LABELS = {"theta, rad": "angle of the ball, degrees", "theta_dot, rad/s": "angular speed of the ball, rad/s"}


def spoken(name: str) -> str:
    """The text, with names such as `outer_gates` replaced by words."""
    return _NAME.sub(lambda found: _SPOKEN.get(found[0], found[0].replace("_", " ")), name)


def sentence(text: Any) -> str:
    """A remark as a sentence in words: with a capital letter and a full stop."""
    words = spoken(str(text).strip())
    return words[:1].upper() + words[1:] + ("" if words[-1:] in ".:?!" else ".")


def parameter(effect: str, name: str) -> str:
    """A parameter of an effect, in words."""
    wave = re.fullmatch(r"(cos|sin)([0-9]+)", name)
    if wave is not None:
        return f"harmonic {wave[2]}, {'cosine' if wave[1] == 'cos' else 'sine'}"
    known = EFFECTS[effect].parameters.get(name) if effect in EFFECTS else None
    return known.words if known is not None and known.words else spoken(name)


def kind(name: str) -> str:
    """A kind of model, in words, followed by its name in commands."""
    return f"{KINDS[name]} ({name})" if name in KINDS else name


def labelled(value: float, label: str) -> float:
    """The value in the unit of `relabelled`. label: a label that ends in the unit of `value`."""
    return DEG * value if label.endswith(", rad") else value


def relabelled(label: str) -> str:
    """A label such as `theta, rad`, which ends in its unit, in words and with the unit of reports."""
    words = _LABELS.get(label, label)
    return spoken(words.removesuffix("rad") + "degrees" if words.endswith(", rad") else words)


def measured(value: float, stderr: float | None, unit: str) -> str:
    """Value ± standard error, with their unit. The standard error decides how many digits are shown."""
    factor, shown = (DEG, "deg") if unit == "rad" else (1.0, UNITS.get(unit, unit))
    value, error = factor * value, math.nan if stderr is None else factor * stderr
    after = f"{HARD}{shown}" if shown else ""
    if not (math.isfinite(error) and error > 0.0):
        return f"{value:.4g}{after}"
    places = max(0, 1 - math.floor(math.log10(error)))
    return f"{value:.{places}f}{HARD}±{HARD}{error:.{places}f}{after}"


def number(value: float, places: int, unit: str = "") -> str:
    """A number as text, with its unit; for NaN the sign for a missing value."""
    return f"{value:.{places}f} {unit}".rstrip() if math.isfinite(value) else MISSING


def setup_facts(setup: Mapping[str, Any], seed: str = "seed") -> list[tuple[str, str]]:
    """(label, value) of the settings of a run or an evaluation. seed: label of the seed."""
    facts = []
    for name, label in SETUP.items():
        value = setup.get(name)
        if value not in (None, "") and value == value:  # not NaN
            shown = f"{value:g}" if isinstance(value, float) else str(value).strip("[]")
            facts.append((seed if name == "seed" else label, f"{shown} s" if name.endswith("_s") else shown))
    return facts
