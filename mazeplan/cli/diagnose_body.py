"""`diagnose --body`: what a record tells of the ball's body."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

from mazeplan.cli.arguments import logged_map
from mazeplan.cli.output import print_json

WORDS = {
    "rolling": "rolling friction", "spin": "friction against spinning", "wall": "friction at walls",
    "restitution": "speed kept by a slow impact", "hold": "grip of the floor in an impact",
    "tilt_beta": "table down at +x", "tilt_gamma": "table up at +y", "offset_x": "camera's middle, x",
    "offset_y": "camera's middle, y", "delay": "camera behind the tilt sensor", "noise": "camera noise",
    "plane": "unexplained, rolling", "strike": "unexplained, at impacts",
}  # fmt: skip
SHOWN = {"rad": (180.0 / math.pi, "deg"), "m": (1e3, "mm"), "s": (1e3, "ms"), "1": (1.0, "")}


def diagnose_body(path: Path, model: str | None, map_: str | None, as_json: bool) -> None:
    """Fit the body, print what was found. Raises TableError, InputError."""
    from mazeplan.cli.progress import Working
    from mazeplan.data.table import read_table
    from mazeplan.diagnosis.bodyrecord import body_seen
    from mazeplan.models.modelfile import load_model

    maze, known = logged_map(map_, path)[0], None if model is None else load_model(model)
    with Working("fitting the ball's body"):
        seen = body_seen(read_table(path), maze, known)
    document: dict[str, Any] = seen.document()
    if as_json:
        print_json(document)
        return
    left = "nothing is left but noise" if seen.white else "something is left that this physics does not explain"
    memory = ", ".join(f"{a:.3f}" for a in document["autocorrelation"])
    print(f"{document['pictures']} pictures; innovations with a memory of {memory} after 1, 2, 3 pictures: {left}")
    for name, number in document["parameters"].items():
        factor, unit = SHOWN.get(number["unit"], (1.0, number["unit"]))
        value, error = factor * number["value"], factor * number["stderr"]
        print(f"  {WORDS.get(name, name):30s} {value:10.4g} +- {error:.2g} {unit}".rstrip())
