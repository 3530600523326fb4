"""Writes what the packaged rigs are like beside their models (mazeplan/learning/packaged/*/reference.yaml).

Records have a seed of their own. Usage: python tools/keep_references.py [NAME ...]
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

from mazeplan.core.logs.table import read_table
from mazeplan.diagnosis.rig.reference import reference_of, reference_path, save_reference
from mazeplan.learning.modelfile import load_model
from mazeplan.maze.mapfile import load_map
from mazeplan.rigs.registry import make_rig
from mazeplan.run.collect import Collection, run_collection

SECONDS, SEED, RINGS = 600.0, 7001, (1, 2, 3, 4)


def keep(name: str, folder: Path) -> Path:
    """Record a rig for ten minutes, and write what its record tells."""
    maze, model, log = load_map("cme"), load_model(name), folder / f"{name}.mcap"
    plan = Collection(SECONDS, RINGS, SEED)
    run_collection(make_rig(name, maze), maze, plan, log, rig_name=name)
    return save_reference(reference_of([read_table(log)], maze, model), model, reference_path(name).parent)


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as place:
        for rig in sys.argv[1:] or ("toy", "rough", "ideal"):
            print(keep(rig, Path(place)))
