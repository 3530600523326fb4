"""`improve` closes the loop: excite the rig, diagnose it, update the model, navigate with the old and the new model.

The model keeps its kind, and its Gaussian processes stay. They were learned on top of the old effects, mostly at edges
and joints, which have not moved. Only the effect that was found changes: it is one readable entry, and it needs a few
minutes of record instead of 25. (If the verdict is `unknown_effect`, learn the whole model again with `learn`.)
"""

from __future__ import annotations

import json
import math
import tempfile
from collections.abc import Iterable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from mazeplan.core.errors import InputError, TableError
from mazeplan.core.logs.columns import parse_columns
from mazeplan.core.logs.table import Table, as_table, read_table, several
from mazeplan.core.progress import Advance, Words, no_advance, no_words, of_total
from mazeplan.core.results import DocumentResult
from mazeplan.core.whole_file import whole_file, whole_folder
from mazeplan.diagnosis.rig.record import FEWEST
from mazeplan.diagnosis.rig.reference import RigReference, known_reference, reference_of, save_reference
from mazeplan.diagnosis.rig.verdict import verdict_on
from mazeplan.diagnosis.rig.words import advice
from mazeplan.diagnosis.update import kept_in_model, moved_model, reference_after
from mazeplan.learning.modelfile import RigModel, save_model
from mazeplan.maze.geometry import Maze
from mazeplan.physics.registry import own_effects
from mazeplan.rigs.interface import Rig
from mazeplan.rigs.registry import kept_open, make_rig, rig_label
from mazeplan.rigs.watchdog import watched
from mazeplan.run.campaign.one_run import Campaign
from mazeplan.run.campaign.pairs import paired
from mazeplan.run.collect import Collection, run_collection
from mazeplan.run.commands.evaluate import results_of, summary
from mazeplan.run.commands.learn import learn_model
from mazeplan.run.resolve import model_source, resolve_model

UNSEEN = 90  # pictures more than a diagnosis needs, because the camera misses the ball in some


@dataclass(frozen=True)
class Improvement(DocumentResult):
    """The rounds of `improve --json`: the diagnosis, and the navigations before and after."""

    @property
    def rounds(self) -> list[dict[str, Any]]:
        """The documents of the rounds."""
        return self.document["rounds"]

    def facts(self) -> dict[str, Any]:
        """The sentence of each round, and how many navigations arrived in which time."""
        found: dict[str, Any] = {}
        for number, entry in enumerate(self.rounds, start=1):
            found[f"round {number}"] = entry["diagnosis"]["sentence"]
            for when, done in entry["navigation"].items():
                numbers = {key: done[key] for key in ("runs", "success")}
                found[f"{when} {number}"] = numbers | {"mean": done["time_s"]["mean"]}
        return found


@dataclass(frozen=True)
class Loop:
    """How the rounds are done."""

    rig: str | Rig | type
    folder: Path  # of logs, models and reports
    rounds: int
    seconds: float
    usual: Campaign  # the navigations, whose rig, map, seed and number are those of all rounds
    workers: int | None
    tell: Words
    progress: Words
    advance: Advance

    def collect(self, folder: Path, seed: int) -> Table:
        """A record of the rig. seed: beside that of the navigations"""
        maze = self.usual.maze
        rings = tuple(ring.number for ring in maze.rings if not ring.is_disc)
        plan = Collection(self.seconds, rings, seed + self.usual.seed)
        machine = watched(make_rig(self.rig, maze), own_process=self.usual.own_process)
        shown = of_total(self.advance, math.ceil(self.seconds))
        run_collection(machine, maze, plan, folder / "record.mcap", rig_name=rig_label(self.rig), progress=shown)
        return read_table(folder / "record.mcap")

    def navigate(self, model: str | Path | RigModel | None, when: str) -> dict[str, Any]:
        """The document of the navigations with a model."""
        self.progress(f"navigating {when}")
        campaign = replace(self.usual, model=model)
        document = summary(results_of(campaign, workers=self.workers, progress=of_total(self.advance, campaign.runs)))
        mean = document["time_s"]["mean"]
        arrived = f"{when}: {document['success']} of {campaign.runs} arrived"
        self.tell(arrived + (f", mean {mean:.2f} s" if mean else ""))
        return document


