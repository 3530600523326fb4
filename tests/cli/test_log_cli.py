"""`log info` and `log export`."""

from __future__ import annotations

import csv
import io
import json
import math
import re
import signal
import subprocess
import sys
from functools import partial

import pytest
from mcap.reader import make_reader

from mazeplan.core.events import FailureReported, OpeningPassed, RecoveryChosen, RingEntered
from mazeplan.core.logs.run_log import CHUNK_S, RunLogWriter
from mazeplan.core.records import Command, Observation, State

STATE = State(0.0, 0.08, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, ring=2)


@pytest.fixture
def run(call):
    return partial(call, "log")


@pytest.fixture
def log(tmp_path):
    """Three seconds: ring 1 for one second, then ring 2; one failure; the ball is not seen in every tenth sample."""
    path = tmp_path / "run.mcap"
    with RunLogWriter(path, {"rig": "toy", "seed": 3, "map": "rings:\n  - much text\n"}) as writer:
        writer.event(0.0, RingEntered(1))
        for k in range(91):
            t = k / 30
            if k == 30:
                writer.event(t, OpeningPassed("1-2@45", 2))
                writer.event(t, RingEntered(2))
                writer.event(t, FailureReported("stuck", "Track", "0.6 s"))
                writer.event(t, RecoveryChosen("Dither"))
            seen = k % 10 != 0
            o = Observation(t, 0.03 if seen else None, 0.04 if seen else None, 0.01, -0.02)
            writer.tick(o, Command(0.05, -0.06), STATE, leaf="Track", tick_ms=1.0 + (k == 50))
        writer.result({"success": True, "reason": "arrived", "time_s": 3.0})
    return path


@pytest.fixture
def cut(log):
    """The log up to the chunk that begins at 1.8 s, in its middle."""
    path = log.with_name("cut.mcap")
    with log.open("rb") as stream:
        summary = make_reader(stream).get_summary()
    assert summary is not None
    after = next(chunk for chunk in summary.chunk_indexes if chunk.message_start_time == 1_800_000_000)
    path.write_bytes(log.read_bytes()[: after.chunk_start_offset + after.chunk_length // 2])
    return path


def test_info_json_describes_the_run(run, log):
    code, out, _ = run("info", log, "--json")
    got = json.loads(out)
    assert code == 0
    assert (got["complete"], got["ticks"]) == (True, 91)
    assert got["duration_s"] == pytest.approx(3.0)
    assert got["ball_seen"] == pytest.approx(81 / 91)
    assert [(r["ring"], r["start"], r["end"]) for r in got["rings"]] == [(1, 0.0, 1.0), (2, 1.0, pytest.approx(3.0))]
    failure = {key: got["failures"][0][key] for key in ("t", "kind", "where", "detail", "recovery")}
    assert failure == {"t": 1.0, "kind": "stuck", "where": "Track", "detail": "0.6 s", "recovery": "Dither"}
    assert got["header"]["seed"] == 3
    assert "map" not in got["header"]
    assert got["result"]["reason"] == "arrived"


KILLED = """
import os, signal, sys
from mazeplan.core.logs.run_log import RunLogWriter
from mazeplan.core.records import LEVEL, Observation

log = RunLogWriter(sys.argv[1], {})
for k in range(101):
    log.sample(Observation(k / 30.0, 0.09, 0.0, 0.0, 0.0), LEVEL)
if sys.argv[2] == "ended":
    log.result({"success": True, "reason": "arrived", "time_s": 3.3})
os.kill(os.getpid(), signal.SIGKILL)
"""


@pytest.mark.parametrize("when", ["under way", "ended"])
def test_info_of_a_log_of_a_killed_program_tells_what_is_kept_and_what_is_missing(run, tmp_path, when):
    path = tmp_path / "killed.mcap"
    done = subprocess.run([sys.executable, "-c", KILLED, str(path), when], timeout=60, check=False)
    assert done.returncode == -signal.SIGKILL
    got, text = json.loads(run("info", path, "--json")[1]), run("info", path)[1]
    assert got["complete"] is False
    assert text.startswith(f"{path}: cut off")
    assert got["ticks"] == 101 if when == "ended" else 100 - 30 * CHUNK_S - 1 <= got["ticks"] <= 100


def rows_of(text: str) -> list[dict[str, str]]:
    return list(csv.DictReader(io.StringIO(text)))


def test_export_writes_the_known_columns_first(run, log, cut, tmp_path):
    table = tmp_path / "new" / "run.csv"
    assert run("export", log, "-o", table)[0] == 0
    text = table.read_text()
    assert text.startswith("t,theta,x,y,r,beta,gamma,u_beta,u_gamma,ring,")
    rows = rows_of(text)
    assert len(rows) == 91
    assert {rows[0][name] for name in ("x", "y", "theta", "r")} == {""}
    one = {name: rows[1][name] for name in ("x", "y", "beta", "gamma", "u_beta", "u_gamma", "ring", "leaf")}
    assert list(one.values()) == ["0.03", "0.04", "0.01", "-0.02", "0.05", "-0.06", "2", "Track"]
    assert float(rows[1]["theta"]) == pytest.approx(math.atan2(4, 3))
    assert float(rows[1]["r"]) == pytest.approx(0.05)
    assert [float(row["t"]) for row in rows] == [k / 30 for k in range(91)]
    err = run("export", cut, "-o", tmp_path / "cut.csv")[2]
    assert len(rows_of((tmp_path / "cut.csv").read_text())) == 54
    assert re.match(r"mazeplan: .*: the log is cut off, .*; used are its 54 ticks up to t = 1.77 s\n", err)
