"""Effects of the registry and of users on a ball with a body, against what the bead's equation makes of them."""

from __future__ import annotations

import math

import numpy as np
import pytest

from mazeplan.core.constants import GRAVITY as G
from mazeplan.physics.dynamics.plate import ROW, PlateMotion, Tilting, plate_rows
from mazeplan.physics.dynamics.rigid_body import BESIDES, Ball, advance, effects_of
from mazeplan.physics.dynamics.walls import SLAB, Walls
from mazeplan.physics.effect import DRAG, DRY, FORCE, GRAVITY, WALL, Effect, Parameter
from mazeplan.physics.effects.ball import constant_force, dry_friction, quadratic_drag, surface_profile, tilt_offset
from mazeplan.physics.effects.local_forces import FAMILY
from mazeplan.physics.formulas.symbols import PLATE, RECORDED, cos, sin, state, symbols_of
from mazeplan.physics.registry import PACKAGED

R, H, START = 6.35e-3, 1.0 / 300.0, 2.0
OPEN = Walls(np.zeros((0, 4)), np.zeros((0, 5)), np.zeros((0, SLAB)), 100.0, R, 1e-3)
SMOOTH = Ball(rolling=0.0, spin=0.0, wall=0.0, restitution=0.0, hold=1e9)
PLAIN = Parameter("1", 0.0, -10.0, 10.0, smallest=0.1)


def after(start, terms=(), *, steps=1, beta=0.0, gamma=0.0, tilting=None):
    """The state (5,) behind some steps from a start under a tilt that stays, which begin at START."""
    plate = PlateMotion(0.0, 1.0, np.tile([beta, 0.0, 0.0, gamma, 0.0, 0.0], (99, 1)))
    rows, out = np.zeros((steps, ROW)), np.empty((steps, 5))
    plate_rows(plate, tilting or Tilting(), START + H * np.arange(steps), H, 1, rows)
    effects = effects_of(terms) if terms else effects_of()
    advance(SMOOTH, OPEN, effects, rows, H, np.array(start, dtype=float), out)
    return out[-1]


def own(acts, formula, **parameters):
    """An effect as a user would write it."""
    return Effect("mine", dict.fromkeys(parameters, PLAIN), acts, formula)(**parameters)


def test_what_depends_on_time_alone_is_renewed_at_every_step():
    """A lean in time, as a term and as a plate that moves so."""
    swing = own(GRAVITY, lambda s, p: {"beta": p.a * sin(2.0 * s.t), "gamma": p.b * cos(3.0 * s.t)}, a=0.02, b=0.03)
    state, n = [0.03, 0.04, 0.1, -0.05, 0.02], 40
    found = after(state, [swing], steps=n)
    t = START + H * (np.arange(n) + 0.5)
    lean = [0.02 * np.sin(2.0 * t), 0.03 * np.cos(3.0 * t)]
    push = 5.0 / 7.0 * G * np.stack([np.sin(lean[0]), -np.sin(lean[1]) * np.cos(lean[0])])
    wanted = after(state, steps=n)[2:4] + H * push.sum(axis=1)
    np.testing.assert_allclose(found[2:4], wanted, rtol=1e-9)


@pytest.mark.parametrize("rate", [3.0, -2.0])
@pytest.mark.parametrize("theta", [0.4, 2.5, -1.9])
def test_a_users_force_pushes_along_the_ring_and_knows_place_speed_and_time(theta, rate):
    r, c, s = 0.05, math.cos(theta), math.sin(theta)
    push = own(FORCE, lambda s, p: p.a * cos(s.theta) + p.b * s.theta_dot * s.t + s.radius, a=3.0, b=0.2)
    state = [r * c, r * s, -r * rate * s, r * rate * c, 0.0]
    gained = after(state, [push])[2:4] - after(state)[2:4]
    wanted = r * (3.0 * c + 0.2 * rate * (START + 0.5 * H) + r)
    np.testing.assert_allclose(gained, H * wanted * np.array([-s, c]), rtol=1e-9, atol=1e-12)


def test_the_radius_of_the_ball_is_the_balls():
    push = own(FORCE, lambda s, p: p.a * s.ball_radius, a=1.0)
    assert PLATE[7] == "ball_radius"
    assert after([0.05, 0.0, 0.0, 0.0, 0.0], [push])[3] == pytest.approx(H * 0.05 * R)


