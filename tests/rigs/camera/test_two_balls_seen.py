"""Two balls that look alike: both are found, and each keeps its name."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from mazeplan.maze.mapfile import load_map
from mazeplan.rigs.camera.detector import DetectionOutcome
from mazeplan.rigs.camera.sensing import overhead
from mazeplan.rigs.camera.tracks import MEMORY, REACH, Tracks
from mazeplan.rigs.sim.simulated import SimulatedRig

MAZE = load_map("cme")
TWO = replace(MAZE, balls=2)


def on_track(ring, degrees):
    r, angle = MAZE.track_radius(ring), math.radians(degrees)
    return np.array([r * math.cos(angle), r * math.sin(angle), MAZE.ball.radius])


@pytest.fixture(scope="module")
def eye():
    return overhead(MAZE)


@pytest.mark.parametrize("places", [((1, 30.0), (1, 200.0)), ((2, 80.0), (4, 300.0)), ((1, 30.0), (1, 45.0))])
def test_both_are_found_in_one_picture(eye, places):
    renderer, finder = eye
    balls = [on_track(*place) for place in places]
    picture = renderer.render(balls[0], 0.02, -0.01, np.random.default_rng(0), others=(balls[1],))
    found = finder.locate_all(picture, 2)
    assert len(found) == 2
    for ball in balls:
        assert min(math.dist((seen.x, seen.y), ball[:2]) for seen in found) < 0.0004
    assert finder.locate(picture).why is DetectionOutcome.TWO  # for one ball they are no result, as before


def test_no_more_are_found_than_there_are(eye):
    renderer, finder = eye
    picture = renderer.render(on_track(3, 10.0), 0.0, 0.0, np.random.default_rng(0))
    (only,) = finder.locate_all(picture, 2)
    assert math.dist((only.x, only.y), on_track(3, 10.0)[:2]) < 0.0004
    assert len(finder.locate_all(picture, 0)) == 0


def test_sightings_go_to_the_balls_whatever_their_order():
    tracks = Tracks([(0.0, 0.0), (0.1, 0.0)])
    assert tracks.take(0.0, [(0.1, 0.001), (0.001, 0.0)]) == [(0.001, 0.0), (0.1, 0.001)]
    assert tracks.take(1 / 30, [(0.1, 0.002)]) == [None, (0.1, 0.002)]
    assert tracks.take(2 / 30, []) == [None, None]
    assert tracks.take(3 / 30, [(0.5, 0.5), (0.002, 0.0)]) == [(0.002, 0.0), None]


def test_balls_that_pass_each_other_keep_their_names():
    """At 0.4 m/s and a diameter's distance the sighting nearest to a ball's last one is that of the other ball."""
    tracks, nearest = Tracks([(-0.046, 0.0), (0.046, 0.012)]), []
    for k in range(8):
        one, other = (-0.046 + 0.4 * k / 30, 0.0), (0.046 - 0.4 * k / 30, 0.012)
        before = (one[0] - 0.4 / 30, 0.0)
        nearest.append(math.dist(before, one) < math.dist(before, other))
        assert tracks.take(k / 30, [other, one] if k % 2 else [one, other]) == [one, other]
    assert not all(nearest)


def test_a_ball_that_was_hidden_is_taken_up_again_where_it_may_have_gone():
    tracks = Tracks([(0.0, 0.0), (0.1, 0.0)])
    for k in range(4):
        tracks.take(k / 30, [(0.005 * k, 0.0), (0.1, 0.0)])
    for k in range(4, 8):
        assert tracks.take(k / 30, [(0.1, 0.0)]) == [None, (0.1, 0.0)]
    assert tracks.take(8 / 30, [(0.04, 0.0), (0.1, 0.0)]) == [(0.04, 0.0), (0.1, 0.0)]


def test_what_is_too_far_from_every_ball_is_none_of_them():
    tracks = Tracks([(0.0, 0.0)])
    assert tracks.take(0.0, [(1.5 * REACH, 0.0)]) == [None]
    assert tracks.take(MEMORY, [(1.5 * REACH, 0.0)]) == [(1.5 * REACH, 0.0)]  # by now it may be there


@pytest.mark.slow
def test_a_rig_with_pictures_measures_both_balls():
    rig = SimulatedRig(TWO, {"sense": "camera"})
    rig.reset(ring=1, theta=0.3, rng=np.random.default_rng(0))
    commands = np.repeat(np.random.default_rng(1).uniform(-1.0, 1.0, (6, 2)) * MAZE.tilt_limit, 10, axis=0)
    off, unseen = [], 0
    for command in commands.tolist():
        sample = rig.observe()
        for ball, place in zip((sample, *sample.others), (rig.truth(), *rig.others()), strict=True):
            unseen += not ball.seen
            off += [math.dist((ball.x, ball.y), place[:2])] if ball.seen else []
        rig.command(*command)
    assert unseen < 6
    assert np.sqrt(np.mean(np.square(off))) < 3e-4
    assert max(off) < MAZE.ball.radius  # none swapped


@pytest.mark.slow
def test_the_same_seed_gives_the_same_measurements():
    def measured():
        rig = SimulatedRig(TWO, {"sense": "camera"})
        rig.reset(ring=2, theta=1.0, rng=np.random.default_rng(4))
        return [rig.observe() for _ in range(3)]

    assert measured() == measured()


def test_a_ball_that_hides_again_is_not_taken_for_the_one_behind_it():
    step, gap = 0.012, 0.0127  # m: a picture later the ball behind is where the one in front was
    tracks = Tracks([(gap, 0.09), (0.0, 0.09)])
    for k in range(1, 4):
        front, behind = (gap + k * step, 0.09), (k * step, 0.09)
        assert tracks.take(k / 30, [behind, front]) == [front, behind]
    for k in (4, 5, 6):
        behind = (k * step, 0.09)
        assert tracks.take(k / 30, [behind]) == [None, behind]
    front, behind = (gap + 7 * step, 0.09), (7 * step, 0.09)
    assert tracks.take(7 / 30, [front, behind]) == [front, behind]
