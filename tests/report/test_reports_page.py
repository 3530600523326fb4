"""What docs/reports.md says is so, and the documents that tests draw are as the commands print them."""

from __future__ import annotations

import re
from pathlib import Path

from report_documents import comparison, diagnosis, evaluation, evidence

from mazeplan.apps.report import published

DOCS = Path(__file__).resolve().parents[2] / "docs"
PAGE = (DOCS / "reports.md").read_text(encoding="utf-8")


def test_published_figures_and_pictures():
    assert f"{published.ARRIVED} of {published.RUNS}" in PAGE
    for name, time in published.TIMES.items():
        assert f"{name} {time:g} s" in PAGE
    for name in re.findall(r"\]\(([\w-]+\.png)\)", PAGE):
        assert (DOCS / name).stat().st_size < 300_000


def test_documents_of_the_tests_have_the_keys_that_commands_print():
    """What the tests of reports are given has nothing that the commands do not tell."""
    import numpy as np

    from mazeplan.core.records import Failure, FailureKind, NavigationResult, Start
    from mazeplan.learning.ring_scores import RingScores
    from mazeplan.learning.rollout import Windows

    failure = Failure(FailureKind.STUCK, "Track", 1.0, x=0.05, y=0.0)
    told = NavigationResult(True, "arrived", 2.0, 0, "toy", (), (failure,), 0, {}, None, start=Start(1, 0.1)).to_json()
    for run in evaluation()["results"]:
        assert set(run) <= set(told)
        assert all(set(f) <= set(told["failures"][0]) for f in run["failures"])
    windows = Windows(np.zeros(1, dtype=np.int64), "evenly spaced")
    empty = RingScores(1, 0, 0, "smoothed", 0.0, (1, 1), windows, (0.0, 0.0), {}, {}, {}, {},
                       {"sp": {}}).document()  # fmt: skip
    assert set(comparison()["ring1"]) <= {*empty, "residual"}
    assert set(diagnosis()) & set(evidence()) == {"before", "after", "notes"}