@pytest.mark.parametrize("way", [1.0, -1.0])
def test_a_users_friction_slows_the_ball_whichever_way_it_goes(way):
    r, v = 0.05, 0.1
    rub = own(DRY, lambda s, p: p.a + p.b * s.direction, a=0.6, b=0.2)
    drag = own(DRAG, lambda s, p: p.c * s.speed, c=0.3)
    rubbed, dragged = (after([r, 0.0, 0.0, way * v, 0.0], [one]) for one in (rub, drag))
    assert v - abs(rubbed[3]) == pytest.approx(H * r * (0.6 + 0.2 * way))
    assert v - abs(dragged[3]) == pytest.approx(H * 0.3 * (v / r) * v)
    across = after([r, 0.0, way * v, 0.0, 0.0], [rub])
    assert v - abs(across[2]) == pytest.approx(H * r * 0.6), "in any direction, not along the ring alone"
    assert np.all(after([r, 0.0, 0.0, 0.0, 0.0], [rub])[2:4] == 0.0), "friction alone moves nothing"


@pytest.mark.parametrize(("share", "moves"), [(1.02, False), (0.98, True)])
def test_friction_of_a_user_can_hold_a_ball(share, moves):
    r, beta = 0.05, 0.02
    rub = own(DRY, lambda s, p: p.a, a=share * 5.0 / 7.0 * G * math.sin(beta) / r)
    assert bool(after([r, 0.0, 0.0, 0.0, 0.0], [rub], steps=60, beta=beta)[2]) is moves


def test_a_users_gravity_is_felt_as_a_rolling_ball_feels_it():
    pull = own(GRAVITY, lambda s, p: {"x": p.a * sin(3.0 * s.theta), "factor": 1.0 + p.b}, a=0.1, b=0.5)
    beta, gamma = 0.02, -0.03
    found = after([0.03, 0.04, 0.0, 0.0, 0.0], [pull], beta=beta, gamma=gamma)[2:4]
    gx = G * math.sin(beta) + 0.1 * math.sin(3.0 * math.atan2(0.04, 0.03))
    gy = -G * math.sin(gamma) * math.cos(beta)
    np.testing.assert_allclose(found, H * 5.0 / 7.0 * 1.5 * np.array([gx, gy]), rtol=1e-9)


@pytest.mark.parametrize("tilt", [(0.01, -0.02), (0.1, 0.14)])
def test_an_offset_of_the_table_is_the_same_as_an_effect_and_as_part_of_the_tilting(tilt):
    state = [0.03, 0.04, 0.1, -0.05, 0.02]
    one = after(state, [tilt_offset(*tilt)], steps=30, beta=0.03, gamma=0.05)
    other = after(state, tilting=Tilting(tilt_beta=tilt[0], tilt_gamma=tilt[1]), steps=30, beta=0.03, gamma=0.05)
    np.testing.assert_allclose(one[:4], other[:4], rtol=1e-9)


def test_packaged_effects_come_to_the_motion_as_their_names_say():
    r, v = 0.08, 0.12
    dry, drag = (after([r, 0.0, 0.0, v, 0.0], [term]) for term in (dry_friction(0.7), quadratic_drag(0.4)))
    assert v - dry[3] == pytest.approx(H * 0.7 * r)
    assert v - drag[3] == pytest.approx(H * 0.4 * v * v / r)
    wave = after([r, 0.0, 0.0, 0.0, 0.0], [surface_profile(cos1=0.5), constant_force(y=0.1)])
    assert wave[3] == pytest.approx(H * (0.5 * r + 5.0 / 7.0 * 0.1))


def test_what_the_body_has_by_itself_is_refused():
    for name in ("rolling_inertia", "wall_friction", "gate_loss", "camera_offset"):
        with pytest.raises(ValueError, match="by itself"):
            effects_of([PACKAGED[name]()])
    with pytest.raises(ValueError, match="by itself"):
        effects_of([own(WALL, lambda s, p: p.a, a=1.0)])
    with pytest.raises(ValueError, match="past_1"):
        effects_of([own(FORCE, lambda s, p: p.a * s.past_1, a=1.0)])


def test_the_middle_of_the_plate_has_no_angle_and_does_no_harm():
    push = own(FORCE, lambda s, p: p.a * cos(s.theta), a=3.0)
    out = after([2e-4, 0.0, -0.05, 0.0, 0.0], [push], steps=10)
    assert np.all(np.isfinite(out))
    assert out[2] == pytest.approx(-0.05, abs=1e-3)


def test_the_effects_of_this_package_ask_for_the_moment_only():
    ours = [e for e in (*PACKAGED.values(), *FAMILY.values()) if e.named and e.formula and e.acts in BESIDES]
    for effect in ours:
        made = effect.formula(state(), symbols_of(effect.parameters, ""))
        parts = made.values() if isinstance(made, dict) else [made]
        asked = {symbol.name for part in parts for symbol in getattr(part, "free_symbols", ())}
        assert not asked & set(RECORDED), effect.name
