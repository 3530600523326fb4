"""Surprises: every kind is drawn, and each changes what it says."""

from __future__ import annotations

import math

import numpy as np
import pytest

from mazeplan.core.errors import SettingsError
from mazeplan.maze.mapfile import load_map
from mazeplan.rigs.registry import make_rig, rig_label, with_seed
from mazeplan.rigs.sim.settings import settings_from
from mazeplan.rigs.sim.simulated import SimulatedRig
from mazeplan.rigs.sim.surprise import DRAWN, drawn_surprise

MAZE = load_map("cme")


def rolled(theta=0.0, u=(0.0, 0.0), seconds=0.3, **settings):
    """The ball's motion along the ring from rest under a command, m: as it is, and what the camera saw last."""
    rig = SimulatedRig(MAZE, {"rolling_friction_m": 0.0, "wall_grip": 0.0, **settings})
    rig.reset(ring=1, theta=theta, rng=np.random.default_rng(0))
    for _ in range(round(30 * seconds)):
        o = rig.observe()
        rig.command(*u)
    x, y = rig.truth()[:2]
    return MAZE.track_radius(1) * (math.atan2(y, x) - theta), (o.x, o.y), (x, y)


def test_each_kind_once_in_seven_seeds_and_the_same_again():
    for first in (0, 7, 98):
        drawn = [make_rig(f"surprise@{first + i}", MAZE).surprise for i in range(7)]  # pyright: ignore
        assert sorted(a.kind for a in drawn) == sorted(DRAWN)
        again = [make_rig(f"surprise@{first + i}", MAZE).surprise for i in range(7)]  # pyright: ignore
        assert drawn == again


def test_all_else_is_as_on_the_toy():
    toy, rig = make_rig("toy", MAZE), make_rig("surprise@3", MAZE)
    changed = {k: v for k, v in rig.settings.model_dump().items() if v != toy.settings.model_dump()[k]}  # pyright: ignore
    del changed["surprise_seed"]
    assert changed == rig.surprise.changes  # pyright: ignore
    assert rig_label("surprise@3") == "surprise@3"
    assert with_seed("surprise", 4) == "surprise@4"
    assert with_seed("surprise@3", 4) == "surprise@3"
    assert with_seed("toy", 4) == "toy"


def test_a_kind_is_asked_for_by_name():
    rig = make_rig("surprise@gain", MAZE)
    assert rig.surprise.kind == "gain"  # pyright: ignore[reportAttributeAccessIssue]
    assert rig_label("surprise@gain") == "surprise@gain"
    with pytest.raises(
        SettingsError, match=r"^got rig 'surprise@nonsense', expected surprise@N with a seed, .* one of drawn, table"
    ):
        make_rig("surprise@nonsense", MAZE)


def test_a_rig_without_a_surprise_takes_no_seed():
    with pytest.raises(SettingsError, match=r"got rig 'toy@3', but toy has no surprise; expected toy$"):
        make_rig("toy@3", MAZE)
    assert drawn_surprise(settings_from({}), MAZE) is None


def test_a_late_camera_shows_where_the_ball_was():
    along = {"theta": math.pi / 2, "u": (0.05, 0.0), "seconds": 0.6}
    _, seen, _ = rolled(**along, camera_late_ms=80.0)
    _, _, then = rolled(**{**along, "seconds": 0.6 - 3.0 / 30.0})
    _, _, later = rolled(**{**along, "seconds": 0.6 - 2.0 / 30.0})
    expected = 0.4 * np.array(then) + 0.6 * np.array(later)  # 80 ms are 2.4 samples
    assert seen == pytest.approx(tuple(expected), abs=3e-4)
