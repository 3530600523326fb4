"""`diagnose` of a whole rig against what it was like when its model was right; `diagnose --body`: of its ball."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mazeplan.cli.arguments import check_folder, logged_map, logged_map_text
from mazeplan.cli.output import print_json, say
from mazeplan.errors import InputError

if TYPE_CHECKING:
    from mazeplan.data.table import Table
    from mazeplan.diagnosis.bodyverdict import BodyVerdict
    from mazeplan.maze.geometry import Maze
    from mazeplan.models.modelfile import RigModel

SHOWN = {"rad": (180.0 / math.pi, "deg"), "m": (1e3, "mm"), "s": (1e3, "ms"), "1": (1.0, "")}


def diagnose_body(path: Path, model: str | None, map_: str | None, output: Path | None, as_json: bool) -> None:
    """Fit the body, print what was found, write the model with it. Raises TableError, InputError."""
    from mazeplan.cli.progress import Working
    from mazeplan.data.table import read_table
    from mazeplan.diagnosis.bodyrecord import body_seen
    from mazeplan.estimation.bodynumbers import with_body
    from mazeplan.models.modelfile import load_model, save_model

    if output is not None:
        if model is None:
            raise InputError("-o with --body: expected --model, the model that the body is written into")
        check_folder("-o", output)
    maze, known = logged_map(map_, path)[0], None if model is None else load_model(model)
    with Working("fitting the ball's body"):
        seen = body_seen(read_table(path), maze, known)
    document: dict[str, Any] = seen.document()
    if output is not None and known is not None:
        learned = with_body(known, seen.fit.model, seen.fit.stderr)
        document["model"] = str(save_model(learned, output / "model").parent)
        say(f"the model with this body, for --model: {document['model']}")
    if as_json:
        print_json(document)
        return
    left = "nothing is left but noise" if seen.white else "something is left that this physics does not explain"
    memory = ", ".join(f"{a:.3f}" for a in document["autocorrelation"])
    print(f"{document['pictures']} pictures; innovations with a memory of {memory} after 1, 2, 3 pictures: {left}")
    for name, number in document["parameters"].items():
        factor, unit = SHOWN.get(number["unit"], (1.0, number["unit"]))
        value, error = factor * number["value"], factor * number["stderr"]
        line = f"  {number['words'] or name:30s} {value:10.4g} +- {error:.2g} {unit}".rstrip()
        print(f"{line}{_beside(number['model'], factor)}")


def diagnose_rig(
    paths: Sequence[Path], tables: Sequence[Table], references: Sequence[Path], model: str | None, map_: str | None,
    test: Path | None, effects: str | None, output: Path | None, as_json: bool,
) -> None:  # fmt: skip
    """What differs from what a rig was like, all rings together. Raises TableError, InputError."""
    from mazeplan.cli.owneffects import installed_effects, own_effects
    from mazeplan.cli.progress import Working
    from mazeplan.data.table import join, read_table
    from mazeplan.diagnosis.bodyreference import reference_of
    from mazeplan.diagnosis.bodyverdict import verdict_on
    from mazeplan.diagnosis.referencefile import known_reference
    from mazeplan.diagnosis.rigevidence import rig_evidence
    from mazeplan.models.modelfile import load_model

    if output is not None:
        check_folder("-o", output)
    maze, known = logged_map(map_, paths[0])[0], None if model is None else load_model(model)
    own = own_effects(effects)
    installed = installed_effects(e.name for e in own)
    own += installed.effects
    for problem in installed.problems.values():
        say(f"mazeplan: not looked for: {problem}")
    with Working("diagnosing") as shown:
        shown.tell("what the rig was like")
        old = [read_table(path) for path in references]
        was = reference_of(old, maze, known) if old else known_reference(model, known, maze)
        further = None if test is None else read_table(test)
        table = tables[0] if len(tables) == 1 else join(tables)
        done = verdict_on(table, maze, was, shown.tell, further, own)
    document: dict[str, Any] = done.document() | {"model": None, "report": None}
    if output is not None:
        title = " and ".join(path.name for path in paths[:2]) + (" and others" if len(paths) > 2 else "")
        evidence = rig_evidence(done, maze, logged_map_text(maze, map_, paths[0]), title)
        _write(done, document, known, maze, output, evidence)
    if as_json:
        print_json(document)
        return
    for line in (document["sentence"], *document["advice"]):
        print(line)
    for note in done.notes:
        print(f"note: {note}")
    for key in ("report", "model"):
        if document[key] is not None:
            print(f"{key}: {document[key]}")


def _write(
    done: BodyVerdict,
    document: dict[str, Any],
    known: RigModel | None,
    maze: Maze,
    output: Path,
    evidence: dict[str, Any],
) -> None:
    """Report, and the model with what was found and the rig as it is now."""
    from mazeplan.diagnosis.bodyupdate import changes_model, moved_model, reference_after
    from mazeplan.diagnosis.bodywords import advice
    from mazeplan.diagnosis.referencefile import save_reference
    from mazeplan.models.modelfile import save_model
    from mazeplan.report.diagnosis import write_diagnosis

    output.mkdir(parents=True, exist_ok=True)
    if known is not None and changes_model(done.effects):
        new = moved_model(known, maze, done.effects, done.searched.fit)
        document["model"] = str(save_model(new, output / "model").parent)
        if not done.was.body.open:
            save_reference(reference_after(done), new, output / "model")
    document["advice"] = advice(done, document["model"])
    document["report"] = str(output / "report.html")
    (output / "report.json").write_text(json.dumps(document, indent=1) + "\n")
    (output / "evidence.json").write_text(json.dumps(evidence) + "\n")
    write_diagnosis(document, evidence, output / "report.html")


def _beside(said: list[float] | None, factor: float) -> str:
    """What the model of beads says, behind what the body says."""
    if said is None:
        return ""
    low, high = (f"{factor * end:.4g}" for end in said)
    return f"   (the model's rings: {low}" + (f" to {high})" if low != high else ")")