def improve(
    rig: str | Path | Rig | type,
    *,
    model: str | Path | RigModel | None = None,
    rounds: int = 1,
    runs: int = 16,
    seconds: float = 400.0,
    reference: Any = (),
    columns: Iterable[str] | Mapping[str, str] = (),
    effects: str | None = None,
    map: str | Path | Maze = "cme",
    seed: int = 0,
    workers: int | None = None,
    output: str | Path | None = None,
    own_process: bool = False,
    tell: Words = no_words,
    progress: Words = no_words,
    advance: Advance = no_advance,
) -> Improvement:
    """Collect, diagnose, update the model, and navigate with the old and the new model.

    rounds: of these steps; runs: navigations before and after each round
    seconds: length of a record, s of rig time
    reference: logs and tables of the rig while its model was right
    columns: of the reference, as of `mazeplan.learn`
    workers: number of processes for the navigations; None: the cores for a simulated rig, else 1
    output: folder for logs, models and reports; None: nothing is kept
    tell: gets findings; progress: gets the step under way

    Raises InputError, RigError."""
    with ExitStack() as stack:
        rig = stack.enter_context(kept_open(rig, alone=(workers or 1) == 1))
        folder = Path(output or stack.enter_context(tempfile.TemporaryDirectory(prefix="mazeplan-improve-")))
        usual = Campaign(map=map, rig=rig, effects=effects, seed=seed, runs=runs, own_process=own_process)
        known = [as_table(log, parse_columns(columns)) for log in several(reference)]
        done = do_rounds(Loop(rig, folder, rounds, seconds, usual, workers, tell, progress, advance), model, known)
    if output is None:
        for entry in done:
            entry["diagnosis"]["model"] = None
    return Improvement({"rounds": done})


def do_rounds(loop: Loop, model: str | Path | RigModel | None, references: Sequence[Table]) -> list[dict[str, Any]]:
    """Do the rounds; returns their documents. An InputError removes the files of its unfinished round.

    model: a name or folder; None: the model that the rig names
    references: of a time when the model was right; empty: what the model's folder keeps of that time"""
    rig, maze, effects = loop.rig, loop.usual.maze, own_effects(loop.usual.effects)
    least = math.ceil((FEWEST + UNSEEN) / make_rig(rig, maze).rate_hz)
    if loop.seconds < least:
        why = f"expected at least {least}: the diagnosis needs {FEWEST} pictures of the ball"
        raise InputError(f"got {loop.seconds:g}, {why}", key="seconds")
    name = rig if isinstance(rig, str) else None
    known = resolve_model(model, name, maze)
    loop.progress("what the rig was like")
    path, learned, before = model, "", None
    source = "" if isinstance(model, RigModel) else model_source(model, name)
    if references:
        was = reference_of(references, maze, known)
    elif source is None:
        known, was, learned = _first_model(loop, known)
    else:
        was = known_reference(source or None, known, maze)
    rounds: list[dict[str, Any]] = []
    for number in range(1, loop.rounds + 1):
        here = loop.folder / f"round{number}"
        with whole_folder(here):
            loop.tell(f"round {number}: {loop.seconds:g} s of record")
            table = loop.collect(here, 1000 * number)
            done = verdict_on(table, maze, was, loop.progress, own=effects)
            document: dict[str, Any] = done.document() | {"model": None, "report": None}
            loop.tell(document["sentence"])
            if kept_in_model(done.effects):
                known, was = moved_model(known, done.effects, done.searched.fit, done.zero), reference_after(done)
                document["model"] = _saved(known, was, here / "model")
                document["advice"] = advice(done, document["model"])
            elif learned and number == 1:
                how = f"mazeplan navigate --rig RIG --model {learned}"
                document |= {"model": learned, "advice": [f"Plan with the model that was learned: {how}."]}
            was = replace(was, imbalance=max(was.imbalance, done.imbalance))  # no news in the next round
            new = document["model"]
            before = before or loop.navigate(path, "before")
            after = before if new is None else loop.navigate(new, "after")
            runs = {"before": before, "after": after}
            compared = None if new is None else paired(before, after, ("before", "after"), "after").document
            short = {when: {key: part for key, part in n.items() if key != "results"} for when, n in runs.items()}
            rounds.append({"diagnosis": document, "navigation": short, "compared": compared})
            with whole_file(here / "round.json") as beside:
                beside.write_text(json.dumps(rounds[-1], indent=1) + "\n")
        path, before = new or path, after
    return rounds


def _first_model(loop: Loop, nominal: RigModel) -> tuple[RigModel, RigReference, str]:
    """A model of a rig that has none, from a first record; its reference; and its folder, "" without one.

    The next record is compared with its numbers only: what both records show and the model lacks is to be found."""
    folder, maze = loop.folder / "first", loop.usual.maze
    with whole_folder(folder):
        loop.tell(f"the rig has no model: {loop.seconds:g} s of record to learn one")
        table = loop.collect(folder, 0)
        try:
            learned = learn_model([table], maze, "pi", progress=loop.progress)
        except (ValueError, TableError):
            learned = None
        if learned is None or learned.reference is None:
            loop.tell("this record is too short to learn from")
            return nominal, known_reference(None, nominal, maze), ""
        was = replace(learned.reference, table=None)
        return learned.model, was, _saved(learned.model, was, folder / "model")


def _saved(known: RigModel, was: RigReference, folder: Path) -> str:
    path = save_model(known, folder).parent
    if not was.body.open:
        save_reference(was, known, path)
    return str(path)
