"""Numbers of a body by name: bounds and units are the registry's, brought over to the ball."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from mazeplan.control.estimation.rigid_body_filter import BodyModel
from mazeplan.control.estimation.rigid_body_fit import (
    bead_values,
    body_of,
    number_of,
    value_of,
    with_body,
    with_values,
)
from mazeplan.learning.modelfile import load_model
from mazeplan.learning.rigid_body_entries import PARAMETERS, RADIUS_M
from mazeplan.maze.mapfile import load_map
from mazeplan.physics.ball_model import BallModel
from mazeplan.physics.effects.ball import dry_friction, quadratic_drag, rolling_inertia, surface_bump, viscous_friction
from mazeplan.physics.registry import PACKAGED
from mazeplan.physics.rig.sensors import TiltSensor

MAZE = load_map("cme")


def test_bounds_and_units_are_the_registrys():
    def known(name):
        return PARAMETERS[name].unit, PARAMETERS[name].low, PARAMETERS[name].high

    for name in ("wall", "viscous", "tilt_beta", "offset_x", "angle", "scale", "delay", "cross_gamma"):
        origin, power = PARAMETERS[name].origin
        assert power == 0
        assert known(name) == (origin.unit, origin.low, origin.high)
    dry = PACKAGED["dry_friction"].parameters["coefficient"]
    assert known("rolling") == (
        "m/s^2",
        pytest.approx(dry.low * RADIUS_M),
        pytest.approx(dry.high * RADIUS_M),
    )
    drag = PACKAGED["quadratic_drag"].parameters["coefficient"]
    assert known("quadratic") == (
        "1/m",
        pytest.approx(drag.low / RADIUS_M),
        pytest.approx(drag.high / RADIUS_M),
    )
    gain = PACKAGED["tilt_gain"].parameters["beta"]
    assert known("gain_beta") == ("1", pytest.approx(1.0 / gain.high), pytest.approx(1.0 / gain.low))
    factor = PACKAGED["rolling_inertia"].parameters["factor"]
    assert known("inertia") == ("1", 0.05, pytest.approx(1.0 / factor.low - 1.0))
    assert PARAMETERS["delay"].words == PACKAGED["sensor_delay"].parameters["delay"].words


def test_every_number_is_there_and_may_be_what_it_is():
    model = BodyModel()
    for name, number in PARAMETERS.items():
        value = value_of(model, name)
        assert math.isnan(value) or number.low <= value <= number.high, name
        assert number.words
        assert value_of(with_values(model, {name: number.high}), name) == number.high
    assert with_values(model, {}) == model


def test_terms_have_numbers_too():
    model = BodyModel(terms=(surface_bump(centre=1.0, height=0.2), dry_friction(0.3)))
    other = with_values(model, {"surface_bump.height": 0.7, "rolling": 0.1, "dry_friction.asymmetry": 0.05})
    assert other.terms[0].values() == model.terms[0].values() | {"height": 0.7}
    assert value_of(other, "dry_friction.asymmetry") == 0.05
    assert value_of(other, "dry_friction.coefficient") == 0.3
    number, known = number_of(model, "surface_bump.height"), PACKAGED["surface_bump"].parameters["height"]
    assert (number.unit, number.low, number.high) == (known.unit, known.low, known.high)
    for wrong in ("surface_bump.heigth", "magnet.height", "nothing"):
        with pytest.raises(KeyError):
            number_of(model, wrong)


def test_what_beads_say_is_told_in_the_bodys_units():
    rings = {
        ring: BallModel((rolling_inertia(0.6), dry_friction(0.09 / MAZE.track_radius(ring)), viscous_friction(0.3),
                         quadratic_drag(2.0 * MAZE.track_radius(ring))))
        for ring in (1, 2, 3)
    }  # fmt: skip
    rig = replace(load_model("toy"), balls=rings, tilt_sensor=TiltSensor(gain_beta=1.25), processes={})
    assert bead_values(rig, MAZE, "rolling") == pytest.approx([0.15] * 3)
    assert bead_values(rig, MAZE, "viscous") == pytest.approx([0.5] * 3)
    assert bead_values(rig, MAZE, "quadratic") == pytest.approx([2.0 / 0.6] * 3)
    assert bead_values(rig, MAZE, "inertia") == pytest.approx([1.0 / 0.6 - 1.0] * 3)
    assert bead_values(rig, MAZE, "gain_beta") == pytest.approx([0.8])
    assert bead_values(rig, MAZE, "delay") == (rig.camera_delay,)
    for nothing in ("wall", "tilt_beta", "noise", "restitution", "cross_beta"):
        assert bead_values(rig, MAZE, nothing) == ()


def test_a_noise_at_its_bound_is_not_written_and_is_the_usual_one_then():
    rig = load_model("toy")
    for end in (PARAMETERS["strike"].low, PARAMETERS["strike"].high):
        held = with_body(rig, with_values(body_of(rig), {"strike": end}), {})
        assert "strike" not in held.body.values
        assert body_of(held).wander.strike == BodyModel().wander.strike
