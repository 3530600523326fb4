"""What acts at places of the plate or moments of time, on a ball that nothing else slows."""

from __future__ import annotations

import math

import numpy as np
import pytest
from test_body_effects import START, H, after

from mazeplan.core.constants import GRAVITY as G
from mazeplan.physics.effect import Effect
from mazeplan.physics.effects import local_forces as planeterms
from mazeplan.physics.effects.local_forces import (
    drag_drift,
    floor_bump,
    floor_dirt,
    floor_kerb,
    floor_ripple,
    floor_warp,
    lean_drift,
    moving_friction,
    ring_push,
    swing_along,
    table_swing,
)

TERMS = [effect for effect in vars(planeterms).values() if isinstance(effect, Effect)]
F, X = 5.0 / 7.0, 0.05  # share of gravity that moves a solid ball; m, where it is
AT = [X, 0.0, 0.0, 0.2, 0.0]  # at theta = 0, 0.2 m/s counter-clockwise


def gained(term, state=AT):
    """Change of the velocity (2,) by a term in a step, m/s."""
    return after(state, [term])[2:4] - after(state)[2:4]


@pytest.mark.parametrize("effect", TERMS, ids=lambda effect: effect.name)
def test_without_a_size_it_does_nothing_and_says_so(effect):
    places = {name: 0.5 * p.high for name, p in effect.parameters.items() if name in effect.places}
    assert effect(**places).idle
    np.testing.assert_array_equal(after(AT, [effect(**places)]), after(AT))
    sizes = [name for name in effect.parameters if name not in effect.places]
    assert not effect(**places, **{sizes[0]: 0.5 * effect.parameters[sizes[0]].high}).idle


def test_a_warped_floor_is_a_slope():
    across, along = gained(floor_warp(a=0.3, b=0.2))  # z = a (x^2 - y^2) + 2 b x y
    assert across == pytest.approx(-H * F * G * 2.0 * 0.3 * X, rel=1e-3)
    assert along == pytest.approx(-H * F * G * 2.0 * 0.2 * X, rel=1e-3)


def test_a_bump_pulls_most_at_one_width_from_its_middle():
    pull = gained(floor_bump(x=X + 0.015, y=0.0, depth=0.02, width=0.015))
    assert pull == pytest.approx([H * F * G * 0.02, 0.0], rel=1e-3, abs=1e-9)


@pytest.mark.parametrize(("centre", "inner", "share"), [(0.0, 0.03, 1.0), (2.0, 0.03, 0.0), (0.0, 0.07, 0.0)])
def test_dirt_slows_in_its_sector_of_its_ring_alone(centre, inner, share):
    _, lost = gained(floor_dirt(start=centre - 0.5, end=centre + 0.5, inner=inner, outer=inner + 0.04, coefficient=0.3))
    assert lost == pytest.approx(-share * H * 0.3, rel=1e-3, abs=1e-6)


def test_a_kerb_takes_its_share_of_any_speed():
    for speed in (0.1, 0.3):
        before = [X * math.cos(-0.3), X * math.sin(-0.3), speed * math.sin(0.3), speed * math.cos(0.3), 0.0]
        ring = {"centre": 0.1, "inner": 0.0, "outer": 0.2}
        done = after(before, [floor_kerb(size=0.4, **ring)], steps=round(0.045 / speed / H))
        assert np.hypot(*done[2:4]) == pytest.approx(speed * math.exp(-0.4), rel=0.06)


def test_waves_and_pushes_are_forces_along_the_rings():
    turned = [0.0, X, -0.2, 0.0, 0.0]  # at theta = pi / 2
    wave = floor_ripple(waves=6.0, c=0.3, s=0.1)
    assert gained(wave)[1] == pytest.approx(H * 0.3, rel=1e-6)
    assert gained(wave, turned)[0] == pytest.approx(H * 0.3, rel=1e-6), "cos(3 pi) = -1, and there -x is along the ring"
    assert gained(ring_push(force=0.1, turn=2.0))[1] == pytest.approx(H * (0.1 + 2.0 * X), rel=1e-6)


def test_what_swings_and_what_grows_goes_by_time():
    t = START + 0.5 * H
    phase = 2.0 * math.pi * 0.7 * t
    lean = 0.01 * math.sin(phase) + 0.02 * math.cos(phase)
    assert gained(table_swing(frequency=0.7, bs=0.01, bc=0.02))[0] == pytest.approx(
        H * F * G * math.sin(lean), rel=1e-6
    )
    assert gained(swing_along(frequency=0.7, s=0.2))[1] == pytest.approx(H * 0.2 * math.sin(phase), rel=1e-6)
    assert gained(lean_drift(beta=1e-3))[0] == pytest.approx(H * F * G * math.sin(1e-3 * t), rel=1e-6)
    assert gained(drag_drift(rate=0.1, start=0.05))[1] == pytest.approx(-H * 0.2 * (0.05 + 0.1 * t), rel=1e-3)


def test_friction_of_a_moving_plate_is_none_while_it_rests():
    assert gained(moving_friction(coefficient=5.0)) == pytest.approx([0.0, 0.0])
