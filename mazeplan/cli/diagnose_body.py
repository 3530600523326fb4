"""`diagnose --body`: what a record tells of the ball's body; `diagnose --reference`: what differs from another one."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

from mazeplan.cli.arguments import check_folder, logged_map
from mazeplan.cli.output import print_json, say
from mazeplan.errors import InputError

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


def diagnose_against(
    path: Path, reference: Path, model: str | None, map_: str | None, output: Path | None, as_json: bool
) -> None:
    """What differs from a reference, all rings together. Raises TableError, InputError."""
    from mazeplan.cli.progress import Working
    from mazeplan.data.table import read_table
    from mazeplan.diagnosis.bodyupdate import moved_model
    from mazeplan.diagnosis.bodyverdict import reference_of, verdict_on
    from mazeplan.models.modelfile import load_model, save_model

    if output is not None:
        check_folder("-o", output)
    maze, known = logged_map(map_, path)[0], None if model is None else load_model(model)
    with Working("diagnosing") as shown:
        shown.tell("the reference")
        was = reference_of(read_table(reference), maze, known)
        done = verdict_on(read_table(path), maze, was, shown.tell)
    document = done.document()
    document |= {"model": None, "report": None}
    if output is not None:
        output.mkdir(parents=True, exist_ok=True)
        if known is not None and done.effects:
            new = moved_model(known, maze, done.effects, done.searched.fit)
            document["model"] = str(save_model(new, output / "model").parent)
        (output / "report.json").write_text(json.dumps(document, indent=1) + "\n")
    if as_json:
        print_json(document)
        return
    for line in done.sentences():
        print(line)
    if document["model"] is not None:
        print(f"model with it: {document['model']}")


def _beside(said: list[float] | None, factor: float) -> str:
    """What the model says of the same."""
    if said is None:
        return ""
    low, high = (f"{factor * end:.4g}" for end in said)
    return f" (model: {low})" if low == high else f" (model: {low} to {high})"
