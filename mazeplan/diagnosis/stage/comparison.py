"""Stage and tilt sensor of a record against those of the model, by commands and measured tilt alone.

Each number of an axis is compared with the model's, with the standard errors of both. A changed gain has two possible
causes: the servo turns the plate further, or the sensor shows larger tilts. The commands cannot tell them apart. The
ball can, since it feels the true tilt: the likelier scale of the tilt decides.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

from mazeplan.core.logs.table import Table
from mazeplan.diagnosis.document import Entry, Values, effect_entry, values_of
from mazeplan.diagnosis.record import RingRecord
from mazeplan.diagnosis.stage.plate_motion import Stage
from mazeplan.learning.axis_record import fastest_turn, free_numbers
from mazeplan.learning.modelfile import RigModel
from mazeplan.learning.rig_model import declared_parts, part_stderr
from mazeplan.learning.stage_fit import StageFit, fit_axis
from mazeplan.physics.effect import Effect
from mazeplan.physics.effects import rig
from mazeplan.physics.rig.stage import StageAxis, StageModel

SURE = 5.0  # standard errors of the difference: the residual of a stage is not white
WHOLE = 0.9  # of a sample: change of the dead time of axes that follow at once
PLAY_ERROR = 1e-4  # rad; error of play, in addition to that of the fit
ASIDE = 0.25  # of the changes of play and dead band, the smaller one counts only above this share of the larger one
DIFFERENT = 1.5  # residual of a known axis over that of a free fit from which its lag or dead time changed: on one
# rig (dead time, limited rate, coarse tilt) it is 1.0 to 1.1 in healthy records, 2 to 3 with 20 instead of 35 rad/s
SLOW_TURN = 0.9  # of the fastest turn of a reference: a limit below this would have shown there
MOST_CHANGES = 2  # of effects of the stage that explain a record together
NUMBERS_OF = {  # the numbers of an axis that belong to an effect
    rig.servo_lag.name: ("natural_frequency", "damping"), rig.command_delay.name: ("dead_time",),
    rig.rate_limit.name: ("rate_limit",), rig.backlash.name: ("backlash", "behind"), rig.deadband.name: ("deadband",),
}  # fmt: skip
DECISIVE = 15.0  # of -2 log L, by which servo or sensor must be the better explanation
LEAST_ZERO = 0.002  # rad; a smaller change of the measured tilt at zero command is no news
AXES: tuple[str, ...] = ("beta", "gamma")
COUPLINGS: dict[str, str] = {"beta": "beta_from_gamma", "gamma": "gamma_from_beta"}
PLAY_AND_DEADBAND = (rig.backlash, rig.deadband)
COMPARED_EFFECTS = (rig.servo_lag, rig.rate_limit, rig.axis_coupling, rig.command_delay, *PLAY_AND_DEADBAND)


@dataclass(frozen=True)
class Known:
    """The stage of the model: values of its effects, standard errors if known, and the kind of its axes."""

    values: Values
    stderr: Values
    kind: StageModel = field(default_factory=StageModel)
    times_noise: float = math.nan  # rms of its fit over the noise when the model was right; NaN if unknown
    # rate that each axis hardly exceeded in the record of that time, rad/s; NaN without one
    fastest: tuple[float, float] = (math.nan, math.nan)

    @classmethod
    def of_model(cls, model: RigModel) -> Known:
        """The stage of a rig's model."""
        values = declared_parts(model)
        stderr = {e.name: part_stderr(model, e) for e in rig.FAMILY if e.name in values}
        return cls(values, stderr, model.stage, (model.scores.get("fits") or {}).get("stage", math.nan))

    def seen_in(self, table: Table) -> Known:
        """With the fastest turns of the record of that time."""
        return replace(self, fastest=(fastest_turn(table["beta"], table.dt), fastest_turn(table["gamma"], table.dt)))

    def beside(self, stage: Stage | None) -> Known:
        """With the limited rates of a record that the record of that time was too slow to show: they are no news."""
        if stage is None:
            return self
        kind, values = self.kind, dict(self.values)
        for axis, now, fastest in zip(AXES, stage.axes, self.fastest, strict=True):
            old = getattr(kind, axis)
            if math.isinf(old.rate_limit) and not now.rate_limit < SLOW_TURN * fastest:
                kind = replace(kind, **{axis: replace(old, rate_limit=now.rate_limit)})
        most = {name: p.high for name, p in rig.rate_limit.parameters.items()}
        values[rig.rate_limit.name] = {axis: min(getattr(kind, axis).rate_limit, most[axis]) for axis in AXES}
        return replace(self, kind=kind, values=values)

    def looseness(self, stage: Stage) -> dict[str, tuple[float, float]]:
        """Play and dead band together of each axis, rad: in a record, and as known.

        They count together, because a little play looks like a little dead band."""
        seen = [axis.backlash + axis.deadband for axis in stage.axes]
        known = [sum(self.values.get(e.name, {}).get(axis, 0.0) for e in PLAY_AND_DEADBAND) for axis in AXES]
        return dict(zip(AXES, zip(seen, known, strict=True), strict=True))

    def axes(self) -> StageModel | None:
        """The axes, in measured tilt; None if only a part of them is known."""
        if "servo_gain" not in self.values or "servo_lag" not in self.values:
            return None
        return StageModel(*(self._axis(axis) for axis in AXES))

    def _axis(self, axis: str) -> StageAxis:
        old, lag = getattr(self.kind, axis), self.values["servo_lag"]
        mean = 0.5 * (self.kind.beta.dead_time + self.kind.gamma.dead_time)  # `command_delay` is that of both axes
        later = self.values.get("command_delay", {}).get("delay", 0.0) - mean
        loose = {effect.name: self.values.get(effect.name, {}).get(axis, 0.0) for effect in PLAY_AND_DEADBAND}
        coupling = self.values.get("axis_coupling", {}).get(COUPLINGS[axis], 0.0)
        moving = {key: lag[f"{axis}_{key}"] for key in ("natural_frequency", "damping")}
        moving |= {"gain": self.values["servo_gain"][axis], "dead_time": max(old.dead_time + later, 0.0)}
        return replace(old, stderr={}, coupling=coupling, **moving, **loose)


