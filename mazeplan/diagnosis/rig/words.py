"""The verdict on a whole rig in words: what differs and how sure that is, what to do, and what was not compared."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from mazeplan.core.maths.angles import place_deg
from mazeplan.diagnosis.document import Entry, untold
from mazeplan.diagnosis.rig.plate import MovedPlate
from mazeplan.diagnosis.rig.reference import TEXTBOOK_BALL, RigReference
from mazeplan.diagnosis.rig.scores import HeldOut
from mazeplan.diagnosis.stage.comparison import AXES
from mazeplan.diagnosis.stage.navigation import hidden_gain
from mazeplan.learning.stage_fit import LEAST_RANGE
from mazeplan.physics.registry import EFFECTS

if TYPE_CHECKING:
    from mazeplan.diagnosis.rig.verdict import RigVerdict

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

REMAINS, TWICE = 1.5, 2.0  # residual over noise: above 1.5, compare it with the earlier one; above 2, it is too large
MANY = 5  # effects from which the model is probably of another rig
CERTAIN, BARELY = 8.0, 0.5  # standard errors: minimum for "certain", for any word
OF_THE_STAGE = {"servo_gain", "tilt_gain", "axis_coupling"}  # what is found of overtaxed servos


def sentence(done: RigVerdict) -> str:
    """What differs, how much, how sure that is, and what it does to the prediction."""
    first = ""
    if done.misfit:
        first = f"The model does not fit this rig, also in the reference: {done.misfit}? So nothing is certain. "
    left = f"What remains is {done.remaining:.1f} times the noise of the camera"
    if done.was.remaining > REMAINS and done.remaining > REMAINS:
        left += f"; it was {done.was.remaining:.1f} times when the model was right"
    if done.verdict == "nothing_missing":
        hidden = " Of the servos, it shows large changes only." if done.plate.overtaxed else ""
        hidden = hidden if done.plate.stage is not None else " It does not show the servos."
        far = ", as far as this record shows" if hidden else ""
        return f"{first}Nothing is missing{far}: the rig agrees with {done.was.source}. {left}.{hidden}"
    parts = [change(effect) for effect in done.effects]
    if done.unknown is not None:
        what = done.unknown.description
        parts += [what if done.unknown.cause else f"something without a name ({what})"] if what else []
        parts += done.unknown.servos
    groups = "; it ".join(untold(map(plain, group)) for group in done.alike)
    doubt = f" But this record {groups}." if groups else ""
    # roll-outs of the ball say nothing about a stage whose servos are overtaxed
    by_tilt = done.plate.overtaxed and bool(done.effects) and {e["name"] for e in done.effects} <= OF_THE_STAGE
    before, after = (round(DEG * errors[f"rollout{done.held.ahead}"], 1) for errors in (done.before, done.after))
    error = f" {errors_in_words(done, done.held)} on held-out parts." if after != before and not by_tilt else ""
    return f"{first}The rig differs from {done.was.source}: {'; '.join(parts)}.{_surely(done)}{error}{doubt} {left}."


def errors_in_words(done: RigVerdict, held: HeldOut) -> str:
    """Errors of roll-outs before and after, so many samples ahead as decide."""
    before, after = (DEG * held.errors(which)[f"rollout{held.ahead}"] for which in ("before", "after"))
    time = f"{held.ahead * done.plate.body.pictures.dt:.1f} s ahead"
    return f"{time}, the error of the predicted angle goes from {before:.1f} to {after:.1f} degrees"


def _surely(done: RigVerdict) -> str:
    """How sure the finding is, in words and a number; empty if unknown."""
    if math.isfinite(done.held.z_score):
        size, why = done.held.z_score, "predicts held-out parts better by {}"
    else:
        sizes = [ratio for effect in done.effects if (ratio := _ratio(effect))]
        size, why = min(sizes, default=0.0), "is a change of {}"
    if size < BARELY:
        return ""
    word = "likely" if size <= CERTAIN or done.misfit else "certain"
    count = "over 1000" if size >= 1000.0 else f"{size:.0f}"
    why = why.format(f"{count} standard error{'s' * (count != '1')}")
    if len(done.effects) > 1 and math.isfinite(done.held.z_score):
        return f" Together, the findings are {word}: they {why.replace('predicts', 'predict')}."
    return f" The finding is {word}: it {why}."


def _ratio(effect: Entry) -> float:
    """The largest change of an effect's numbers over its standard error."""
    before, numbers = effect["known_before"], effect["parameters"]
    ratios = [abs(p["value"] - before.get(key, 0.0)) / p["stderr"] for key, p in numbers.items() if p["stderr"]]
    return max((r for r in ratios if math.isfinite(r)), default=0.0)


