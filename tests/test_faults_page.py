"""docs/faults.md: its table is that of the program, and its example is a schedule."""

from __future__ import annotations

import math
import re
from pathlib import Path

from mazeplan.rigs.faults.kinds import KINDS
from mazeplan.rigs.faults.schedule import load_schedule

PAGE = (Path(__file__).resolve().parent.parent / "docs" / "faults.md").read_text(encoding="utf-8")


def told(pair):
    if math.isinf(pair[0]):
        return "for good"
    if pair == (0.0, 0.0):
        return "at once"
    return f"{pair[0]:g}" if pair[0] == pair[1] else f"{pair[0]:g} to {pair[1]:g}"


def test_every_kind_has_its_row():
    rows = re.findall(r"^\| `(\w+)` \| (.*) \|$", PAGE.split("## What the program does")[0], re.MULTILINE)
    assert [name for name, _ in rows] == list(KINDS)
    for name, row in rows:
        kind = KINDS[name]
        size = "" if kind.size is None else f"{told(kind.size)} {kind.unit}"
        survived = "yes" if kind.survivable else f"no: {kind.because}"
        assert row.split(" | ") == [kind.place, kind.what, told(kind.duration_s), size, survived]


def test_the_example_is_a_schedule(tmp_path):
    path = tmp_path / "faults.yaml"
    path.write_text(re.search(r"```yaml\n(.*?)```", PAGE, re.DOTALL).group(1))
    assert [(trial.name, len(trial.entries)) for trial in load_schedule(path)] == [
        ("frames_lost", 1),
        ("tired servos", 2),
    ]
