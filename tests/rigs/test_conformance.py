"""The conformance suite: the packaged rigs pass, and each check fails for a rig that breaks just that."""

from __future__ import annotations

import itertools
import math
import sys
from dataclasses import replace

import numpy as np
import pytest

from mazeplan import check_rig
from mazeplan.apps.cli import main
from mazeplan.maze.mapfile import load_map
from mazeplan.rigs.registry import make_rig
from mazeplan.rigs.sim.simulated import SimulatedRig

MAZE = load_map("cme")


def failed(rig, **more):
    return {result.name for result in check_rig(rig, MAZE, **more) if not result.passed}


@pytest.mark.parametrize("name", ["ideal", "rough", "toy"])
def test_packaged_rigs_conform(name):
    results = check_rig(make_rig(name, MAZE), MAZE)
    assert [result.detail for result in results if not result.passed] == []
    assert len(results) == 14


def seen(change):
    """A rig whose samples `change` has changed."""

    class Changed(SimulatedRig):
        def observe(self):
            return change(super().observe())

    return Changed


def placed(**always):
    """A rig that places the ball elsewhere."""

    class Misplaced(SimulatedRig):
        def reset(self, *, ring, theta, rng):
            super().reset(**{"ring": ring, "theta": theta, **always}, rng=rng)

    return Misplaced


COUNT = itertools.count(1)
Unrepeatable = seen(lambda o: replace(o, x=o.x + 1e-9 * next(COUNT)))


class SwappedAxes(SimulatedRig):
    def command(self, u_beta, u_gamma):
        super().command(u_gamma, u_beta)


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


class ClosesOnce(SimulatedRig):
    closed = False

    def close(self):
        if self.closed:
            raise OSError("closed already")
        self.closed = True


BROKEN = {  # name: rig, checks that fail
    "late clock": (seen(lambda o: replace(o, t=1.1 * o.t)), {"clock"}),
    "uneven clock": (seen(lambda o: replace(o, t=o.t + 0.003 * math.sin(1e3 * o.t))), set()),
    "clock stops": (seen(lambda o: replace(o, t=min(o.t, 0.9))), {"clock goes on"}),
    "clock jumps": (seen(lambda o: replace(o, t=o.t if o.t < 0.7 else o.t + 10.0)), {"clock goes on"}),
    "half a ball": (
        seen(lambda o: replace(o, y=None)),
        {"observation", "placing", "sign of beta", "sign of gamma"},
    ),
    "NaN for a ball that is not seen": (
        seen(lambda o: replace(o, x=math.nan, y=math.nan) if 0.3 < o.t < 0.4 else o),
        {"observation", "sign of beta", "sign of gamma"},
    ),
    "millimetres": (seen(lambda o: replace(o, x=1e3 * o.x, y=1e3 * o.y)), {"observation", "placing"}),
    "always at 0 deg": (placed(theta=0.0), {"observation", "placing", "sign of beta"}),
    "always in ring 1": (placed(ring=1), {"placing"}),
    "swapped axes": (SwappedAxes, {"tilt follows beta", "tilt follows gamma", "sign of beta", "sign of gamma"}),
    "wrong sign of y": (
        seen(lambda o: replace(o, y=-o.y)),
        {"observation", "placing", "sign of beta", "sign of gamma"},
    ),
    "never level": (NeverLevel, {"level"}),
    "takes NaN": (TakesNan, {"refuses NaN"}),
    "takes too much": (TakesTooMuch, {"refuses beyond the limit"}),
    "overshoots": (seen(lambda o: replace(o, beta=o.beta * (1.3 if o.beta > 0.08 else 1.0))), {"limit is kept"}),
    "not repeatable": (Unrepeatable, {"repeatable"}),
    "closes once": (ClosesOnce, {"close"}),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", BROKEN)
def test_each_check_finds_its_mistake(name):
    kind, checks = BROKEN[name]
    assert failed(kind(MAZE, {})) == checks


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda o: replace(o, t=0.0), "t went from 0.0000 to 0.0000 s in 36 samples"),
        (lambda o: None, "observe() returned NoneType, expected Observation(t, x, y, beta, gamma)"),
        (lambda o: replace(o, x=str(o.x)), "x: got '0.08"),
    ],
)
def test_invalid_samples_are_reported_in_words_and_once(change, said):
    details = [result.detail for result in check_rig(seen(change)(MAZE, {}), MAZE)]
    assert any(detail.startswith(said) for detail in details)
    if "NoneType" in said:
        assert details[:3] == [said, *["for the same reason as: clock"] * 2]
    assert not any(detail.startswith("raised") for detail in details)


class Ends(SimulatedRig):
    """Notes how it ends; `levels` says whether `level` works."""

    levels = True

    def __init__(self, maze, settings):
        super().__init__(maze, settings)
        self.told = []

    def level(self):
        self.told.append("level")
        if not self.levels:
            raise OSError("no answer")
        super().level()

    def close(self):
        self.told.append("close")
        super().close()


@pytest.mark.parametrize("levels", [True, False])
def test_ctrl_c_leaves_the_plate_level(monkeypatch, levels):
    rig, samples = Ends(MAZE, {}), itertools.count()

    def observe():
        if next(samples) == 40:
            raise KeyboardInterrupt
        return SimulatedRig.observe(rig)

    monkeypatch.setattr(rig, "observe", observe)
    monkeypatch.setattr(rig, "levels", levels)
    raised = KeyboardInterrupt if levels else OSError
    with pytest.raises(raised):
        check_rig(rig, MAZE)
    assert rig.told == ["level", "close"]


def command(monkeypatch, capsys, *arguments):
    monkeypatch.setattr(sys, "argv", ["mazeplan", "rig", *arguments])
    with pytest.raises(SystemExit) as stop:
        main()
    return stop.value.code or 0, capsys.readouterr()
