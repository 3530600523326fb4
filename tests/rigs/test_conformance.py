"""The conformance suite: the packaged rigs pass, and each check fails for a rig that breaks just that."""

from __future__ import annotations

import json
import math
import sys
from dataclasses import replace

import numpy as np
import pytest

from mazeplan import check_rig
from mazeplan.cli import main
from mazeplan.maze.mapfile import load_map
from mazeplan.rigs.registry import make_rig
from mazeplan.rigs.simulated import SimulatedRig

MAZE = load_map("cme")


def failed(rig, **more):
    return {result.name for result in check_rig(rig, MAZE, **more) if not result.passed}


@pytest.mark.parametrize("name", ["ideal", "rough", "toy"])
def test_packaged_rigs_conform(name):
    results = check_rig(make_rig(name, MAZE), MAZE)
    assert [result.detail for result in results if not result.passed] == []
    assert len(results) == 14


class LateClock(SimulatedRig):
    def observe(self):
        o = super().observe()
        return replace(o, t=1.1 * o.t)


class ClockStops(SimulatedRig):
    def observe(self):
        o = super().observe()
        return replace(o, t=min(o.t, 0.9))


class ClockLeaps(SimulatedRig):
    def observe(self):
        o = super().observe()
        return replace(o, t=o.t if o.t < 0.7 else o.t + 10.0)


class NoNumber(SimulatedRig):
    """Of a ball that it does not see it says NaN."""

    def observe(self):
        o = super().observe()
        return replace(o, x=math.nan, y=math.nan) if 0.3 < o.t < 0.4 else o


class Standing(SimulatedRig):
    def observe(self):
        return replace(super().observe(), t=0.0)


class Nothing(SimulatedRig):
    def observe(self):
        super().observe()


class Words(SimulatedRig):
    def observe(self):
        o = super().observe()
        return replace(o, x=str(o.x))


class Millimetres(SimulatedRig):
    def observe(self):
        o = super().observe()
        return replace(o, x=1e3 * o.x, y=1e3 * o.y)


class AlwaysAtNought(SimulatedRig):
    def reset(self, *, ring, theta, rng):
        super().reset(ring=ring, theta=0.0, rng=rng)


class AlwaysInRing1(SimulatedRig):
    def reset(self, *, ring, theta, rng):
        super().reset(ring=1, theta=theta, rng=rng)


class HalfBall(SimulatedRig):
    def observe(self):
        return replace(super().observe(), y=None)


class SwappedAxes(SimulatedRig):
    def command(self, u_beta, u_gamma):
        super().command(u_gamma, u_beta)


class WrongSignOfBall(SimulatedRig):
    def observe(self):
        o = super().observe()
        return replace(o, x=o.x, y=-o.y)


class NeverLevel(SimulatedRig):
    def level(self):
        pass


class TakesNan(SimulatedRig):
    def command(self, u_beta, u_gamma):
        if math.isfinite(u_beta) and math.isfinite(u_gamma):
            super().command(u_beta, u_gamma)


class TakesTooMuch(SimulatedRig):
    def command(self, u_beta, u_gamma):
        if math.isfinite(u_beta) and math.isfinite(u_gamma):
            limit = self.maze.tilt_limit
            super().command(*(float(np.clip(u, -limit, limit)) for u in (u_beta, u_gamma)))
        else:
            raise ValueError("no number")


class Overshoots(SimulatedRig):
    def observe(self):
        o = super().observe()
        return replace(o, beta=o.beta * (1.3 if o.beta > 0.08 else 1.0))


class Unrepeatable(SimulatedRig):
    count = 0

    def observe(self):
        Unrepeatable.count += 1
        o = super().observe()
        return replace(o, x=o.x + 1e-9 * Unrepeatable.count)


class ClosesOnce(SimulatedRig):
    closed = False

    def close(self):
        if self.closed:
            raise OSError("closed already")
        self.closed = True


@pytest.mark.parametrize(
    ("kind", "checks"),
    [
        (LateClock, {"clock"}),
        (ClockStops, {"clock goes on"}),
        (ClockLeaps, {"clock goes on"}),
        (HalfBall, {"observation", "placing", "sign of beta", "sign of gamma"}),
        (NoNumber, {"observation", "sign of beta", "sign of gamma"}),
        (Millimetres, {"observation", "placing"}),
        (AlwaysAtNought, {"observation", "placing", "sign of beta"}),
        (AlwaysInRing1, {"placing"}),
        (SwappedAxes, {"tilt follows beta", "tilt follows gamma", "sign of beta", "sign of gamma"}),
        (WrongSignOfBall, {"observation", "placing", "sign of beta", "sign of gamma"}),
        (NeverLevel, {"level"}),
        (TakesNan, {"refuses NaN"}),
        (TakesTooMuch, {"refuses beyond the limit"}),
        (Overshoots, {"limit is kept"}),
        (Unrepeatable, {"repeatable"}),
        (ClosesOnce, {"close"}),
    ],
)
def test_each_check_finds_what_it_looks_for(kind, checks):
    assert failed(kind(MAZE, {})) == checks


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize(
    ("kind", "said"),
    [
        (Standing, "t went from 0.0000 to 0.0000 s in 36 samples"),
        (Nothing, "observe() returned NoneType, expected Observation(t, x, y, beta, gamma)"),
        (Words, "x: got '0.08"),
    ],
)
def test_samples_that_are_none_are_told_in_words_and_once(kind, said):
    told = [result.detail for result in check_rig(kind(MAZE, {}), MAZE)]
    assert len([detail for detail in told if detail.startswith(said)]) >= 1
    if kind is Nothing:
        assert told[:3] == [said, "as clock", "as clock"]
    assert not any(detail.startswith("raised") for detail in told)


def test_hardware_is_not_asked_to_repeat_itself():
    assert failed(Unrepeatable(MAZE, {}), repeatable=False) == set()


def command(monkeypatch, capsys, *arguments):
    monkeypatch.setattr(sys, "argv", ["mazeplan", "rig", *arguments])
    with pytest.raises(SystemExit) as stop:
        main()
    return stop.value.code or 0, capsys.readouterr()


def test_command_line(monkeypatch, capsys, tmp_path):
    code, got = command(monkeypatch, capsys, "check", "ideal", "--json")
    assert code == 0
    assert json.loads(got.out)["passed"] is True
    monkeypatch.chdir(tmp_path)
    (tmp_path / "stiff_rig.py").write_text(
        "from mazeplan.rigs.simulated import SimulatedRig\n\n\nclass Stiff(SimulatedRig):\n"
        "    def command(self, u_beta, u_gamma):\n        super().command(0.0 * u_beta, u_gamma)\n"
    )
    code, got = command(monkeypatch, capsys, "check", "stiff_rig:Stiff")
    assert code == 1
    assert "FAILED  tilt follows beta" in got.out
    code, got = command(monkeypatch, capsys, "list")
    assert "ideal, rough, surprise, toy" in got.out
    assert "camera_noise_mm" in got.out