def advice(
    done: RigVerdict, written: str | None = None, add: str = "--model MODEL -o FOLDER", logs: str = "LOG"
) -> list[str]:
    """What to do next, with commands behind a colon.

    written: folder of the new model, if there is one
    add: options that would write a new model
    logs: logs of the record, as words of a command"""
    out, refused, plannable = list[str](), list[str](), any(e.get("planned", True) for e in done.effects)
    for e in done.effects:
        if what := repair(e) if e["name"] in REPAIRS else "":
            line = f"{what}{place(e)}."
            if e.get("planned", True):
                out.append(line)
            else:
                refused.append(f"{line} No plan can allow for it: {e['why_not']}.")
    out = [*dict.fromkeys(out), *refused]
    if len(done.effects) >= MANY and done.was.source != TEXTBOOK_BALL:
        out.insert(0, "So much rarely changes at once: is this the model of another rig? Check --model and the log.")
    if written and plannable:
        out.append(
            f"Or leave the rig as it is, and plan with the new model: mazeplan navigate --rig RIG --model {written}."
        )
    elif add and plannable:
        out.append(f"Or leave the rig as it is, and write a new model: add {add} to this command.")
    if any(e["name"] == "tilt_offset" and "by" not in e for e in done.effects):
        out.append("A steady draught looks the same. Turn the maze by 90 degrees and record again to tell them apart.")
    if any({"command_delay", "servo_gain"} & set(group) for group in done.alike):
        out.append("Only a tilt sensor can tell the causes apart.")
    elif done.alike:
        collect = "mazeplan collect --rig RIG --rings --seconds 900 -o LOG"
        out.append(f"Record longer, in all rings, to tell the causes apart: {collect}.")
    if done.unknown is not None:
        look = done.unknown.look or ("One cause has no name yet",)
        out += [line if line.endswith("?") else f"{line}." for line in look]
        if done.unknown.description:
            out.append(f"If that is how the rig has to be, learn the model again: mazeplan learn {logs} -o FOLDER.")
    elif done.verdict == "nothing_missing" and done.remaining > TWICE:
        out.append(
            "More remains than noise explains, as when the model was right. Learn the model again with terms "
            f"and a Gaussian process: mazeplan learn {logs} --kind sp -o FOLDER."
        )
    elif done.verdict == "nothing_missing":
        out.append("Nothing needs to be done. Go on with the same model.")
    return out


def change(effect: Entry) -> str:
    """An effect with its sizes before and now, and its place now."""
    parts, places, changed = list[str](), _places(effect), _changed(effect)
    sizes = {str(both.get("after")) for both in effect["rings"].values()}
    if len(sizes) > 1 or (places and len(effect["rings"]) == 1):  # otherwise the numbers are those of all rings
        everywhere = "in all rings; " if len(effect["rings"]) > 1 and not places else ""
        parts.append(f"{everywhere}in ring {next(iter(effect['rings']))}")
    for key, number in effect["parameters"].items():
        if key not in places and key not in changed and len(effect["parameters"]) > 1:
            continue
        known = EFFECTS[effect["name"]].parameters.get(key) if effect["name"] in EFFECTS else None
        factor, unit = SHOWN.get(number["unit"], (1.0, SQUARES.get(number["unit"], number["unit"])))
        if key in places:
            at = place_deg(number["value"], 1) if key in PLACES else factor * number["value"]
            size = f"{at:.3g} {unit}".rstrip()
            size = size if number.get("determined", True) else f"not determined ({size} fits)"
        else:
            old, now, error = effect["known_before"].get(key, 0.0) or 0.0, number["value"], number["stderr"]
            digits = _digits(factor * error, factor * now)
            # a limit at its highest value limits nothing
            was, now = (
                "none" if known is not None and v == known.default == known.high else f"{factor * v:.{digits}f}"
                for v in (old, now)
            )
            size = f"from {was if old else 0} to {now} ± {factor * error:.{digits}f} {unit}".rstrip()
        parts.append(f"{known.words if known is not None and known.words else plain(key)} {size}")
    return f"{plain(effect['name'])} ({', '.join(parts)})" if parts else plain(effect["name"])


def _places(effect: Entry) -> tuple[str, ...]:
    """Parameters of an effect that say where it is."""
    return tuple(EFFECTS[effect["name"]].places) if effect["name"] in EFFECTS else ()


def _digits(error: float, value: float) -> int:
    """Decimal places that are meaningful with a standard error; three figures of a value without one."""
    size = error if math.isfinite(error) and error > 0.0 else abs(value) / 10.0
    return min(max(0, 1 - math.floor(math.log10(size))), 9) if size > 0.0 else 2


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


def notes_on(plate: MovedPlate, was: RigReference) -> list[str]:
    """Notes on what could not be compared."""
    notes, stage = [], plate.stage
    if was.body.start is not None:
        notes.append(
            "what differs from a textbook ball need not be a fault: to find faults, learn a model while the rig is in "
            "order, and name it with --model"
        )
    if plate.blind:
        notes.append("nobody measures the tilt: the servos show only through the ball")
    elif stage is None:
        commands = [f"u_{axis}" for axis in AXES]
        have = all(name in plate.table for name in commands)
        still = [name for name in commands if have and np.ptp(plate.table[name]) < LEAST_RANGE]
        why = f"{' and '.join(still or commands)} {'never change' if still else 'are missing or too few'}"
        notes.append(f"the commands {why}: servos cannot be checked, and the tilt is smoothed")
    elif stage.servos_overtaxed:
        notes.append(
            "the servos cannot follow the commands of this record, as in navigation, or with a servo that became slow "
            "or loose, so only large changes of the servos were looked for"
        )
        if hidden_gain(stage, was.stage):
            notes.append("gains of the servos were not compared: play or a dead band makes them look smaller")
    if was.body.open and was.friction is not None:
        notes.append(
            "the model keeps no record of the rig as it was: walls were not compared, and friction only "
            "roughly; name a log of that time with --reference, or learn the model again"
        )
    return notes
