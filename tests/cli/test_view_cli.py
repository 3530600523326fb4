"""`view` of recorded runs: bad input, and its end."""

from __future__ import annotations

import pytest

from mazeplan.core.logs.run_log import RunLogWriter

pytest.importorskip("viser")


def test_logs_that_cannot_be_shown(refused, tmp_path):
    log, other = tmp_path / "run.mcap", tmp_path / "other.mcap"
    with RunLogWriter(log, {}):
        pass
    other.write_text("no log")
    for words, message in (
        ((log,), "run.mcap: holds no tick"),
        ((other,), "other.mcap: got "),
        ((tmp_path / "none.mcap",), "none.mcap: no such file, expected a run log"),
    ):
        assert message in refused("view", *words)
