"""One verdict from the diagnoses of several rings.

Along a real wall, and along one in MuJoCo, a ball does not move by the equation of a ring to the last digit: it changes
walls, spins, hits the edges of openings. With a long record that is evidence, too, and a diagnosis names the effect
which comes nearest to it. So the rule here is a comparison, and asks for one thing at a time:

1. Evidence of an effect is by how much it alone, or else on top of what was found before it, lowers -2 log L, its price
   taken off; summed over the rings. What has no name counts in the same way.
2. From it goes what the rig's own old log, from when the model was right, gives for the same effect with the same
   model, `CAUTION` times and by as many samples: what the old log shows, too, is no news.
3. The effect with the most news is the verdict, if that is more than `NEWS`; one with fewer parameters that comes
   within `ALIKE` of it goes first. A term without a name wins only by `AHEAD` times and `NEWS`. Effects of the stage
   and of the camera's place are seen without the ball and come by themselves.
4. Everything else waits for the next round, in which the model has what was found in this one.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from mazeplan.diagnosis.candidates import ring_library
from mazeplan.diagnosis.diagnose import Diagnosis
from mazeplan.diagnosis.screening import SURE, Trial
from mazeplan.diagnosis.wording import describe_unknown
from mazeplan.physics.effect import STAGE
from mazeplan.physics.rig import FAMILY

NEWS = 45.0  # of -2 log L, summed over rings
CAUTION = 2.0  # times what the old log shows
ALIKE = 15.0  # of -2 log L
AHEAD = 1.15  # an unnamed term must explain so many times what the best named one does
# seen without the ball
APART = (*(e.name for e in FAMILY if e.acts == STAGE), "camera_offset", "camera_scale", "lens_distortion")


@dataclass(frozen=True)
class Evidence:
    """For each effect by name, or term without one, penalised -2 log L summed over rings; samples it comes from."""

    samples: int
    gains: dict[str, float]

    def document(self) -> dict[str, Any]:
        """As a model file has it among its scores."""
        return {"samples": self.samples, "gains": {name: round(gain, 1) for name, gain in self.gains.items()}}


@dataclass(frozen=True)
class Merged:
    """verdict: as a diagnosis has it; found: ring -> effects, for `update`; news: by name, the most first; alike: names
    that these records cannot tell from the one taken; unknown: what has no name, in words, and what it depends on."""

    verdict: str
    found: dict[int, list[dict[str, Any]]]
    news: dict[str, float]
    alike: tuple[str, ...] = ()
    unknown: dict[str, Any] | None = None

    @property
    def names(self) -> tuple[str, ...]:
        """Names of all effects found."""
        return tuple(dict.fromkeys(e["name"] for effects in self.found.values() for e in effects))


def evidence(diagnoses: Mapping[int, Diagnosis], samples: int) -> Evidence:
    """What the diagnoses of the rings of one log say of each effect."""
    gains: dict[str, float] = {}
    for done in diagnoses.values():
        here = {t.candidate.name: t.gain for t in done.finding.ranked if not t.candidate.placebo and _sized(t)}
        for name, worth in done.finding.worth.items():
            here[name] = max(here.get(name, 0.0), worth)
        for name, gain in here.items():
            gains[name] = gains.get(name, 0.0) + max(gain, 0.0)
    return Evidence(samples, gains)


def _sized(trial: Trial) -> bool:
    """Whether a term that says where, or since when, also says how much: a drift that does not drift is friction."""
    if not trial.candidate.named or not trial.candidate.places:
        return True
    name = trial.candidate.name
    values, stderr = trial.fit.values[name], trial.fit.stderr[name]
    return any(abs(values[p]) > SURE * stderr[p] for p in trial.candidate.parameters if p not in trial.candidate.places)


def merge(diagnoses: Mapping[int, Diagnosis], samples: int, reference: Evidence | None = None) -> Merged:
    """The verdict; samples: of the ball, in all rings; reference: evidence from the rig's old log."""
    now, news = evidence(diagnoses, samples), {}
    for name, gain in now.gains.items():
        known = 0.0 if reference is None else reference.gains.get(name, 0.0) * samples / max(reference.samples, 1)
        news[name] = gain - CAUTION * known
    news = dict(sorted(news.items(), key=lambda entry: -entry[1]))
    apart = _apart(diagnoses)
    counts = {c.name: len(c.parameters) for c in ring_library()}
    named = {name: gain for name, gain in news.items() if name in counts and gain > NEWS}
    best = next(iter(named), None)
    close = [name for name in named if best is not None and named[name] > named[best] - ALIKE]
    chosen = min(close, key=lambda name: counts[name], default=None)  # the first of those with the fewest parameters
    nameless = next((name for name in news if name not in counts), None)
    if nameless is not None and news[nameless] > AHEAD * (named[best] if best else 0.0) + NEWS:
        return Merged("unknown_effect", apart, news, unknown=_unknown(diagnoses, nameless))
    if chosen is None:
        return Merged("effect_found" if any(apart.values()) else "nothing_missing", apart, news)
    found = {ring: [*apart[ring], *_entries(done, chosen)] for ring, done in diagnoses.items()}
    alike = tuple(name for name in close if name != chosen)
    tied = any(counts[name] <= counts[chosen] for name in alike)
    return Merged("ambiguous" if tied else "effect_found", found, news, alike)


def _apart(diagnoses: Mapping[int, Diagnosis]) -> dict[int, list[dict[str, Any]]]:
    """What was seen without the ball, where most of the rings say so."""
    every = [e["name"] for done in diagnoses.values() for e in done.effects if _without_ball(e)]
    kept = {name for name in every if 2 * every.count(name) > len(diagnoses)}
    return {ring: [e for e in done.effects if e["name"] in kept] for ring, done in diagnoses.items()}


def _without_ball(effect: Mapping[str, Any]) -> bool:
    """Whether an effect was seen without the ball; the scale of the tilt sensor is, where commands show it."""
    return effect["name"] in APART or (effect["name"] == "tilt_gain" and "known_before" in effect)


def _entries(done: Diagnosis, name: str) -> list[dict[str, Any]]:
    """The effect as a ring has it: alone, or as found after others; nothing where the ring has no say."""
    trial = next((t for t in done.finding.ranked if t.candidate.name == name and t.gain > 0.0), None)
    if trial is None:
        return [e for e in done.effects if e["name"] == name]
    values, stderr = trial.fit.values[name], trial.fit.stderr[name]
    return [
        {
            "name": name,
            "parameters": {
                p: {"value": values[p], "stderr": stderr[p], "unit": spec.unit}
                for p, spec in trial.candidate.parameters.items()
            },
        }
    ]


def _unknown(diagnoses: Mapping[int, Diagnosis], name: str) -> dict[str, Any]:
    for done in diagnoses.values():
        trial = done.finding.unknown
        if trial is not None and trial.candidate.name == name:
            words = describe_unknown(done.finding)
            return {"depends_on": list(trial.candidate.depends_on), "description": words}
        for trial in done.finding.ranked:
            if trial.candidate.name == name:
                on = trial.candidate.depends_on
                return {"depends_on": list(on), "description": f"a force that depends on {', '.join(on)} ({name})"}
    return {"depends_on": [], "description": name}
