"""docs/trees.md says what is so: its example runs, its leaf winds down, its table is that of the tree."""

from __future__ import annotations

import math
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
from pages import blocks

from mazeplan.core import resources
from mazeplan.core.errors import TreeError

ROOT = Path(__file__).resolve().parent.parent
PAGE = (ROOT / "docs" / "trees.md").read_text(encoding="utf-8")
GOALS, ROLL, _NODES = (b.text for b in blocks("docs/trees.md") if b.kind == "python" and b.file is None)


@pytest.mark.slow
def test_the_example_of_a_new_goal_runs(tmp_path):
    done = subprocess.run(
        [sys.executable, "-c", GOALS],
        cwd=tmp_path, capture_output=True, text=True, timeout=120, check=False,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    said = re.fullmatch(r"arrived \[\(5, 0\.0\), \(2, ([\d.]+)\)\]\n", done.stdout)
    assert said is not None, done.stdout  # the goal did change, on the way
    assert float(said.group(1)) > 0.5


def test_the_leaf_of_ones_own_rolls_the_ball_and_says_why_it_fails(tmp_path, monkeypatch):
    from mazeplan.apps.testing import run_tree

    monkeypatch.chdir(tmp_path)
    (tmp_path / "rolling_of_the_page.py").write_text(ROLL, encoding="utf-8")
    tree = '<root BTCPP_format="4"><BehaviorTree ID="Main"><RollTo angle_deg="60" pull="{}"/></BehaviorTree></root>'
    times = []
    for pull in ("weak", "strong"):
        record = run_tree(tree.format(pull), goal=1, behavior_modules=("rolling_of_the_page",)).ends_with("arrived")
        times.append(record.ticks[-1].t)
        assert abs(math.degrees(record.ticks[-1].theta) - 60.0) < 8.0
    assert times[1] != times[0]
    held = {"mishap": lambda rig: setattr(rig, "glued", True), "goal": 1}
    record = run_tree(tree.format("weak"), **held, behavior_modules=("rolling_of_the_page",))
    assert record.ends_with("stuck").result.failures[-1].where == "RollTo"
    with pytest.raises(TreeError, match="pull: got 'harder', expected one of weak, strong"):
        run_tree(tree.format("harder"), goal=1, behavior_modules=("rolling_of_the_page",))


def test_the_page_names_what_a_context_has():
    from mazeplan.behavior.context import RunContext

    table = PAGE[PAGE.index("| `self.context` has |") : PAGE.index("- **Ports**")]
    firsts = [line.split("|")[1] for line in table.splitlines()[2:] if line]
    names = re.findall(r"`(\w+)", " ".join(firsts))
    assert len(names) == 12
    for name in names:
        assert hasattr(RunContext, name) or name in RunContext.__dataclass_fields__, name


def test_the_table_of_budgets_is_that_of_the_packaged_tree():
    text = (resources.share("behaviors") / "navigate.xml").read_text(encoding="utf-8")
    in_tree = [
        (set(kinds.split(";")), int(most))
        for kinds, most in re.findall(r'FailureIs kinds="([^"]*)" at_most="(\d+)"', text)
    ]
    rows = re.findall(r"^\| (`.*`) \| [^|]* \| (\d+) \|$", PAGE, re.MULTILINE)
    assert [(set(re.findall(r"`(\w+)`", kinds)), int(most)) for kinds, most in rows] == in_tree
    total = re.search(r'num_attempts="(\d+)"', text)
    assert total is not None
    assert f"| all | attempts | {total.group(1)} |" in PAGE
