from __future__ import annotations

import csv
import io
import json
import math
import shutil

import pytest
from typer.testing import CliRunner

from mazeplan.cli.log import app, summary
from mazeplan.data.runlog import RunLogWriter, read_log
from mazeplan.errors import InputError, LogError
from mazeplan.records import Command, Observation, State

STATE = State(0.0, 0.08, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, ring=2)


def run(*arguments: str):
    return CliRunner().invoke(app, [str(argument) for argument in arguments], catch_exceptions=False)


@pytest.fixture
def log(tmp_path):
    """Three seconds: ring 1 for one second, then ring 2; one failure; the ball is not seen in every tenth frame."""
    path = tmp_path / "run.mcap"
    with RunLogWriter(path, {"rig": "toy", "seed": 3, "map": "rings:\n  - much text\n"}) as writer:
        writer.event(0.0, "ring", {"ring": 1})
        for k in range(91):
            t = k / 30
            if k == 30:
                writer.event(t, "passed", {"opening": "1-2@45", "ring": 2})
                writer.event(t, "ring", {"ring": 2})
                writer.event(t, "failure", {"kind": "stuck", "where": "Track", "detail": "0.6 s"})
                writer.event(t, "recovery", {"recovery": "Dither"})
            seen = k % 10 != 0
            o = Observation(t, 0.03 if seen else None, 0.04 if seen else None, 0.01, -0.02)
            writer.tick(o, Command(0.05, -0.06), STATE, leaf="Track", tick_ms=1.0 + (k == 50))
        writer.result({"success": True, "reason": "arrived", "time_s": 3.0})
    return path


def cut(log):
    path = log.with_name("cut.mcap")
    path.write_bytes(log.read_bytes()[: log.read_bytes().index(b'{"t":2.0,"beta"')])
    return path


def test_info_json_is_one_document_that_tells_the_run(log):
    done = run("info", log, "--json")
    got = json.loads(done.stdout)
    assert done.exit_code == 0
    assert (got["complete"], got["ticks"]) == (True, 91)
    assert got["duration_s"] == pytest.approx(3.0)
    assert got["rate_hz"] == pytest.approx(30.0)
    assert got["ball_seen"] == pytest.approx(81 / 91)
    assert [(r["ring"], r["t"], r["time_s"]) for r in got["rings"]] == [(1, 0.0, 1.0), (2, 1.0, pytest.approx(2.0))]
    assert got["passed"] == [{"t": 1.0, "opening": "1-2@45"}]
    assert got["failures"] == [{"t": 1.0, "kind": "stuck", "where": "Track", "detail": "0.6 s"}]
    assert got["recoveries"] == [{"t": 1.0, "recovery": "Dither"}]
    assert got["tick_ms"] == {"p50": 1.0, "p99": pytest.approx(1.1), "max": 2.0}
    assert got["planner_ms"] is None
    assert got["header"]["seed"] == 3
    assert "map" not in got["header"]
    assert got["result"]["reason"] == "arrived"


def test_info_for_people(log):
    text = run("info", log).stdout
    assert text.startswith(f"{log}: complete\n")
    for part in ("91 over 3.00 s at 30.00 Hz, ball seen in 89.0 %", "2 from 1.00 s for 2.00 s", "1-2@45 at 1.00 s"):
        assert part in text
    assert "1.00 s stuck, Track, 0.6 s" in text
    assert "arrived after 3.0 s" in text


def test_info_of_a_cut_log_says_so(log):
    path = cut(log)
    got = json.loads(run("info", path, "--json").stdout)
    assert (got["complete"], got["ticks"], got["result"]) == (False, 60, None)
    assert "cut off" in run("info", path).stdout


def test_info_of_a_log_with_nothing_in_it(tmp_path):
    path = tmp_path / "empty.mcap"
    with RunLogWriter(path, {}) as writer:
        writer.event(0.0, "ring", {})
        writer.event(0.0, "failure", {})
    got = summary(read_log(path))
    assert (got["ticks"], got["rate_hz"], got["ball_seen"]) == (0, None, None)
    assert run("info", path).exit_code == 0


def test_planner_time_is_of_the_plans_not_of_the_ticks(tmp_path):
    import numpy as np

    from mazeplan.records import Plan, StopReason

    path = tmp_path / "run.mcap"
    with RunLogWriter(path, {}) as writer:
        for ms in (1.0, 3.0):
            states, controls = np.zeros((2, 6)), np.zeros((1, 2))
            writer.plan(Plan(states, controls, np.zeros((1, 2, 6)), 0.0, StopReason.CONVERGED, 1, ms))
    assert summary(read_log(path))["planner_ms"] == {"p50": 2.0, "p99": pytest.approx(2.98), "max": 3.0}


def rows_of(text: str) -> list[dict[str, str]]:
    return list(csv.DictReader(io.StringIO(text)))


def test_export_has_the_columns_of_a_table_first(log, tmp_path):
    table = tmp_path / "new" / "run.csv"
    assert run("export", log, "-o", table).exit_code == 0
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


def test_export_to_stdout_is_the_same_table(log, tmp_path):
    table = tmp_path / "run.csv"
    run("export", log, "-o", table)
    assert run("export", log, "-o", "-").stdout == table.read_text()


def test_export_of_a_cut_log(log):
    assert len(rows_of(run("export", cut(log), "-o", "-").stdout)) == 60


def test_export_overwrites_only_with_force(log, tmp_path):
    table = tmp_path / "run.csv"
    table.write_text("precious")
    with pytest.raises(InputError, match="--force"):
        run("export", log, "-o", table)
    assert table.read_text() == "precious"
    run("export", log, "-o", table, "--force")
    assert table.read_text().startswith("t,theta")


def test_export_never_overwrites_the_log_itself(log, tmp_path):
    before = log.read_bytes()
    with pytest.raises(InputError, match="log itself"):
        run("export", log, "-o", log, "--force")
    assert log.read_bytes() == before


def test_export_to_a_place_that_cannot_be_written(log, tmp_path):
    with pytest.raises(InputError, match="cannot be written"):
        run("export", log, "-o", log / "run.csv")


def test_a_log_that_is_not_there_is_one_line(tmp_path):
    for command in (("info",), ("export", "-o", "-")):
        with pytest.raises(LogError, match="no such file, expected a run log"):
            run(command[0], tmp_path / "none.mcap", *command[1:])


def test_the_command_line_exits_2_with_one_line(tmp_path, capsys, monkeypatch):
    pytest.importorskip("mazeplan.cli.app")
    from mazeplan.cli import main

    monkeypatch.setattr("sys.argv", ["mazeplan", "log", "info", str(shutil.copy(__file__, tmp_path / "text.mcap"))])
    with pytest.raises(SystemExit) as caught:
        main()
    assert caught.value.code == 2
    assert capsys.readouterr().err.count("\n") == 1
