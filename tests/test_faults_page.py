"""docs/faults.md: its example is a schedule."""

from __future__ import annotations

import re
from pathlib import Path

from mazeplan.rigs.faults.schedule import load_schedule

PAGE = (Path(__file__).resolve().parent.parent / "docs" / "faults.md").read_text(encoding="utf-8")


def test_the_example_is_a_schedule(tmp_path):
    path = tmp_path / "faults.yaml"
    path.write_text(re.search(r"```yaml\n(.*?)```", PAGE, re.DOTALL).group(1))
    assert [(trial.name, len(trial.entries)) for trial in load_schedule(path)] == [
        ("frames_lost", 1),
        ("tired servos", 2),
    ]
