"""Closes the loop: excite the rig, diagnose it, update the model, navigate with the old and the new model.

The model keeps its kind, and its Gaussian processes stay. They were learned on top of the old effects, mostly at edges
and joints, which have not moved. Only the effect that was found changes: it is one readable entry, and it needs a few
minutes of record instead of 25. (If the verdict is `unknown_effect`, learn the whole model again with `learn`.)
"""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from mazeplan.core.errors import InputError, TableError
from mazeplan.core.logs.table import Table, read_table
from mazeplan.core.progress import Advance, Words, no_advance, no_words, of_total
from mazeplan.core.whole_file import whole_file, whole_folder
from mazeplan.diagnosis.rig.record import FEWEST
from mazeplan.diagnosis.rig.reference import RigReference, known_reference, reference_of, save_reference
from mazeplan.diagnosis.rig.update import kept_in_model, moved_model, reference_after
from mazeplan.diagnosis.rig.verdict import RigVerdict, verdict_on
from mazeplan.diagnosis.rig.words import advice
from mazeplan.learning.modelfile import RigModel, save_model
from mazeplan.maze.geometry import Maze
from mazeplan.maze.mapfile import load_map
from mazeplan.physics.effect import Effect
from mazeplan.rigs.registry import make_rig, rig_label
from mazeplan.rigs.watchdog import watched
from mazeplan.run.campaign.evaluate import evaluate, summary
from mazeplan.run.campaign.one_run import Campaign
from mazeplan.run.campaign.pairs import paired
from mazeplan.run.collect import Collection, run_collection
from mazeplan.run.learn import learn
from mazeplan.run.resolve import model_source, resolve_model

UNSEEN = 90  # pictures more than a diagnosis needs, because the camera misses the ball in some
WORSE = 1.05  # navigation counts as slower if its mean time grows by more than this factor


@dataclass(frozen=True)
class Options:
    """Options of `improve`.

    rounds: number of rounds of collecting and updating
    runs: number of navigations before and after
    seconds: length of the record of a round, s
    seed: of commands, places and noise; navigations have their usual starts, seeded by it
    workers: number of processes; None: the cores for a simulated rig, else 1
    map: name or file of the map, or the map
    own_process: whether the watchdog may end the process
    effects: MODULE:FUNCTION of the user's effects, for the navigations
    """

    rounds: int = 1
    runs: int = 16
    seconds: float = 400.0
    seed: int = 0
    workers: int | None = None
    map: str | Path | Maze = "cme"
    own_process: bool = False
    effects: str | None = None


def improve(
    rig: str,
    folder: Path,
    options: Options,
    *,
    model: str | Path | RigModel | None = None,
    reference: Sequence[Table] = (),
    own: Sequence[Effect] = (),
    tell: Words | None = None,
    working: Words | None = None,
    advance: Advance | None = None,
) -> list[dict[str, Any]]:
    """Do the rounds; returns their documents, as in the JSON of the command.

    Logs, models and reports stay in the folder. An InputError removes the files of its unfinished round.

    model: a name or folder; None: the model that the rig names
    reference: logs of a time when the model was right; empty: what the model's folder keeps of that time
    own: effects to look for beside the packaged ones
    tell: gets findings
    working: gets the step under way
    advance: gets the progress of a record or of the navigations

    Raises InputError, RigError."""
    tell, working, advance = tell or no_words, working or no_words, advance or no_advance
    maze = options.map if isinstance(options.map, Maze) else load_map(options.map)
    check_seconds(options.seconds, make_rig(rig, maze).rate_hz)
    known = resolve_model(model, rig, maze)
    working("what the rig was like")
    path, learned = model, ""
    source = "" if isinstance(model, RigModel) else model_source(model, rig)
    if reference:
        was = reference_of(reference, maze, known)
    elif source is None:
        known, was, learned = _first_model(rig, maze, known, folder / "first", options, tell, working, advance)
    else:
        was = known_reference(source or None, known, maze)
    rounds: list[dict[str, Any]] = []
    before = None
    for number in range(1, options.rounds + 1):
        here = folder / f"round{number}"
        with whole_folder(here):
            tell(f"round {number}: {options.seconds:g} s of record")
            table = _collected(rig, maze, here / "record.mcap", options, 1000 * number, advance)
            done = verdict_on(table, maze, was, working, own=own)
            document: dict[str, Any] = done.document() | {"model": None, "report": None}
            tell(document["sentence"])
            if kept_in_model(done.effects):
                known, was = moved_model(known, done.effects, done.searched.fit, done.zero), reference_after(done)
                document["model"] = _saved(known, was, here / "model")
                document["advice"] = advice(done, document["model"])
            elif learned and number == 1:
                document["model"] = learned
                document["advice"] = [
                    f"Plan with the model that was learned: mazeplan navigate --rig RIG --model {learned}."
                ]
            was = replace(was, imbalance=max(was.imbalance, done.imbalance))  # no news in the next round
            new = document["model"]
            before = before or _navigate(rig, path, options, tell, "before", working, advance)
            after = before if new is None else _navigate(rig, new, options, tell, "after", working, advance)
            document["advice"] += _looked_at(done, before, after)
            runs = {"before": before, "after": after}
            compared = None if new is None else paired(before, after, ("before", "after"), "after").document
            short = {when: {key: part for key, part in n.items() if key != "results"} for when, n in runs.items()}
            rounds.append({"diagnosis": document, "navigation": short, "compared": compared})
            with whole_file(here / "round.json") as beside:
                beside.write_text(json.dumps(rounds[-1], indent=1) + "\n")
        path, before = new or path, after
    return rounds


