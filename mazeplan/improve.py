"""Close the loop: excite the rig, diagnose ring by ring, update the model, navigate with the old one and the new one.

The model keeps its kind. What a process adds was learned on top of the old effects, mostly at edges and joints, which
have not moved; an effect that is set on its own is one readable entry, needs a few minutes of record instead of 25, and
leaves everything else as it was. (Learning everything anew, with `learn`, is what remains to be done when the verdict
is `unknown_effect`.)
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from mazeplan.choices import resolve_model
from mazeplan.collect import Collection, run_collection
from mazeplan.data.table import Table, read_table
from mazeplan.diagnosis.candidates import ring_library
from mazeplan.diagnosis.diagnose import SEEN, Diagnosis, diagnose, model_error, model_motion
from mazeplan.diagnosis.merge import Evidence, Merged, evidence, merge
from mazeplan.diagnosis.parts import Known
from mazeplan.diagnosis.picture import camera_effects
from mazeplan.diagnosis.record import Record, centred, record_of
from mazeplan.diagnosis.scores import Score
from mazeplan.diagnosis.update import Parameters, merged, not_planned, updated
from mazeplan.diagnosis.wording import why_not
from mazeplan.errors import ModelError, TableError
from mazeplan.evaluate import Campaign, evaluate, summary
from mazeplan.maze.geometry import Maze
from mazeplan.maze.mapfile import load_map
from mazeplan.models.modelfile import RigModel, save_model
from mazeplan.models.samples import rings_of
from mazeplan.physics.effect import Effect
from mazeplan.progress import Advance, Words, led_by, no_advance, no_words, of_total
from mazeplan.rigs.registry import make_rig, rig_label
from mazeplan.rigs.watchdog import watched

FEWEST = 900  # samples of the ball in a ring, below which it has no say
REFERENCE = "evidence_when_learned"  # in a model's scores


@dataclass(frozen=True)
class Options:
    """rounds of collecting and updating; runs of navigation before and after; seconds of record a round; seed of
    commands, places and noise (navigations: their usual starts, seeded by it); workers: processes; own_process: whether
    the watchdog may end it; effects: MODULE:FUNCTION of a user's own, for the navigations."""

    rounds: int = 1
    runs: int = 16
    seconds: float = 400.0
    seed: int = 0
    workers: int = 1
    map: str = "cme"
    own_process: bool = False
    effects: str | None = None


def improve(
    rig: str,
    folder: Path,
    options: Options,
    *,
    model: str | None = None,
    reference: Evidence | None = None,
    own: Sequence[Effect] = (),
    tell: Words | None = None,
    working: Words | None = None,
    advance: Advance | None = None,
) -> list[dict[str, Any]]:
    """The rounds, as in the JSON of the command; logs, models and reports are left in the folder.

    model: a name or folder (None: the rig's own); reference: from an old log, when the model was right (None: what the
    model's scores say of it); own: effects looked for beside the packaged ones; tell is told what was found, working
    what is being done, advance how far a record or the navigations are. Raises InputError, RigError."""
    tell, working, advance = tell or no_words, working or no_words, advance or no_advance
    maze = load_map(options.map)
    known = resolve_model(model, rig, maze)
    reference = reference_of(known) if reference is None else reference
    rounds: list[dict[str, Any]] = []
    path, before = model, None
    for number in range(1, options.rounds + 1):
        here = folder / f"round{number}"
        here.mkdir(parents=True, exist_ok=True)
        log = here / "record.mcap"
        tell(f"round {number}: {options.seconds:g} s of record")
        rings = tuple(ring.number for ring in maze.rings if not ring.is_disc)
        plan = Collection(options.seconds, rings, 1000 * number + options.seed, rig_given=rig, map_given=options.map)
        machine = watched(make_rig(rig, maze), own_process=options.own_process)
        collected = of_total(advance, math.ceil(options.seconds))
        run_collection(machine, maze, plan, log, rig_name=rig_label(rig), progress=collected)
        document, known = one_round(read_table(log), maze, known, reference, tell, working, own)
        tell(document["sentence"])
        new = None
        if document["effects"]:
            new = str(save_model(known, here / "model").parent)
            document["model"] = new
        before = before or _navigate(rig, path, options, tell, "before", working, advance)
        after = before if new is None else _navigate(rig, new, options, tell, "after", working, advance)
        rounds.append({"diagnosis": document, "navigation": {"before": before, "after": after}})
        (here / "round.json").write_text(json.dumps(rounds[-1], indent=1) + "\n")
        path, before = new or path, after
    return rounds


