"""An effect that was found, in words: its sizes before and now, where it is, and what to repair."""

from __future__ import annotations

import math

from mazeplan.core.maths.angles import place_deg
from mazeplan.diagnosis.effect_entry import Entry
from mazeplan.physics.registry import EFFECTS

DEG = 180.0 / math.pi
SHOWN = {"rad": (DEG, "degrees"), "m": (1e3, "mm"), "s": (1e3, "ms")}  # how a person reads a unit
SQUARES = {"rad/s^2": "rad/s²", "1/s^2": "1/s²", "m/s^2": "m/s²", "1": ""}
PLACES = ("centre", "start", "end", "angle")  # rad, of an effect on a ring
REPAIRS = {
    "tilt_offset": "Level the table", "axis_misalignment": "Turn the camera back", "camera_offset": "Centre the camera",
    "sensor_delay": "Look for what delays the camera's pictures", "servo_gain": "Check the linkage of the servo",
    "servo_lag": "Check the servo's supply and load",
    "rate_limit": "Check the servo's supply and load",
    "backlash": "Look for play, or for a servo that stops short, in the linkage",
    "deadband": "Check the servo", "command_delay": "Look for what delays the commands",
    "tilt_gain": "Calibrate the tilt sensor", "dry_friction": "Clean the ball and the floor",
    "viscous_friction": "Clean the ball and the floor", "wall_friction": "Clean the walls",
    "quadratic_drag": "Look for what brakes a fast ball", "local_friction": "Clean the floor",
    "friction_drift": "Look for what warms up or gets dirty", "constant_torque": "Look for a draught that goes round",
    "surface_bump": "Look for a magnet or a dent", "surface_profile": "Check that the floor is flat",
    "table_rocking": "Stop the table from rocking", "camera_scale": "Calibrate the camera",
    "lens_distortion": "Calibrate the camera", "axis_coupling": "Align the axes of the plate",
    "rolling_inertia": "Check that it is the same ball", "gate_loss": "Look for an edge or a burr",
    "surface_ripple": "Check that the floor is flat", "ball_imbalance": "Take a ball that is evenly heavy",
}  # fmt: skip
BY_SENSOR = {"by": "tilt sensor"}  # in the entry of a table that is not level: only the sensor says so
# their advice names the axis
OF_AN_AXIS = {"servo_gain", "servo_lag", "rate_limit", "backlash", "deadband", "tilt_gain"}


def change(effect: Entry) -> str:
    """An effect with its sizes before and now, and its place now."""
    before, parts, places, changed = effect["known_before"], [], _places(effect), _changed(effect)
    sizes = {str(both.get("after")) for both in effect["rings"].values()}
    if len(sizes) > 1 or (places and len(effect["rings"]) == 1):  # otherwise the numbers are those of all rings
        everywhere = "in all rings; " if len(effect["rings"]) > 1 and not places else ""
        parts.append(f"{everywhere}in ring {next(iter(effect['rings']))}")
    for key, number in effect["parameters"].items():
        old, error = before.get(key, 0.0) or 0.0, number["stderr"]
        if key not in places and key not in changed and len(effect["parameters"]) > 1:
            continue
        factor, unit = SHOWN.get(number["unit"], (1.0, SQUARES.get(number["unit"], number["unit"])))
        if key in places:
            at = place_deg(number["value"], 1) if key in PLACES else factor * number["value"]
            at = f"{at:.3g} {unit}".rstrip()
            at = at if number.get("determined", True) else f"not determined ({at} fits)"
            parts.append(f"{_called(effect['name'], key)} {at}")
            continue
        digits = _digits(factor * error, factor * number["value"])
        was, now = (_none(effect["name"], key, v) or f"{factor * v:.{digits}f}" for v in (old, number["value"]))
        change = f"from {was if old else 0} to {now} ± {factor * error:.{digits}f} {unit}".rstrip()
        parts.append(f"{_called(effect['name'], key)} {change}")
    return f"{plain(effect['name'])} ({', '.join(parts)})" if parts else plain(effect["name"])


def _none(effect: str, key: str, value: float) -> str:
    """ "none" for a limit at its highest value, which limits nothing."""
    known = EFFECTS[effect].parameters.get(key) if effect in EFFECTS else None
    return "none" if known is not None and value == known.default == known.high else ""


def _places(effect: Entry) -> tuple[str, ...]:
    """Parameters of an effect that say where it is."""
    return tuple(EFFECTS[effect["name"]].places) if effect["name"] in EFFECTS else ()


def _digits(error: float, value: float) -> int:
    """Decimal places that are meaningful with a standard error; three figures of a value without one."""
    size = error if math.isfinite(error) and error > 0.0 else abs(value) / 10.0
    return min(max(0, 1 - math.floor(math.log10(size))), 9) if size > 0.0 else 2


def _called(effect: str, key: str) -> str:
    """Words for a parameter of an effect."""
    known = EFFECTS[effect].parameters.get(key) if effect in EFFECTS else None
    return known.words if known is not None and known.words else plain(key)


def plain(name: str) -> str:
    """A name as words."""
    return name.replace("_", " ")


def place(effect: Entry) -> str:
    """Where to look, if the effect has a place."""
    places = _places(effect)
    at = {key: p["value"] for key, p in effect["parameters"].items() if key in PLACES and key in places}
    if not at:
        axes = [axis for axis in ("beta", "gamma") if axis in _changed(effect)]
        return f" of {axes[0]}" if effect["name"] in OF_AN_AXIS and len(axes) == 1 else ""
    ring = next(iter(effect["rings"]), "")
    if not all(effect["parameters"][key].get("determined", True) for key in at):
        return f" in ring {ring}" if ring else ""
    angles = " to ".join(f"{place_deg(angle, 0):.0f}" for angle in at.values())
    return f" at {angles} degrees" + (f" in ring {ring}" if ring else "")


def _changed(effect: Entry) -> list[str]:
    """The numbers of an effect that a sentence gives: all if none has changed by three standard errors."""
    before, numbers = effect.get("known_before", {}), effect["parameters"]
    far = [key for key, p in numbers.items() if abs(p["value"] - (before.get(key, 0.0) or 0.0)) > 3.0 * p["stderr"]]
    return far or list(numbers)


def repair(effect: Entry) -> str:
    """What to repair; empty if the effect became smaller."""
    known, before = EFFECTS[effect["name"]].parameters, effect.get("known_before", {})
    sizes = {key: p["value"] for key, p in effect["parameters"].items() if key not in _places(effect)}
    fault = any(known[key].default for key in sizes if key in known)
    if sizes and not fault and all(abs(value) <= abs(before.get(key, 0.0) or 0.0) for key, value in sizes.items()):
        return ""
    if effect["name"] == "surface_bump" and effect["parameters"]["height"]["value"] > 0.0:
        return "Look for a hill or for dirt under the ball"
    if "by" in effect:
        return "Set the tilt sensor to zero: the ball feels no other tilt than before"
    return REPAIRS[effect["name"]]
