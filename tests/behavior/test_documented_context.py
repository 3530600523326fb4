"""What docs/trees.md says that a leaf finds in its context is there."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from test_leaves import Bench, at

from mazeplan.core.records import Failure, FailureKind

PAGE = Path(__file__).resolve().parents[2] / "docs" / "trees.md"


def documented():
    table = PAGE.read_text(encoding="utf-8").split("| `self.context` has |")[1].split("\n\n")[0]
    cells = [row.split("|")[1] for row in table.splitlines()[2:]]
    return [name for cell in cells for name in re.findall(r"`([a-z_.]+)", cell)]


@pytest.mark.parametrize("name", documented())
def test_a_documented_name_of_the_context_is_there(name):
    found = Bench().run
    state = at()
    found.begin(state.t, state, state)
    for part in name.split("."):
        assert hasattr(found, part), f"{name}: {type(found).__name__} has no {part}"
        found = getattr(found, part)


def test_the_table_was_read():
    assert {"now", "here", "plate.command", "steer", "last_failure", "count", "on_event"} <= set(documented())


def test_failures_are_counted_by_the_name_that_a_leaf_writes():
    run = Bench().run
    run.failed(Failure(FailureKind.STUCK, "Track", 0.5, "standing"))
    assert (run.count("stuck"), run.count(FailureKind.STUCK), run.count("ball_lost")) == (1, 1, 0)
