"""`improve`: collect, diagnose, update the model and navigate, in rounds."""

from __future__ import annotations

import tempfile
from collections.abc import Iterable, Mapping
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from mazeplan.core.logs.column_units import parse_columns
from mazeplan.core.logs.table import as_table, several
from mazeplan.core.progress import Advance, Words, no_advance, no_words
from mazeplan.core.results import DocumentResult
from mazeplan.core.whole_file import named_when_whole
from mazeplan.learning.modelfile import RigModel
from mazeplan.maze.geometry import Maze
from mazeplan.physics.registry import own_effects
from mazeplan.rigs.interface import Rig
from mazeplan.rigs.registry import named_rig
from mazeplan.run.campaign import improve as campaign


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
        name = stack.enter_context(named_rig(rig, alone=(workers or 1) == 1))
        own = own_effects(effects)
        options = campaign.Options(rounds, runs, seconds, seed, workers, map, own_process, effects)
        kept = output or stack.enter_context(tempfile.TemporaryDirectory(prefix="mazeplan-improve-"))
        stack.enter_context(named_when_whole(Path(kept)))
        known = [as_table(log, parse_columns(columns)) for log in several(reference)]
        shown: dict[str, Any] = {"tell": tell, "working": progress, "advance": advance}
        done = campaign.improve(
            name, Path(kept), options, model=model, reference=known, own=own, **shown
        )  # fmt: skip
    if output is None:
        for entry in done:
            entry["diagnosis"]["model"] = None
    return Improvement({"rounds": done})
