"""Writes one small file of each kind as this mazeplan writes it, for tests/core/test_kept_files.py.

Usage: python tools/keep_files.py [FOLDER]  (default: tests/kept_files/VERSION)

Run it for each release; the folders of earlier versions stay as they are. It takes about three minutes.
"""

from __future__ import annotations

import shutil
import subprocess
import sys
import tempfile
from importlib.metadata import version
from pathlib import Path

from mazeplan.control.estimation.rigid_body_filter import BodyModel
from mazeplan.control.estimation.rigid_body_parameters import with_values
from mazeplan.diagnosis.rig.reference import RigReference
from mazeplan.diagnosis.rig.reference_file import save_reference
from mazeplan.diagnosis.rig.search import Reference
from mazeplan.diagnosis.stage.comparison import Known
from mazeplan.learning.modelfile import KINDS, load_model
from mazeplan.maze.mapfile import dump_map, load_map

ROOT = Path(__file__).resolve().parent.parent
KEPT = ROOT / "tests" / "kept_files"
MOST = 600_000  # bytes of a folder
ANONYMOUS = """\
import platform, socket
platform.platform = platform.node = socket.gethostname = lambda *_, **__: "kept"
from mazeplan.__main__ import main
main()
"""  # logs and stores name the machine
SETTINGS = """\
# How the ball is driven: only what differs from the packaged settings.
travel: {lean_deg: 4.5, planned_choices: 2}
estimator: {lost_after: 0.4}
"""
RIG = """\
# A simulated rig of one's own.
model: models/sp
camera_noise_mm: 0.4
camera_delay_frames: 1
table_x_deg: 0.2
"""
FAULTS = """\
faults:
  - {kind: frames_lost, at_s: [0.3, 1.5], duration_s: 0.8}
  - {kind: servo_slow, size: 10, axis: beta, name: tired servo}
"""


def mazeplan(folder: Path, *arguments: object) -> str:
    """Output of one command in the folder."""
    print("mazeplan", *arguments, file=sys.stderr)
    command = [sys.executable, "-c", ANONYMOUS, *map(str, arguments)]
    done = subprocess.run(command, cwd=folder, stdout=subprocess.PIPE, text=True, check=False)
    if done.returncode:
        raise SystemExit(f"mazeplan {' '.join(map(str, arguments))}: exit status {done.returncode}")
    return done.stdout


def by_hand(folder: Path) -> None:
    """The files that a person writes."""
    (folder / "map.yaml").write_text(dump_map(load_map("detour")))
    for name, text in (("settings", SETTINGS), ("rig", RIG), ("faults", FAULTS)):
        (folder / f"{name}.yaml").write_text(text)
    shutil.copy(ROOT / "behaviors" / "navigate.xml", folder / "tree.xml")
    for name in ("hardware", "emulated"):
        shutil.copy(ROOT / "mazeplan" / "rigs" / f"{name}.yaml", folder / f"{name}.yaml")


def learned(folder: Path, record: Path) -> None:
    """Models of each kind, one that goes on learning, and the reference of a rig."""
    for kind in KINDS:
        mazeplan(folder, "learn", record, "--kind", kind, "--most", "300", "-o", f"models/{kind}")
    mazeplan(folder, "navigate", "--rig", "ideal", "--from", "ring4", "--model", "models/sp", "--learn", "-o", "online")
    (folder / "online" / ".learning.lock").unlink()
    model = load_model(folder / "models" / "sp")
    was = RigReference(
        Reference(with_values(BodyModel(), {"rolling": 0.06}), {"rolling": 0.002}),
        Known.of_model(model),
        0.1,
        1.02,
        "",
        errors={1: 0.01},
    )
    save_reference(was, model, folder / "models" / "sp")


def driven(folder: Path) -> None:
    """Logs, a table, kept runs, and documents of evaluations."""
    short = ("--rig", "ideal", "--from", "ring4", "--seed", "3", "--behavior", "tree.xml")
    log = ("--model", "models/sp", "--memory", "memory.yaml", "--log", "run.mcap")
    mazeplan(folder, "navigate", *short, *log)
    mazeplan(folder, "log", "export", "run.mcap", "-o", "table.csv")
    (folder / "evaluation.json").write_text(
        mazeplan(folder, "evaluate", *short, "--runs", "2", "--store", "store", "--json")
    )
    for lock in (folder / "store").glob(".*.lock"):
        lock.unlink()
    mazeplan(folder, "record", "--rig", "ideal", "--from", "ring4", "--episodes", "1", "-o", "episodes.parquet")


def judged(folder: Path, record: Path) -> None:
    """A comparison of models, the folder of a diagnosis, and the document of a rig that was improved."""
    (folder / "comparison.json").write_text(mazeplan(folder, "compare", record, "--json"))
    mazeplan(folder, "diagnose", record, "--model", "models/p", "-o", "diagnosis")
    (folder / "diagnosis" / "report.html").unlink()  # nothing reads it
    improve = ("improve", "--rig", "surprise@table", "--seconds", "90", "--runs", "1", "--json")
    (folder / "improvement.json").write_text(mazeplan(folder, *improve))


def keep(target: Path) -> None:
    """Write all files into a new folder."""
    with tempfile.TemporaryDirectory() as place:
        folder, record = Path(place) / "kept", Path(place) / "record.mcap"  # logs name absolute paths
        folder.mkdir()
        mazeplan(folder, "collect", "--rig", "toy", "--seconds", "40", "-o", record)
        mazeplan(folder, "collect", "--rig", "toy", "--seconds", "2", "-o", "collected.mcap")
        by_hand(folder)
        learned(folder, record)
        driven(folder)
        judged(folder, record)
        size = sum(path.stat().st_size for path in folder.rglob("*") if path.is_file())
        if size > MOST:
            raise SystemExit(f"{target}: got {size} bytes, expected at most {MOST}")
        shutil.copytree(folder, target)
    print(f"{target}: {size} bytes")


if __name__ == "__main__":
    keep(Path(sys.argv[1]).resolve() if len(sys.argv) > 1 else KEPT / version("mazeplan"))