def _navigate(
    rig: str, model: str | None, options: Options, tell: Words, when: str, working: Words, advance: Advance
) -> dict[str, Any]:
    working(f"navigating {when}")
    how: dict[str, Any] = {"own_process": options.own_process, "effects": options.effects}
    campaign = Campaign(options.runs, rig, options.map, model, seed=options.seed, **how)
    done = evaluate(campaign, workers=options.workers, progress=of_total(advance, options.runs))
    document = summary(done)
    del document["results"]
    mean = document["time_s"]["mean"]
    tell(f"{when}: {document['success']} of {options.runs} arrived" + (f", mean {mean:.2f} s" if mean else ""))
    return document


def one_round(
    table: Table, maze: Maze, model: RigModel, reference: Evidence | None, tell: Words, working: Words = no_words,
    own: Sequence[Effect] = (),
) -> tuple[dict[str, Any], RigModel]:  # fmt: skip
    """What a record says of a model, as the JSON of a diagnosis, and the model with it. Raises TableError when the ball
    is hardly in any ring."""
    records = ring_records(table, maze, model)
    working("camera")
    picture, camera = camera_effects(table, maze, model.camera)
    corrected = ring_records(table, maze, replace(model, camera=camera)) if picture else records
    diagnoses = diagnose_rings(corrected, maze, model, tell, working, camera=picture, own=own)
    verdict = merge(diagnoses, samples_in(corrected), reference)
    new = updated(model, maze, verdict.found, common=True)
    working("model error on what was held out")
    before = _errors(records, maze, model, diagnoses)
    after = _errors(ring_records(table, maze, new), maze, new, diagnoses) if verdict.names else before
    return _document(verdict, diagnoses, before, after), new


def ring_records(table: Table, maze: Maze, model: RigModel) -> dict[int, Record]:
    """A record of each ring in which the ball was for long enough, positions as the model's camera has them. Raises
    TableError when there is none."""
    table = centred(table, model.camera)
    numbers, out = rings_of(table, maze), {}
    for ring in maze.rings:
        rows = numbers == ring.number
        if not ring.is_disc and int(rows.sum()) >= FEWEST:
            out[ring.number] = record_of(table, rows)
    if not out:
        most = max(int((numbers == ring.number).sum()) for ring in maze.rings)
        got = f"{most * table.dt:.0f} s of the ball in one ring at the most"
        problem = f"got {got}, expected {FEWEST * table.dt:.0f} s; record more (--seconds)"
        raise TableError(problem, file=table.source.get("file"))
    return out


def samples_in(records: Mapping[int, Record]) -> int:
    """Samples of the ball in all of them."""
    return sum(int(np.isfinite(record.theta).sum()) for record in records.values())


def diagnose_rings(
    records: Mapping[int, Record], maze: Maze, model: RigModel, tell: Words, working: Words = no_words,
    camera: Sequence[dict[str, Any]] | None = None, own: Sequence[Effect] = (),
) -> dict[int, Diagnosis]:  # fmt: skip
    """The diagnosis of each ring with what the model says of it, by effects that a plan can use: of others, however
    true, navigation would not become better. camera: what was found of it in all rings together; own: effects beside
    the packaged ones."""
    out, without = {}, not_planned(c.name for c in ring_library())
    more = [effect for effect in own if effect.planned]
    for ring, record in records.items():
        words = led_by(f"ring {ring}: ", working)
        done = diagnose(
            record, maze.track_radius(ring), model.declared(ring), without=without, progress=words,
            known=Known.of_model(model), camera=camera, more=more,
        )  # fmt: skip
        tell(f"ring {ring}: {done.sentence()}")
        out[ring] = done
    return out


def reference_evidence(table: Table, maze: Maze, model: RigModel, tell: Words, working: Words = no_words) -> Evidence:
    """What a log of the rig from when its model was right gives for each effect."""
    records = ring_records(table, maze, model)
    return evidence(diagnose_rings(records, maze, model, tell, working), samples_in(records))