def measured(stage: Stage, effect: Effect) -> tuple[dict[str, float], dict[str, float]]:
    """Parameters of an effect of the stage as a record shows them, and their standard errors."""
    values, stderr = {}, {}
    axes = dict(zip(AXES, stage.axes, strict=True))
    for name, place in effect.entry.items():
        _, which, key = place.split(".")
        chosen = list(axes.values()) if which == "*" else [axes[which]]
        values[name] = min(sum(getattr(axis, key) for axis in chosen) / len(chosen), effect.parameters[name].high)
        stderr[name] = math.hypot(*(axis.stderr.get(key, math.inf) for axis in chosen)) / len(chosen)
        if key == "backlash":
            stderr[name] = math.hypot(stderr[name], PLAY_ERROR)
        looked_for = key in ("backlash", "deadband", "coupling", "rate_limit")
        if looked_for and values[name] == effect.parameters[name].default:
            stderr[name] = 0.0  # the fit looked for it and found none
    return values, stderr


def changed(stage: Stage, effect: Effect, known: Known, least: float = 1.0) -> Entry | None:
    """The effect as an entry of the document, if the record surely differs from what is known.

    least: smallest change, in smallest sizes of the effect"""
    values, stderr = measured(stage, effect)
    if effect.name not in known.values and effect.name in ("servo_gain", "servo_lag"):
        return None  # not declared
    had = {name: p.default for name, p in effect.parameters.items()} | (known.values.get(effect.name) or {})
    was = known.stderr.get(effect.name, {})
    for name, p in effect.parameters.items():
        error = was.get(name)
        if effect.name in stage.differs or error is None or not math.isfinite(error):
            error = 0.0  # the motion has changed, however uncertain this number was
        sigma = math.hypot(stderr[name], error)
        sure = SURE * sigma
        if effect is rig.command_delay and all(axis.order == 0 for axis in stage.axes):
            # uniform over a sample, and the same in all records of a rig: a change is one of a whole sample
            errors = [axis.stderr.get("dead_time", math.inf) for axis in stage.axes]
            errors += [axis.stderr.get("dead_time", 0.0) for axis in (known.kind.beta, known.kind.gamma)]
            sure = WHOLE * math.sqrt(12.0) * max(errors)
        if abs(values[name] - had[name]) > max(least * p.smallest, sure):
            return effect_entry(effect, values, stderr, had)
    return None


def moved_zero(stage: Stage | None, known: Known) -> dict[str, float]:
    """Change of the measured tilt at zero command, rad, by axis, if it surely changed; {} otherwise.

    Either the plate leans and the tilt sensor shows it, or the sensor's zero moved: only the ball can tell."""
    if stage is None or stage.servos_overtaxed:
        return {}
    pairs = [(now, getattr(known.kind, axis)) for axis, now in zip(AXES, stage.axes, strict=True)]
    if not all("offset" in was.stderr for _, was in pairs):
        return {}
    moved = {axis: now.offset - was.offset for axis, (now, was) in zip(AXES, pairs, strict=True)}
    errors = [math.hypot(now.stderr.get("offset", math.inf), was.stderr["offset"]) for now, was in pairs]
    sure = any(abs(d) > max(LEAST_ZERO, SURE * error) for d, error in zip(moved.values(), errors, strict=True))
    return moved if sure else {}


def on_known_zero(stage: Stage, known: Known, axes: StageModel) -> StageModel:
    """Axes whose zero is that of the record; if it moved, that of the known axes: a lean that the tilt sensor shows is
    then one of the table, and the ball feels it."""
    if not moved_zero(stage, known):
        return stage.offsets_on(axes)
    return StageModel(*(replace(getattr(axes, axis), offset=getattr(known.kind, axis).offset) for axis in AXES))


