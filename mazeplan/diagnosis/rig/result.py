"""The verdict on a whole rig, as a document and in words: what differs, how sure that is, and what to do."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from mazeplan.control.estimation.rigid_body_filter import BodyFilter
from mazeplan.core.logs.table import Table
from mazeplan.diagnosis.effect_entry import Entry, untold, values_of
from mazeplan.diagnosis.rig.candidates import Candidate
from mazeplan.diagnosis.rig.entry_words import DEG, REPAIRS, change, place, plain, repair
from mazeplan.diagnosis.rig.imbalance import BALANCED, Imbalance
from mazeplan.diagnosis.rig.reference import SLIDES, TEXTBOOK_BALL, RigReference
from mazeplan.diagnosis.rig.scores import HeldOut
from mazeplan.diagnosis.rig.search import SearchResult, Tried
from mazeplan.diagnosis.stage.comparison import moved_zero
from mazeplan.diagnosis.stage.plate_motion import Stage
from mazeplan.learning.fits import FITS, kind_of_ball
from mazeplan.physics.rig.stage import StageModel

HELD_OUT = 0.5  # each half of a record is predicted from the other
REMAINS, TWICE = 1.5, 2.0  # residual over noise: above 1.5, compare it with the earlier one; above 2, it is too large
MANY = 5  # effects from which the model is probably of another rig
LEAST_GAIN = 0.5  # of a tilt sensor; below this, or above its inverse, swapped columns are more likely
CERTAIN, BARELY = 8.0, 0.5  # standard errors: minimum for "certain", for any word
NOT_PREDICTING = "held-out parts are predicted no better"
OF_THE_STAGE = {"servo_gain", "tilt_gain", "axis_coupling"}  # what is found of overtaxed servos


@dataclass(frozen=True)
class Unknown:
    """Something without a name, or of unknown cause and size.

    description: words for what has no name, "" if there is nothing
    depends_on: what it depends on
    look: advice where to look
    cause: whether the description says what differs, although no model has a number for it
    servos: what servos do that did not do it before; the record does not show the cause or the size"""

    description: str = ""
    depends_on: tuple[str, ...] = ()
    look: tuple[str, ...] = ()
    servos: tuple[str, ...] = ()
    cause: bool = False

    def document(self) -> dict[str, Any]:
        """As in the JSON document."""
        words = "; ".join(word for word in (self.description, *self.servos) if word)
        out: dict[str, Any] = {"depends_on": list(self.depends_on), "description": words}
        return out | ({"look": list(self.look)} if self.look else {})


@dataclass(frozen=True)
class RigVerdict:
    """What differs from the reference.

    effects: entries of the document
    alike: groups of names that the record cannot tell apart
    unknown: something without a name, None if there is nothing
    held: predictions of the held-out halves
    memory, remaining: of the innovations (`record.residual_summary`)
    searched, body, stage, was: what the verdict follows from
    notes: what could not be compared or was refused
    test: predictions of a further record
    imbalance: of the ball
    sensor: the tilt sensor's changed scale, if commands and ball show it
    moves: the stage that moves the plate, None if the measured tilt does
    table: the record"""

    effects: tuple[Entry, ...]
    alike: tuple[tuple[str, ...], ...]
    unknown: Unknown | None
    held: HeldOut
    memory: float
    remaining: float
    searched: SearchResult
    body: BodyFilter
    stage: Stage | None
    was: RigReference
    notes: tuple[str, ...] = ()
    test: HeldOut | None = None
    imbalance: Imbalance = BALANCED
    sensor: Entry | None = None
    moves: StageModel | None = None
    table: Table | None = None

    @property
    def verdict(self) -> str:
        """nothing_missing, effect_found, ambiguous or unknown_effect."""
        if self.unknown is not None:
            return "unknown_effect"
        if not self.effects:
            return "nothing_missing"
        return "ambiguous" if self.alike else "effect_found"

    @property
    def before(self) -> dict[str, float]:
        """Errors of roll-outs on held-out halves, without what was found."""
        return self.held.errors("before")

    @property
    def after(self) -> dict[str, float]:
        """Errors of roll-outs on held-out halves, with what was found."""
        return self.held.errors("after") if self.effects or self.unknown is not None else self.before

    @property
    def zero(self) -> dict[str, float]:
        """By how much the tilt at zero command moved, as the tilt sensor shows it, rad, by axis; {} if it did not."""
        return moved_zero(self.stage, self.was.stage)

    def sentences(self) -> list[str]:
        """What was found, and what to do."""
        return [sentence(self), *advice(self)]

    def document(self) -> dict[str, Any]:
        """The document of `diagnose --json`. Every effect has the errors of all effects together, at the samples ahead
        that decide."""
        before, after = self.before, self.after
        decides = f"rollout{self.held.ahead}"
        errors = {"before": before[decides], "after": after[decides]}
        numbers = sorted({int(ring) for effect in self.effects for ring in effect["rings"]})
        test = {}
        if self.test is not None:
            test = {"test": {which: {"nrmse": None, **self.test.errors(which)} for which in ("before", "after")}}
        return {
            "verdict": self.verdict, "sentence": sentence(self),
            "effects": [effect | errors for effect in self.effects],
            "ambiguous_with": [list(g) for g in self.alike],
            "unknown": None if self.unknown is None else self.unknown.document(),
            "before": {"nrmse": None, **before}, "after": {"nrmse": None, **after}, "noise_floor": None,
            "held_out": HELD_OUT, "remaining": round(self.remaining, 3), "advice": advice(self),
            "fits": {"reference": round(self.was.remaining, 3) or None, "record": round(self.remaining, 3)},
            "tried": self._tried(), "reference": self.was.source, "notes": list(self.notes), **test,
            "rings": {str(ring): self._in_ring(str(ring)) for ring in numbers},
        }  # fmt: skip

    def _tried(self) -> list[dict[str, Any]]:
        """What was looked for and not taken, the largest gain of -2 log L first."""
        names = {effect["name"] for effect in self.effects}
        names |= {"tilt_gain"} if "servo_gain" in names else set()  # as the ball sees it where nobody measures the tilt
        found = zip(self.searched.found, self.searched.gains, strict=True)
        refused = [Tried(c, gain, NOT_PREDICTING) for c, gain in found if c.effect not in names]
        tried = sorted((*refused, *self.searched.tried), key=lambda one: -one.gain)
        return [
            {"name": one.candidate.effect or one.candidate.words, "gain": round(one.gain, 1), "why_not": one.why_not}
            for one in tried if one.candidate.effect or not self._nameless(one.candidate)
        ]  # fmt: skip

    def _nameless(self, c: Candidate) -> bool:
        """Whether what is unknown is this candidate without a name."""
        return self.unknown is not None and bool(c.words) and c.words in self.unknown.description

    @property
    def misfit(self) -> str:
        """Which kind of thing the model lacks, if it does not fit the rig even when the model was right; else empty."""
        words = ["a servo of another kind"] if self.was.stage.times_noise > FITS else []
        ball = self.was.body.model.ball
        return " and ".join(
            [*words, kind_of_ball(ball.inertia <= SLIDES, ball.wall)] if self.was.remaining > FITS else words
        )

    def _in_ring(self, ring: str) -> dict[str, Any]:
        """The verdict on all rings, with the sizes of the effects in one ring."""
        here = []
        for effect in self.effects:
            if ring in effect["rings"]:
                there, parameters = effect["rings"][ring]["after"], effect["parameters"]
                numbers = {key: {**parameters[key], "value": value} for key, value in there.items()}
                here.append({"name": effect["name"], "parameters": numbers})
        return {"verdict": self.verdict, "effects": here}


def sentence(done: RigVerdict) -> str:
    """What differs, how much, how sure that is, and what it does to the prediction."""
    before, after = (errors[f"rollout{done.held.ahead}"] for errors in (done.before, done.after))
    first = ""
    if done.misfit:
        first = f"The model does not fit this rig, also in the reference: {done.misfit}? So nothing is certain. "
    left = f"What remains is {done.remaining:.1f} times the noise of the camera"
    if done.was.remaining > REMAINS and done.remaining > REMAINS:
        left += f"; it was {done.was.remaining:.1f} times when the model was right"
    if done.verdict == "nothing_missing":
        far, limits = _as_far_as(done)
        return f"{first}Nothing is missing{far}: the rig agrees with {done.was.source}. {left}.{limits}"
    parts = [change(effect) for effect in done.effects]
    if done.unknown is not None:
        what = done.unknown.description
        parts += [what if done.unknown.cause else f"something without a name ({what})"] if what else []
        parts += done.unknown.servos
    groups = "; it ".join(untold(map(plain, group)) for group in done.alike)
    doubt = f" But this record {groups}." if groups else ""
    error = ""
    if round(DEG * after, 1) != round(DEG * before, 1) and not _by_tilt_alone(done):
        error = f" {_errors(done, done.held.ahead, before, after)} on held-out parts."
    return f"{first}The rig differs from {done.was.source}: {'; '.join(parts)}.{_surely(done)}{error}{doubt} {left}."


def _as_far_as(done: RigVerdict) -> tuple[str, str]:
    """What a record without a finding does not show: a part of a sentence, and a sentence; empty if it shows all."""
    far = ", as far as this record shows"
    if done.stage is None:
        return far, " It does not show the servos."
    if done.stage.servos_overtaxed:
        return far, " Of the servos, it shows large changes only."
    return "", ""


def _by_tilt_alone(done: RigVerdict) -> bool:
    """Whether all findings are of a stage whose servos are overtaxed. Roll-outs of the ball say nothing about these."""
    names = {e["name"] for e in done.effects}
    return done.stage is not None and done.stage.servos_overtaxed and bool(names) and names <= OF_THE_STAGE


def _errors(done: RigVerdict, ahead: int, before: float, after: float) -> str:
    """Errors of roll-outs, rad, so many samples ahead, in words."""
    time = f"{ahead * done.body.pictures.dt:.1f} s ahead"
    return f"{time}, the error of the predicted angle goes from {DEG * before:.1f} to {DEG * after:.1f} degrees"


def words_on_test(done: RigVerdict) -> str:
    """The errors on the test record in words; empty without one."""
    if done.test is None:
        return ""
    ahead = done.test.ahead
    before, after = (done.test.errors(which)[f"rollout{ahead}"] for which in ("before", "after"))
    return _errors(done, ahead, before, after)


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
    before = effect["known_before"]
    ratios = [
        abs(p["value"] - before.get(key, 0.0)) / p["stderr"] for key, p in effect["parameters"].items() if p["stderr"]
    ]
    return max((r for r in ratios if math.isfinite(r)), default=0.0)


def advice(
    done: RigVerdict, written: str | None = None, add: str = "--model MODEL -o FOLDER", logs: str = "LOG"
) -> list[str]:
    """What to do next, with commands behind a colon.

    written: folder of the new model, if there is one
    add: options that would write a new model
    logs: logs of the record, as words of a command"""
    words = [(e, repair(e)) for e in done.effects if e["name"] in REPAIRS]
    repairs = [(e, f"{what}{place(e)}.") for e, what in words if what]
    out = list(dict.fromkeys(repair for e, repair in repairs if e.get("planned", True)))
    if any(e["name"] == "tilt_gain" and not all(LEAST_GAIN < v < 1.0 / LEAST_GAIN for v in values_of(e).values())
           for e in done.effects):  # fmt: skip
        out.insert(0, "First check the columns: are x and y, or beta and gamma, swapped, or is a sign wrong?")
    if len(done.effects) >= MANY and done.was.source != TEXTBOOK_BALL:
        out.insert(0, "So much rarely changes at once: is this the model of another rig? Check --model and the log.")
    out += [f"{line} No plan can allow for it: {e['why_not']}." for e, line in repairs if not e.get("planned", True)]
    if (written or add) and any(e.get("planned", True) for e in done.effects):
        way = (f"plan with the new model: mazeplan navigate --rig RIG --model {written}" if written
               else f"write a new model: add {add} to this command")  # fmt: skip
        out.append(f"Or leave the rig as it is, and {way}.")
    if any(e["name"] == "tilt_offset" and "by" not in e for e in done.effects):
        out.append("A steady draught looks the same. Turn the maze by 90 degrees and record again to tell them apart.")
    if any({"command_delay", "servo_gain"} & set(group) for group in done.alike):
        out.append("Only a tilt sensor can tell the causes apart.")
    elif done.alike:
        out.append(
            "Record longer, in all rings, to tell the causes apart: "
            "mazeplan collect --rig RIG --rings --seconds 900 -o LOG."
        )
    if done.unknown is not None:
        look = done.unknown.look or ("One cause has no name yet",)
        out += [line if line.endswith("?") else f"{line}." for line in look]
    if done.unknown is not None and done.unknown.description:
        out.append(f"If that is how the rig has to be, learn the model again: mazeplan learn {logs} -o FOLDER.")
    elif done.verdict == "nothing_missing" and done.remaining > TWICE:
        out.append(
            "More remains than noise explains, as when the model was right. Learn the model again with terms "
            f"and a Gaussian process: mazeplan learn {logs} --kind sp -o FOLDER."
        )
    elif done.verdict == "nothing_missing":
        out.append("Nothing needs to be done. Go on with the same model.")
    return out
