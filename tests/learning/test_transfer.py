"""The physics of a model goes along into another maze; what was learned of places does not."""

from __future__ import annotations

from dataclasses import replace

import pytest

from mazeplan.learning.modelfile import load_model
from mazeplan.learning.rig_model import same_rings, transfer_model
from mazeplan.maze.mapfile import load_map
from mazeplan.physics.ball_model import BallModel
from mazeplan.physics.effects.ball import rolling_inertia
from mazeplan.run.resolve import resolve_model

CME, SEVEN, LOPSIDED = load_map("cme"), load_map("seven"), load_map("lopsided")
TOY = load_model("toy")


def test_in_the_maze_it_was_fitted_on_it_is_the_model_itself():
    assert transfer_model(TOY, CME, CME) is TOY
    assert resolve_model(None, "toy", CME).processes


@pytest.mark.parametrize("maze", [SEVEN, LOPSIDED, load_map("detour")], ids=lambda maze: maze.name)
def test_every_ring_of_another_maze_has_physics_and_nothing_learned(maze):
    model = resolve_model(None, "toy", maze)
    assert sorted(model.balls) == [ring.number for ring in maze.rings]
    assert model.planar(maze).scalars[1] == TOY.planar(CME).scalars[1]  # away from walls
    assert (model.kind, model.processes) == ("pi", {})
    assert (model.stage, model.camera_delay, model.delay_known) == (TOY.stage, TOY.camera_delay, True)
    for ring in maze.rings:
        ball = model.ball(ring.number)
        assert {effect.name for effect in ball.effects} <= {
            "rolling_inertia", "viscous_friction", "dry_friction", "tilt_offset", "quadratic_drag"
        }  # fmt: skip
        assert ball.parameter("tilt_offset", "beta", 0.0) == pytest.approx(
            TOY.ball(1).parameter("tilt_offset", "beta", 0), rel=0.2
        )


def test_dry_friction_is_the_same_force_and_rolling_the_same_factor():
    model = resolve_model(None, "toy", SEVEN)
    outer, like = model.ball(1), TOY.ball(1)  # the widest ring there is in either
    force = outer.parameter("dry_friction", "coefficient", 0.0) * SEVEN.track_radius(1)
    assert force == pytest.approx(like.parameter("dry_friction", "coefficient", 0.0) * CME.track_radius(1))
    for effect, parameter in (("rolling_inertia", "factor"), ("viscous_friction", "coefficient")):
        assert outer.parameter(effect, parameter, 0.0) == like.parameter(effect, parameter, 1.0)


def test_what_was_fitted_for_the_disc_is_for_the_disc_whatever_its_number():
    disc = BallModel((rolling_inertia(0.7),))
    model = transfer_model(replace(TOY, balls={**TOY.balls, 5: disc}), CME, SEVEN)
    assert model.ball(7).parameter("rolling_inertia", "factor", 0.0) == 0.7
    assert model.ball(5).parameter("rolling_inertia", "factor", 0.0) != 0.7


def test_a_map_that_was_measured_again_has_the_same_rings_and_one_with_another_count_has_not():
    assert same_rings(CME, CME)
    assert not same_rings(CME, SEVEN)
    assert not same_rings(LOPSIDED, CME)