def settled_on(stage: Stage | None, record: RingRecord, known: Known) -> Stage | None:
    """The stage with the known numbers, except those of one effect, or of two, that explain the record.

    A fit of all numbers mixes them: a slow axis moves like a faster one that is damped more and starts later. Each
    number by itself is then uncertain, however clear the change of the motion is. So the motion decides whether
    something changed; then one effect at a time is fitted, with the other numbers as they were."""
    was = known.axes()
    if stage is None or was is None or record.u is None or stage.servos_overtaxed:
        return stage
    free, olds, u, angles = (stage.beta, stage.gamma), (was.beta, was.gamma), record.u, (record.beta, record.gamma)
    if any(fit.axis.order == 0 or fit.axis.order != old.order for fit, old in zip(free, olds, strict=True)):
        return stage

    def fitted(names: tuple[str, ...]) -> list[StageFit]:
        keys, out = {key for name in names for key in NUMBERS_OF[name]}, []
        for i, (fit, old) in enumerate(zip(free, olds, strict=True)):
            moved = {key: getattr(fit.axis, key) for key in keys}
            now = fit.axis
            near = replace(old, coupling=now.coupling, offset=now.offset, gain=now.gain, stderr=now.stderr, **moved)
            only = ("gain", "offset", *(key for key in sorted(keys) if key in free_numbers(near)))
            reaching = u[:, i] + fit.axis.coupling * u[:, 1 - i]
            out.append(fit_axis(reaching, angles[i], record.dt, record.begins.astype(float), near, only=only))
        return out

    def unexplained(fits: list[StageFit]) -> bool:
        return any(one.rms > DIFFERENT * max(fit.rms, fit.noise) for one, fit in zip(fits, free, strict=True))

    names, fits = (), fitted(())
    pairs = list(zip(stage.axes, olds, strict=True))
    differing = {key for now, old in pairs for key, value in vars(now).items() if value != getattr(old, key)}
    ways = [name for name, keys in NUMBERS_OF.items() if differing & set(keys)]
    while unexplained(fits):
        tried = {name: fitted((*names, name)) for name in ways if name not in names}
        if not tried or len(names) == MOST_CHANGES:
            return stage
        name, fits = min(tried.items(), key=lambda way: math.hypot(*(fit.rms for fit in way[1])))
        names = (*names, name)
    if not names and all(math.isfinite(now.rate_limit) == math.isfinite(old.rate_limit) for now, old in pairs):
        return stage
    beta, gamma = (
        replace(one, axis=replace(one.axis, stderr={**fit.axis.stderr, **one.axis.stderr}))
        for one, fit in zip(fits, free, strict=True)
    )
    return replace(stage, beta=beta, gamma=gamma, differs=frozenset(names))


def moved_by(stage: Stage | None, known: Known) -> StageModel | None:
    """The stage that moves the plate in a record; None: the measured tilt moves it.

    It is the known one unless the record surely differs: then what it lacks acts in record and reference alike, and
    cancels. An axis that follows at once has its dead time only to a sample; it keeps the known one if it can."""
    if stage is None or stage.servos_overtaxed:
        return None
    was = known.axes()
    if was is None:
        return StageModel(*stage.axes)
    names = {effect.name for effect in (rig.servo_gain, *COMPARED_EFFECTS) if changed(stage, effect, known, least=0.0)}
    old, new = (on_known_zero(stage, known, axes) for axes in (was, StageModel(*stage.axes)))
    if not names:
        return old
    pairs = [(new.beta, old.beta), (new.gamma, old.gamma)]
    if names == {"servo_gain"}:
        return StageModel(*(replace(before, gain=now.gain) for now, before in pairs))
    keep = "command_delay" not in names
    return StageModel(*(
        replace(now, dead_time=before.dead_time) if keep and now.order == before.order == 0 else now
        for now, before in pairs
    ))  # fmt: skip


def stage_effects(stage: Stage | None, known: Known) -> list[Entry]:
    """Effects of the stage that differ from the known ones, except the gain."""
    if stage is None:
        return []
    smallest = {axis: rig.backlash.parameters[axis].smallest for axis in AXES}
    looser = any(abs(now - was) > smallest[axis] for axis, (now, was) in known.looseness(stage).items())
    like = [effect for effect in COMPARED_EFFECTS if effect not in PLAY_AND_DEADBAND or looser]
    found = [made for effect in like if (made := changed(stage, effect, known)) is not None]
    gears = {}
    for made in found:
        if made["name"] in (rig.backlash.name, rig.deadband.name):
            gears[made["name"]] = max(abs(v - made["known_before"][key]) for key, v in values_of(made).items())
    return [made for made in found if gears.get(made["name"], math.inf) > ASIDE * max(gears.values(), default=0.0)]


def changed_gain(stage: Stage | None, known: Known) -> tuple[Entry | None, Entry | None]:
    """A changed gain of the stage, once as the servo's gain and once as the tilt sensor's scale; None if unchanged."""
    if stage is None or (servo := changed(stage, rig.servo_gain, known)) is None:
        return None, None
    had, scale = servo["known_before"], known.values.get("tilt_gain", dict.fromkeys(AXES, 1.0))
    values = {axis: scale[axis] * (value / had[axis]) for axis, value in values_of(servo).items()}
    errors = {axis: servo["parameters"][axis]["stderr"] / had[axis] * scale[axis] for axis in AXES}
    return servo, effect_entry(rig.tilt_gain, values, errors, scale)
