"""navigate and evaluate from the command line: exit statuses, one line for bad input, Ctrl-C."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
import textwrap

import pytest
from commands import call

from mazeplan.data.runlog import read_log


def test_arrives_and_logs(monkeypatch, capsys, tmp_path):
    log = tmp_path / "run.mcap"
    code, out, err = call(
        monkeypatch, capsys, "navigate", "--from", "ring4", "--rig", "ideal", "--log", str(log), "--json"
    )
    document = json.loads(out)
    assert code == 0
    assert document["success"]
    assert "arrived" in err
    assert read_log(log).result["time_s"] == document["time_s"]


def test_failing_to_arrive_is_one_and_names_the_reason(monkeypatch, capsys):
    code, out, _ = call(monkeypatch, capsys, "navigate", "--rig", "ideal", "--time-limit", "0.3", "--json")
    assert code == 1
    assert json.loads(out)["reason"] == "out_of_time"


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--from", "ring9"], "ring1 to ring5"),
        (["--map", "nowhere"], "packaged map"),
        (["--rig", "nowhere"], "ideal, rough, surprise, toy"),
        (["--rig", "no.such.module:Rig"], "no.such.module"),
        (["--model", "nowhere"], "model.yaml"),
        (["--behavior", "nowhere"], "navigate"),
        (["--time-limit", "nan"], "--time-limit"),
        (["--start-angle", "nan"], "angle"),
        (["--log", "/proc/none/x.mcap"], "x.mcap"),
        (["--seed", "-1"], "--seed"),
        (["--time-limit", "soon"], "--time-limit"),
        (["--colour"], "--colour"),
        (["--rig", "os:getcwd"], "no rig"),
    ],
)
def test_bad_input_is_one_line_and_two(monkeypatch, capsys, arguments, said):
    code, out, err = call(monkeypatch, capsys, "navigate", *arguments)
    assert code == 2
    assert out == ""
    lines = err.splitlines()
    assert len(lines) == 1
    assert lines[0].startswith("mazeplan: ")
    assert said in lines[0]
    assert "Traceback" not in err


def test_a_rig_that_fails_is_three(monkeypatch, capsys, tmp_path):
    (tmp_path / "broken_rig.py").write_text(
        textwrap.dedent("""
        from mazeplan.errors import RigError

        class Broken:
            rate_hz = 30.0
            def __init__(self, maze, settings): pass
            def reset(self, *, ring, theta, rng): pass
            def observe(self): raise RigError("serial line: no answer from /dev/ttyACM0")
            def command(self, u_beta, u_gamma): pass
            def level(self): pass
            def close(self): pass
        """)
    )
    monkeypatch.chdir(tmp_path)
    code, _, err = call(monkeypatch, capsys, "navigate", "--rig", "broken_rig:Broken")
    assert code == 3
    assert "no answer" in err


def test_evaluate_prints_a_summary(monkeypatch, capsys):
    arguments = ("evaluate", "--rig", "ideal", "--from", "ring4", "--runs", "2")
    code, out, _ = call(monkeypatch, capsys, *arguments)
    assert code == 0
    assert "arrived       2 of 2" in out
    assert "tick" in out
    code, out, _ = call(monkeypatch, capsys, *arguments, "--json")
    assert json.loads(out)["success"] == 2
    code, _, _ = call(monkeypatch, capsys, *arguments, "--time-limit", "0.1")
    assert code == 1


def test_ctrl_c_levels_closes_the_log_and_exits_130(tmp_path):
    log = tmp_path / "run.mcap"
    script = "import mazeplan.cli, sys; sys.argv = ['mazeplan', *sys.argv[1:]]; mazeplan.cli.main()"
    rig = tmp_path / "slow_rig.py"
    rig.write_text(
        textwrap.dedent("""
        import pathlib, time
        from mazeplan.rigs.simulated import SimulatedRig

        class Slow(SimulatedRig):
            ticks = 0
            def observe(self):
                Slow.ticks += 1
                if Slow.ticks == 10:
                    print("ten ticks", flush=True)
                time.sleep(0.05)
                return super().observe()
            def level(self):
                pathlib.Path("levelled").touch()
                super().level()
        """)
    )
    process = subprocess.Popen(
        [sys.executable, "-c", script, "navigate", "--rig", "slow_rig:Slow", "--log", str(log)],
        cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
        # whoever runs the tests in the background of a shell has it ignored, and children inherit that
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    )  # fmt: skip
    assert process.stdout is not None
    assert process.stdout.readline().strip() == "ten ticks"
    process.send_signal(signal.SIGINT)
    _, err = process.communicate(timeout=60)
    assert process.returncode == 130
    assert "Traceback" not in err
    assert (tmp_path / "levelled").exists()
    read = read_log(log)
    assert read.complete
    assert read.result["reason"] == "interrupted"


def test_doctor(monkeypatch, capsys):
    code, out, _ = call(monkeypatch, capsys, "doctor", "--json")
    assert code == 0
    assert json.loads(out)["packages"]["core"]["numpy"]
    code, out, _ = call(monkeypatch, capsys, "doctor")
    assert "core      ready" in out


def test_no_arguments_is_help_and_unknown_is_two(monkeypatch, capsys):
    code, out, err = call(monkeypatch, capsys, "navigat")
    assert code == 2
    assert err.startswith("mazeplan: No such command 'navigat'")
    assert len(err.splitlines()) == 1
    code, out, err = call(monkeypatch, capsys)
    assert code == 2
    assert "evaluate" in out + err
    code, out, err = call(monkeypatch, capsys, "--help")
    assert code == 0
    assert "navigate" in out


def test_a_rig_without_a_model_is_told_so(monkeypatch, capsys, tmp_path):
    rig = tmp_path / "own.yaml"
    rig.write_text("camera_noise_mm: 0.1\n")
    code, _, err = call(monkeypatch, capsys, "navigate", "--rig", str(rig), "--from", "ring4")
    assert code == 0
    assert "no model for rig" in err
    rig.write_text("model: ideal\n")
    assert "no model" not in call(monkeypatch, capsys, "navigate", "--rig", str(rig), "--from", "ring4")[2]