def _collected(rig: str, maze: Maze, log: Path, options: Options, seed: int, advance: Advance) -> Table:
    """A record of the rig. seed: beside the one of the options"""
    rings = tuple(ring.number for ring in maze.rings if not ring.is_disc)
    plan = Collection(
        options.seconds,
        rings,
        seed + options.seed,
        rig_given=rig,
        map_given=maze.name if isinstance(options.map, Maze) else str(options.map),
    )
    machine = watched(make_rig(rig, maze), own_process=options.own_process)
    collected = of_total(advance, math.ceil(options.seconds))
    run_collection(machine, maze, plan, log, rig_name=rig_label(rig), progress=collected)
    return read_table(log)


def _first_model(
    rig: str, maze: Maze, nominal: RigModel, folder: Path, options: Options, tell: Words, working: Words,
    advance: Advance,
) -> tuple[RigModel, RigReference, str]:  # fmt: skip
    """A model of a rig that has none, from a first record; its reference; and its folder, "" without one.

    The next record is compared with its numbers only: what both records show and the model lacks is to be found."""
    with whole_folder(folder):
        tell(f"the rig has no model: {options.seconds:g} s of record to learn one")
        table = _collected(rig, maze, folder / "record.mcap", options, 0, advance)
        try:
            learned = learn([table], maze, "pi", progress=working)
        except (ValueError, TableError):
            learned = None
        if learned is None or learned.reference is None:
            tell("this record is too short to learn from")
            return nominal, known_reference(None, nominal, maze), ""
        was = replace(learned.reference, table=None)
        return learned.model, was, _saved(learned.model, was, folder / "model")


def check_seconds(seconds: float, rate_hz: float) -> None:
    """Raises InputError if a record of this length would be too short for a diagnosis. Call it before the rig moves."""
    least = math.ceil((FEWEST + UNSEEN) / rate_hz)
    if seconds < least:
        why = f"expected at least {least}: the diagnosis needs {FEWEST} pictures of the ball"
        raise InputError(f"got {seconds:g}, {why}", key="seconds")


def _navigate(
    rig: str,
    model: str | Path | RigModel | None,
    options: Options,
    tell: Words,
    when: str,
    working: Words,
    advance: Advance,
) -> dict[str, Any]:  # fmt: skip
    working(f"navigating {when}")
    how: dict[str, Any] = {"own_process": options.own_process, "effects": options.effects}
    campaign = Campaign(runs=options.runs, rig=rig, map=options.map, model=model, seed=options.seed, **how)
    done = evaluate(campaign, workers=options.workers, progress=of_total(advance, options.runs))
    document = summary(done)
    mean = document["time_s"]["mean"]
    tell(f"{when}: {document['success']} of {options.runs} arrived" + (f", mean {mean:.2f} s" if mean else ""))
    return document


def _saved(known: RigModel, was: RigReference, folder: Path) -> str:
    """Write a model and, beside it, the reference of the rig; returns the folder."""
    path = save_model(known, folder).parent
    if not was.body.open:
        save_reference(was, known, path)
    return str(path)


def _looked_at(done: RigVerdict, before: dict[str, Any], after: dict[str, Any]) -> list[str]:
    """Advice if navigation fails or got slower: what the diagnosis compared, and what to try next; else empty."""
    mean = [n["time_s"]["mean"] for n in (before, after)]
    lost = after["success"] < after["runs"]
    worse = None not in mean and mean[1] > WORSE * mean[0]
    if not lost and not worse and after["success"] >= before["success"]:
        return []
    how = f"{after['success']} of {after['runs']} runs arrived" if lost else "navigation is slower than before"
    found = "nothing that differs was found" if not done.effects else "with what was found"
    return [
        f"But {how}, {found}: servos, tilt sensor, camera, table, friction, ball and floor were compared. "
        "Try a longer record (--seconds 800), a second round (--rounds 2), or learn the model again (mazeplan learn)."
    ]