def reference_of(model: RigModel) -> Evidence | None:
    """The evidence that the model's file keeps of its own old log. Raises ModelError where it cannot be read."""
    kept = model.scores.get(REFERENCE)
    if kept is None:
        return None
    try:
        return Evidence(int(kept["samples"]), {str(name): float(gain) for name, gain in kept["gains"].items()})
    except (TypeError, ValueError, KeyError, AttributeError):
        raise ModelError("expected {samples: N, gains: {EFFECT: NUMBER}}", key=f"scores.{REFERENCE}") from None


def _errors(records: Mapping[int, Record], maze: Maze, model: RigModel, diagnoses: Mapping[int, Diagnosis]) -> Score:
    """Scores of all rings together, weighted by their samples."""
    scores = {}
    for ring, record in records.items():
        if ring in diagnoses:
            motion = model_motion(record, diagnoses[ring].stage, Known.of_model(model))
            scores[ring] = model_error(record, maze.track_radius(ring), model.declared(ring), motion)
    weights = {ring: float(np.isfinite(record.theta).sum()) for ring, record in records.items()}

    def mean(name: str) -> float:
        pairs = [(getattr(scores[ring], name), weights[ring]) for ring in scores]
        pairs = [(value, weight) for value, weight in pairs if np.isfinite(value)]
        return sum(v * w for v, w in pairs) / sum(w for _, w in pairs) if pairs else float("nan")

    figures = (mean(name) for name in ("nrmse", "rollout20", "rollout40", "floor"))
    return Score(*figures, windows=sum(score.windows for score in scores.values()))


def _document(verdict: Merged, diagnoses: Mapping[int, Diagnosis], before: Score, after: Score) -> dict[str, Any]:
    """As `diagnose --json`, for all rings at once."""
    effects = [
        {
            "name": name, "parameters": _plain(merged(found, name)), "rings": sorted(found),
            "before": before.document()["rollout40"], "after": after.document()["rollout40"],
            "planned": not why_not(name),
        }
        for name, found in _places(verdict)
    ]  # fmt: skip
    return {
        "verdict": verdict.verdict,
        "sentence": _sentence(verdict, before, after),
        "effects": effects,
        "ambiguous_with": [[*verdict.names[-1:], *verdict.alike]] if verdict.alike else [],
        "unknown": verdict.unknown,
        "before": before.document(),
        "after": after.document(),
        "noise_floor": round(after.floor, 5) if np.isfinite(after.floor) else None,
        "held_out": round(1.0 - SEEN, 3),
        "notes": sorted({note for done in diagnoses.values() for note in done.notes}),
        "news": {name: round(gain, 1) for name, gain in verdict.news.items()},
        "model": None,
        "report": None,
    }


def _places(verdict: Merged) -> list[tuple[str, dict[int, list[dict[str, Any]]]]]:
    """What was found by name and rings: of a place in a ring each by itself, else all rings together."""
    out: list[tuple[str, dict[int, list[dict[str, Any]]]]] = []
    for name in verdict.names:
        here = {ring: found for ring, found in verdict.found.items() if any(e["name"] == name for e in found)}
        apart = name in ("surface_bump", "surface_profile", "gate_loss")
        out += [(name, {ring: found}) for ring, found in here.items()] if apart else [(name, here)]
    return out


def _plain(parameters: Parameters) -> Parameters:
    """Without infinite errors, which JSON has no words for."""
    return {
        name: {**number, "stderr": number["stderr"] if np.isfinite(number["stderr"]) else None}
        for name, number in parameters.items()
    }


def _sentence(verdict: Merged, before: Score, after: Score) -> str:
    change = f"40-step error {before.rollout40:.4f} -> {after.rollout40:.4f} rad"
    parts = []
    for name, found in _places(verdict):
        numbers = merged(found, name).items()
        values = ", ".join(f"{p} {n['value']:.4g} +- {n['stderr']:.2g} {n['unit']}".strip() for p, n in numbers)
        rings = ", ".join(str(ring) for ring in sorted(found))
        parts.append(f"{name.replace('_', ' ')} ({values}; seen in ring {rings})")
    if verdict.unknown is not None:
        also = f" besides {', '.join(parts)}" if parts else ""
        return f"Something is there that has no name{also}: {verdict.unknown['description']}; {change}."
    if not parts:
        return f"Nothing is missing: 40-step error {before.rollout40:.4f} rad."
    return f"The model lacks {', '.join(parts)}: {change}."
