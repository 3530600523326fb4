"""`score`: how well a model predicts a log."""

from __future__ import annotations

from typing import Any

from mazeplan.apps.cli import options as opt
from mazeplan.apps.cli.model import ModelArgument
from mazeplan.apps.cli.output import print_json, say


def score(model: ModelArgument, logs: opt.Logs, map_: opt.MapOfLog = None, as_json: opt.AsJson = False) -> None:
    """Judge how well a model predicts logs: its error of theta after 40 samples, beside no model and the noise."""
    from mazeplan.apps.cli.log_context import logged_map
    from mazeplan.apps.cli.progress import ProgressBar
    from mazeplan.apps.report.model_score import learned_from, ring_errors, score_document
    from mazeplan.core.logs.table import read_table
    from mazeplan.learning.fits import fits_words
    from mazeplan.learning.modelfile import load_model

    found, maze = load_model(model), logged_map(map_, *logs).maze
    with ProgressBar("scoring") as bar:
        bar.show("reading")
        tables = [read_table(log) for log in logs]
        bar.show("rolling out")
        document = score_document(
            ring_errors(found, tables, maze), model, str(logs[0]), [r.number for r in maze.rings[:-1]]
        )
    document["learned_from"] = learned_from(found, logs)
    document["fits"] = found.scores.get("fits")
    if words := fits_words(found):
        say(words)
    if document["learned_from"]:
        say(f"the model was learned from {', '.join(document['learned_from'])}: on new logs it may be worse")
    if as_json:
        print_json(document)
    else:
        print("\n".join(score_lines(document)))


def score_lines(document: dict[str, Any]) -> list[str]:
    """A table of the rings, and the verdict."""
    from mazeplan.apps.report.words import verdict_lines

    lines = ["mean absolute error of theta after 40 samples, rad", "ring  windows   model  without  noise  verdict"]
    lines += [
        f"{ring:>4s}  {r['windows']:7d}  {r['error']:6.3f}  {r['persistence']:7.3f}  {r['noise']:5.3f}  {r['verdict']}"
        for ring, r in document["rings"].items()
    ]
    return [*lines, *verdict_lines(document)]
