"""From a record and a system to a verdict."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from mazeplan.core.progress import Words, no_words
from mazeplan.core.records import Array
from mazeplan.diagnosis.document import Entry, Values, effect_entry, lacking, residual_means, rounded, size_words
from mazeplan.diagnosis.engine.judge import LOST, WITHIN_A_SAMPLE, Trial, least_left
from mazeplan.diagnosis.engine.model import Model, divide, scales, thinned
from mazeplan.diagnosis.engine.record import Record, least_noise, noise_of
from mazeplan.diagnosis.engine.search import Finding, Search
from mazeplan.diagnosis.engine.system import System
from mazeplan.diagnosis.engine.windows import Fit, Windows

MOST_ROWS = 9000  # of a record that are simulated; of a cart at 1 kHz, half as many gave 15 % more friction
NOISE_LEFT = 1.5  # times the noise: more than this remains to be explained
DIVERGED = 10.0  # error over the movement from which on there is no number in the document
BELOW = 0.8  # times the noise: what leaves less shows that the noise was taken for too large
QUIETER = 3  # searches with less noise, at most
HELD_GAIN = 0.2  # of a delay shorter than a sample, from which inputs may be held
OPEN = 0.5  # standard error over the size of a parameter that the record leaves open


@dataclass(frozen=True)
class MotionScore:
    """Errors of a model on a record."""

    nrmse: float  # error of the held-out windows over the movement in them
    free_run: float  # rms error of one simulation from the first sample to the last one; NaN if it leaves the record
    window: float  # length of the windows, s
    seconds: float  # length of the record, s
    unit: str
    forces: bool = False  # whether `nrmse` is a relative error of the force instead

    def labels(self) -> dict[str, str]:
        """Words with the unit for each error."""
        error = f"position error in windows of {self.window:.2g} s, over the movement in them"
        return {
            "nrmse": "relative force error ||e|| / ||y||" if self.forces else error,
            "free_run": f"position error of the free run (root mean square), {self.unit}",
        }

    def document(self) -> dict[str, float | None]:
        """The errors, rounded; None where the simulation leaves the record."""
        nrmse = self.nrmse if self.nrmse < DIVERGED else math.nan
        return {"nrmse": rounded(nrmse, 6), "free_run": rounded(self.free_run, 6)}

    def both(self, *after: MotionScore) -> str:
        """These errors, and those after the effects were found, in words."""
        error = "force error" if self.forces else f"error in windows of {self.window:.2g} s"
        times, unit = (1e3, "mm") if self.unit == "m" else (1.0, self.unit)
        sizes, runs = [], []
        for s in (self, *after):
            sizes.append(f"{s.nrmse:.2%}" if s.nrmse < 1.0 else "beyond the movement itself")
            off = f"{times * s.free_run:.3g} {unit} off"
            runs.append(off if math.isfinite(s.free_run) else "(the simulation leaves the record)")
        return f"{error} {' -> '.join(sizes)}, {self.seconds:.3g} s of free run {' -> '.join(runs)}"


@dataclass(frozen=True)
class MotionDiagnosis:
    """What was found in a record."""

    verdict: str  # nothing_missing, effect_found, ambiguous or unknown_effect
    effects: tuple[Entry, ...]  # entries of the document
    fitted: tuple[Entry, ...]  # entries of what is known to exist and was fitted
    finding: Finding
    before: MotionScore  # without what was found
    after: MotionScore  # and with it
    remaining: float  # error that is left in the held-out windows, in times the noise
    unknown: dict[str, Any] | None  # what an effect without a name is like
    notes: tuple[str, ...]
    evidence: tuple[dict[str, Any], dict[str, Any]]  # residuals before and after (`residual_means`)
    noise_floor: float
    fits: tuple[Fit, Fit]  # before and after
    without: dict[str, Fit]  # fits without one of the effects
    test: tuple[MotionScore, MotionScore] | None = None  # before and after on a further record

    def document(self) -> dict[str, Any]:
        """The JSON document."""
        out: dict[str, Any] = {
            "verdict": self.verdict, "sentence": self.sentence(), "effects": list(self.effects),
            "fitted": list(self.fitted), "ambiguous_with": [list(group) for group in self.finding.alike],
            "unknown": self.unknown, "before": self.before.document(), "after": self.after.document(),
            "noise_floor": rounded(self.noise_floor, 6), "held_out": 0.5, "remaining": rounded(self.remaining, 3),
            "fits": {"reference": None, "record": rounded(self.remaining, 3)},
            "tried": [{"name": n, "gain": rounded(g, 2), "why_not": why} for n, (g, why) in self.finding.tried.items()],
            "notes": list(self.notes),
        }  # fmt: skip
        if self.test is not None:
            before, after = self.test
            out["test"] = {"before": before.document(), "after": after.document()}
        return out

    def evidence_document(self, title: str, notes: Sequence[str]) -> dict[str, Any]:
        """What a report draws beside the document (`evidence.json`). notes: those of the document"""
        found = [{"name": e["name"], "gain": e["evidence"]} for e in self.effects]
        tried = [{"name": name, "gain": round(gain, 2)} for name, (gain, _) in self.finding.tried.items()]
        unit = self.after.unit
        return {
            "title": title, "notes": list(notes), "labels": self.after.labels(),
            "axes": [f"position, {unit}", f"speed, {unit}/s"], "candidates": [*found, *tried],
            "before": self.evidence[0], "after": self.evidence[1],
        }  # fmt: skip

    def sentence(self) -> str:
        """The finding in one sentence."""
        left = f"{self.remaining:.3g} times the noise remains" if math.isfinite(self.remaining) else "all remains"
        if self.verdict == "nothing_missing":
            return f"Nothing is missing: {self.before.both()}."
        names = ", ".join(map(_words, self.effects))
        change = self.before.both(self.after) if self.effects else self.after.both()
        description = (self.unknown or {}).get("description", "")
        return lacking(self.verdict, names, description, self.finding.alike, f"{change}; {left}")


def _words(effect: Entry) -> str:
    """An effect with its sizes, in words."""
    sizes = []
    for name, p in effect["parameters"].items():
        sizes.append(f"{name} {size_words(p) if p.get('determined', True) else 'not determined'}")
    where = f" of {effect['on']}" if "on" in effect else ""
    return f"{effect['name'].replace('_', ' ')}{where} ({', '.join(sizes)})"


def diagnose_motion(
    system: System, record: Record, known: Values, along: Sequence[str] = (), *, test: Record | None = None,
    progress: Words = no_words,
) -> MotionDiagnosis:  # fmt: skip
    """Find what the known motion lacks.

    known: effects with values; of the motion, parameters that are not known are fitted
    along: effects that exist and are fitted; test: a further record, for scores only"""
    model, search = _prepared(system, record, known, along, progress)
    finding = search.run()
    for _ in range(QUIETER):
        noise = np.maximum(model.noise * least_left(finding.levels, finding.final), least_noise(model.record))
        if (noise > BELOW * model.noise).all():
            break
        model, search = _prepared(system, record, known, along, progress, noise)
        finding = search.run()
    progress("scores")
    level = _judged(search, finding)
    base, final = (_whole(search, trial, level) for trial in (finding.base, finding.final))
    places = [system.positions.index(system.on[name]) for name in finding.found if name in system.on]
    shown = (*places, 0)[0]  # the coordinate of the free run
    seconds, unit = (search.levels[level].seconds, model.record.seconds), system.units[shown]
    before, after = (
        MotionScore(_relative(search, trial, level), free_run(model, fit.values, shown), *seconds, unit)
        for trial, fit in ((finding.base, base), (finding.final, final))
    )
    remaining = max([finding.final.rms(level), *(finding.final.usual(i) for i in finding.valid)])
    without = {
        name: search.trial(tuple(n for n in finding.found if n != name), finding.final) for name in finding.found
    }
    lost = {name: _whole(search, trial, level) for name, trial in without.items()}
    effects = tuple(
        _entry(search, finding, final, name)
        | {"before": rounded(_relative(search, without[name], level), 6), "after": rounded(after.nrmse, 6)}
        for name in finding.found
    )
    free = {effect for effect, _ in final.free}
    fitted = tuple(_entry(search, finding, final, name) for name in search.always if name in free)
    loose = [f"{e['name']}.{n}" for e in fitted for n, p in e["parameters"].items() if not p.get("determined", True)]
    unknown = None if effects else _unknown(finding, remaining, loose)
    verdict = "unknown_effect" if unknown else "nothing_missing"
    if effects:
        verdict = "ambiguous" if finding.alike else "effect_found"
    floor = math.sqrt(float(np.sum(finding.base.count[level])) / max(float(np.sum(search.levels[level].movement)), 1.0))
    return MotionDiagnosis(
        verdict, effects, fitted, finding, before, after, remaining, unknown,
        _notes(search, finding, final, remaining, loose), (_evidence(model, base), _evidence(model, final)),
        floor, (base, final), lost, None if test is None else _tested(search, (base, final), test),
    )  # fmt: skip


def _prepared(
    system: System, record: Record, known: Values, along: Sequence[str], tell: Words, noise: Array | None = None,
) -> tuple[Model, Search]:  # fmt: skip
    """The model of a record, with steps that are fine enough, and the search. noise: (C,), None: that of the record"""
    held = np.array([name in system.held for name in system.inputs], dtype=bool)
    record = thinned(record, MOST_ROWS, held)
    noise = noise_of(record) if noise is None else noise
    model = Model(system, record, noise, scales(system, record, noise))
    search = Search(model, known, along, tell)
    divide(model, search.values(search.always), search.levels[0].folds[0].windows)
    return model, search


def _judged(search: Search, finding: Finding) -> int:
    """The level whose numbers are reported: where what was found is clearest, else the longest windows that stay."""
    valid = finding.valid or (0,)
    if not finding.found:
        return valid[-1]
    return max(valid, key=lambda i: min(search.judge.clear(finding.final, name, i) for name in finding.found))


def _whole(search: Search, trial: Trial, level: int) -> Fit:
    """The model fitted to all windows of a level."""
    one, two = trial.fits[level]
    rows = np.concatenate([fold.windows for fold in search.levels[level].folds])
    order = np.argsort(rows[:, 0])
    windows = Windows(search.model, rows[order])
    return windows.fit(one.values, one.free, np.concatenate([one.states, two.states])[order])


def _relative(search: Search, trial: Trial, level: int) -> float:
    """Error of the held-out windows over the movement in them."""
    movement = max(float(np.sum(search.levels[level].movement)), 1e-300)
    return math.sqrt(float(np.sum(trial.held[level])) / movement)


def free_run(model: Model, values: Values, coordinate: int = 0) -> float:
    """Rms error of a coordinate over the whole record (each stretch), NaN if the simulation leaves it."""
    record = model.record
    windows = Windows(model, np.array(record.stretches, dtype=np.int64))
    r = windows.residual(values, windows.grown(values))
    own = windows.coordinate == coordinate
    off = float(np.sqrt(np.mean((r[own] * model.noise[coordinate]) ** 2)))
    y = record.y[:, coordinate]
    return off if off < LOST * float(np.nanstd(y)) else math.nan


def _entry(search: Search, finding: Finding, fit: Fit, name: str) -> Entry:
    """An effect with its numbers; with `determined` false where the record leaves a number open."""
    system, effect = search.model.system, search.model.effects[name]
    free = [n for n in effect.parameters if (name, n) in fit.free]
    error = {n: fit.stderr(name, n) for n in free}
    entry = effect_entry(effect, {n: fit.values[name][n] for n in free}, dict(error))
    if name in system.on:
        entry["name"], entry["on"] = name.removesuffix(f"_{system.on[name]}"), system.on[name]
    for n in free:
        p, value = effect.parameters[n], fit.values[name][n]
        width = min(p.high - p.low, abs(value) / OPEN if name == system.motion.name else math.inf)
        if (name, n) in fit.at_bound or not error[n] < max(width, 1e-300):
            entry["parameters"][n] |= {"determined": False} | ({"stderr": None} if (name, n) in fit.at_bound else {})
    if name in finding.found:
        entry["evidence"] = rounded(finding.gains.get(name, math.nan), 3)
    return entry


def _unknown(finding: Finding, remaining: float, loose: Sequence[str]) -> dict[str, Any] | None:
    """What is known about an effect without a name; None if nothing is missing."""
    if not finding.valid:
        text = "the simulation leaves the record with every effect that was tried"
    elif not remaining < NOISE_LEFT:
        text = "an error that no effect of the list explains"
    elif loose:
        text = f"the record leaves {', '.join(loose)} open"
    else:
        return None
    return {"depends_on": [], "description": text}


def _notes(search: Search, finding: Finding, final: Fit, remaining: float, loose: Sequence[str]) -> tuple[str, ...]:
    """What a reader of the numbers should know."""
    out = list(search.model.record.notes)
    for effect, n in final.at_bound:
        p, value = search.model.effects[effect].parameters[n], final.values[effect][n]
        out.append(f"{effect}.{n} stands at its bound ({value:g} of {p.low:g} to {p.high:g} {p.unit}): not determined")
    bounds = {f"{e}.{n}" for e, n in final.at_bound}
    if open_ := [name for name in loose if name not in bounds]:
        out.append(f"the record leaves {', '.join(open_)} open: the standard error is as large as the number")
    if finding.found and remaining > NOISE_LEFT:
        out.append(f"{remaining:.2g} times the noise remains: further causes have no name here")
    if len(finding.valid) < len(finding.levels):
        lost = [level.seconds for i, level in enumerate(finding.levels) if i not in finding.valid]
        out.append(f"in windows of {', '.join(f'{s:.2g}' for s in lost)} s the simulation leaves the record")
    if (
        any(why == WITHIN_A_SAMPLE and gain > HELD_GAIN for gain, why in finding.tried.values())
        and remaining > NOISE_LEFT
    ):
        names = ", ".join(f'"{name}"' for name in search.model.system.inputs)
        later = "the inputs act later by a part of a sample: if each keeps its value until the next sample"
        out.append(f"{later}, say so in the class, as held = ({names},)")
    return tuple(out)


def _evidence(model: Model, fit: Fit) -> dict[str, Any]:
    """The residual of a fit, with position, speed and time."""
    y = model.record.y[:, 0]
    seen = np.flatnonzero(np.isfinite(y))
    filled: Array = np.interp(np.arange(len(y)), seen, y[seen])
    return residual_means(fit.residual[:, 0], filled, np.gradient(filled, model.record.t), model.record.t)


def _tested(search: Search, fits: tuple[Fit, Fit], test: Record) -> tuple[MotionScore, MotionScore]:
    """Scores of both fits on a further record."""
    model, other = _prepared(search.model.system, test, search.known, (), no_words)
    level = other.levels[max(len(other.levels) - 2, 0)]
    out = []
    for fit in fits:
        cost = float(sum(fold.held_out(fit.values).total for fold in level.folds))
        nrmse = math.sqrt(cost / max(float(np.sum(level.movement)), 1e-300))
        run = free_run(model, fit.values)
        out.append(MotionScore(nrmse, run, level.seconds, test.seconds, model.system.units[0]))
    return out[0], out[1]
