from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from mazeplan.core.errors import TableError
from mazeplan.maze.bands import Bands, Edges, fit_bands
from mazeplan.maze.geometry import RadialWall
from mazeplan.maze.learnedmap import learn_map, map_text
from mazeplan.maze.mapfile import load_map
from mazeplan.maze.transitions import BallTrack, cluster, find_openings, find_passages, rings_of

TRUTH = load_map("lopsided")  # what is to be found; the prior is another map with the same ball
PRIOR = load_map("cme")
BALL = TRUTH.ball.radius
DT = 1.0 / 30.0
BANDS = Bands(
    tuple(Edges(0.0 if r.is_disc else r.inner_radius + BALL, r.outer_radius - BALL, 100.0, 100.0) for r in TRUTH.rings),
    (0.0, 0.0),
    5e-4,
)


class Journey:
    """A ball that goes round in rings, leaning on either wall, and through openings; all moves noted as samples."""

    def __init__(self, seed=0, bands=BANDS):
        self.rng, self.bands = np.random.default_rng(seed), bands
        self.r, self.theta, self.segment = [], [], []
        self.ring, self.angle, self.stretch = 1, 0.0, 0

    def add(self, r, theta):
        r, theta = np.broadcast_arrays(np.atleast_1d(np.asarray(r, float)), np.asarray(theta, float))
        self.r += r.tolist()
        self.theta += theta.tolist()
        self.segment += [self.stretch] * r.size
        return self

    def round(self, to, n=60):
        """Once round the ring and on to an angle: a third each at the inner wall, the outer wall and between."""
        edges = self.bands.edges[self.ring - 1]
        third = n // 3
        between = self.rng.uniform(edges.low, edges.high, n - 2 * third)
        r = np.concatenate([np.full(third, edges.low or edges.high), between, np.full(third, edges.high)])
        end = self.angle + 2 * math.pi + (to - self.angle) % (2 * math.pi)
        self.add(r, np.linspace(self.angle, end, n))
        self.angle = to
        return self

    def through(self, angle, to, *, play=0.8e-3, side=None, step=4e-3):
        """Through the wall between this ring and ring `to`, up to `play` m beside the middle; side: leaning there."""
        a, b = self.bands.edges[self.ring - 1], self.bands.edges[to - 1]
        start, end = (a.low, b.high) if to > self.ring else (a.high, b.low)
        r = np.linspace(start, end, 2 + int(abs(end - start) / step))
        beside = self.rng.uniform(-play, play) if side is None else side * play
        self.add(r, angle + beside / r)
        self.ring, self.angle = to, angle
        return self

    def place(self, ring, angle):
        """A person takes the ball and places it: a new segment."""
        self.stretch += 1
        self.ring, self.angle = ring, angle
        return self

    def track(self, noise=0.5e-3, centre=(0.0, 0.0)):
        r, theta = np.array(self.r), np.array(self.theta)
        x = r * np.cos(theta) + self.rng.normal(0.0, noise, len(r)) + centre[0]
        y = r * np.sin(theta) + self.rng.normal(0.0, noise, len(r)) + centre[1]
        return BallTrack(np.arange(len(r), dtype=float) * DT, x, y, np.array(self.segment, float))


def wander(passages, seed=0, openings=TRUTH.openings, **how):
    """From ring to ring through openings taken in turn, all of them equally often."""
    journey = Journey(seed)
    used = dict.fromkeys(range(len(openings)), 0)
    for _ in range(passages):
        choices = [i for i, o in enumerate(openings) if journey.ring in (o.outer, o.inner)]
        i = min(choices, key=lambda i: (used[i], journey.rng.random()))
        used[i] += 1
        journey.round(openings[i].angle).through(openings[i].angle, openings[i].leads_to(journey.ring), **how)
    return journey.round(0.0)


def learn(track, **options):
    return learn_map(track, PRIOR, prior_name="map cme", **options)


def passages_of(journey, noise=0.0):
    return find_passages(journey.track(noise), BANDS)


def off(a, b):
    return abs((a - b + 180.0) % 360.0 - 180.0)


@pytest.fixture(scope="module")
def learned():
    return learn(wander(80).track(centre=(2e-3, -1.5e-3)))


def test_rings_come_back_in_spite_of_noise_and_a_camera_off_centre(learned):
    assert len(learned.rings) == 3
    for ring, true in zip(learned.rings, TRUTH.rings, strict=True):
        assert ring.inner_radius == pytest.approx(true.inner_radius, abs=2e-4)
        assert ring.outer_radius == pytest.approx(true.outer_radius, abs=2e-4)
        assert ring.outer_stderr < 1e-4
    assert learned.rings[-1].inner_radius == 0.0
    assert learned.centre == pytest.approx((2e-3, -1.5e-3), abs=1e-4)
    assert learned.noise == pytest.approx(5e-4, abs=5e-5)


def test_the_noise_of_another_camera_is_found():
    track = wander(40).track(noise=0.25e-3)
    assert fit_bands(track.x, track.y, BALL).noise == pytest.approx(0.25e-3, abs=0.03e-3)


def test_known_openings_come_back_with_their_uncertainty(learned):
    assert learned.problems == ()
    assert [(o.outer, o.inner) for o in learned.maze.openings] == [(o.outer, o.inner) for o in TRUTH.openings]
    assert sum(o.count for o in learned.openings) == learned.passages == 80
    for found, true in zip(learned.openings, TRUTH.openings, strict=True):
        assert off(math.degrees(found.angle), math.degrees(true.angle)) < 2.0
        assert off(math.degrees(found.angle), math.degrees(true.angle)) < 4.0 * math.degrees(found.angle_stderr)
        assert math.degrees(found.angle_stderr) < 1.0


def test_what_a_log_cannot_tell_is_the_priors(learned):
    maze = learned.maze
    assert (maze.ball, maze.tilt_limit, maze.wall_height) == (PRIOR.ball, PRIOR.tilt_limit, PRIOR.wall_height)
    assert {o.width for o in maze.openings} == {0.01485}  # m; the median of map cme


def test_the_file_says_where_everything_is_from_and_can_be_loaded(learned, tmp_path):
    path = tmp_path / "learned.yaml"
    path.write_text(map_text(learned, ["a.mcap", "b\nrings: []"]))
    assert load_map(path) == learned.maze
    text = path.read_text()
    assert text.startswith("# Learned from where the ball was: a.mcap, 'b\\nrings: []'\n")
    assert "x 2.0" in text
    assert "is from map cme" in text


def test_one_opening_passed_both_ways_is_one_opening():
    journey = Journey().round(1.0).through(1.0, 2).round(1.0).through(1.0, 1).round(0.5)
    passages = passages_of(journey)
    assert passages.wall.tolist() == [1, 1]
    (opening,) = find_openings(passages, BANDS, BALL, [0.015, 0.015])
    assert (opening.count, opening.problem) == (2, "")
    assert opening.angle == pytest.approx(1.0, abs=0.8e-3 / 0.0484)  # rad: its play in the wall


def test_a_lone_passage_is_told_but_not_written():
    # the first opening is passed once, by a ball that is then placed back in ring 1
    journey = wander(60, openings=TRUTH.openings[1:])
    once = TRUTH.openings[0].angle
    journey.place(1, 0.0).round(once).through(once, 2).round(0.0)
    track = journey.track()
    learned = learn(track)
    assert learned.maze is not None
    assert len(learned.maze.openings) == 4
    (lone,) = [o for o in learned.openings if o.problem]
    assert off(math.degrees(lone.angle), math.degrees(once)) < 3.0
    assert lone.problem == "1 passage, fewer than 2"
    taken = learn(track, min_count=1).maze
    assert taken is not None
    assert len(taken.openings) == 5


def test_openings_20_degrees_apart_are_two():
    journey = Journey()
    for k in range(20):
        angle = math.radians(350.0 if k % 4 < 2 else 10.0)
        journey.round(angle).through(angle, 1 + (k + 1) % 2)
    track = journey.round(0.0).track()
    found = find_openings(find_passages(track, BANDS), BANDS, BALL, [0.015, 0.015])
    assert [o.count for o in found] == [10, 10]
    assert [off(math.degrees(o.angle), expected) < 1.0 for o, expected in zip(found, (10, 350), strict=True)] == [
        True
    ] * 2


def test_clusters_go_round_past_180_degrees():
    angle = np.array([math.pi - 0.02, -math.pi + 0.02, 0.0])
    label = cluster(angle, 0.05, BALL)
    assert label[0] == label[1] != label[2]


def test_an_opening_without_room_beside_a_better_one_is_left_out():
    journey = Journey()
    for k in range(8):
        angle = 1.0 if k < 6 else 1.0 + 0.012 / 0.0484  # 12 mm further on along the wall; openings are 15 wide
        journey.round(angle).through(angle, 1 + (k + 1) % 2, play=0.0)
    good, bad = find_openings(passages_of(journey.round(0.0)), BANDS, BALL, [0.015, 0.015])
    assert (good.count, good.problem) == (6, "")
    assert bad.problem == "overlaps the opening at 57.3 deg"


def test_a_placed_ball_has_passed_nothing():
    journey = Journey().round(0.0).place(2, 1.0).round(0.0).place(3, 1.0).round(0.0)
    passages = passages_of(journey)
    assert (len(passages.wall), passages.skipped) == (0, 0)


def test_a_jump_in_one_segment_is_no_passage():
    journey = Journey().round(0.0)
    journey.ring, journey.angle = 2, 2.0
    passages = passages_of(journey.round(0.0))
    assert (len(passages.wall), passages.skipped) == (0, 1)


def test_a_ball_that_turns_back_in_the_opening_has_not_passed():
    low, high = BANDS.edges[0].low, BANDS.edges[1].high
    middle = 0.5 * (low + high)
    there = np.concatenate([np.linspace(low, high + 1e-3, 8), [middle - 1e-3, middle + 1e-3] * 5])
    journey = Journey().round(1.0).add(there, 1.0).add(np.linspace(middle, low, 5), 1.0).round(0.0)
    assert len(passages_of(journey).wall) == 0


def test_noise_in_the_middle_of_a_wall_is_one_passage():
    middle = 0.5 * (BANDS.edges[0].low + BANDS.edges[1].high)
    journey = Journey().round(1.0).add([0.0555, 0.052, *([middle - 1e-3, middle + 1e-3] * 5), 0.044, 0.0405], 1.0)
    journey.ring = 2
    assert len(passages_of(journey.round(0.0)).wall) == 1


def test_one_wrong_position_is_no_passage():
    journey = Journey().round(1.0).add(0.039, 1.0).round(1.0)  # one sample in ring 2
    assert len(passages_of(journey).wall) == 0


def test_a_change_while_the_ball_was_not_seen_cannot_be_placed():
    for lost, expected in ((2, (1, 0)), (12, (0, 1))):
        track = Journey().round(1.0).through(1.0, 2, step=2e-3).round(0.0).track(0.0)
        keep = np.ones(len(track.t), bool)
        keep[65 - lost // 2 : 65 + (lost + 1) // 2] = False
        passages = find_passages(BallTrack(track.t[keep], track.x[keep], track.y[keep], track.segment[keep]), BANDS)
        assert (len(passages.wall), passages.skipped) == expected


def test_rings_of_radii():
    r = np.array([0.0, 0.0196, 0.028, 0.0387, 0.0484, 0.058, 0.0605, 0.08])
    assert rings_of(r, BANDS).tolist() == [3, 3, 0, 2, 0, 1, 1, 0]


def test_a_wall_that_was_never_passed_is_a_problem():
    journey = wander(40, openings=TRUTH.openings[:3]).place(3, 0.0).round(2.0).round(4.0).round(6.0)
    learned = learn(journey.track())
    assert learned.maze is None
    assert learned.problems == ("no opening between ring 2 and 3: none was passed",)
    with pytest.raises(ValueError, match="no opening between ring 2 and 3"):
        map_text(learned)


def test_a_ring_in_which_the_ball_never_was_makes_a_suspicious_wall():
    five = tuple(
        Edges(0.0 if r.is_disc else r.inner_radius + BALL, r.outer_radius - BALL, 1.0, 1.0) for r in PRIOR.rings
    )
    journey = Journey(bands=Bands(five, (0.0, 0.0), 5e-4))
    for ring in (1, 2, 4, 5):
        journey.place(ring, 0.0).round(0.0).round(0.0).round(0.0)
    learned = learn(journey.track())
    assert len(learned.rings) == 4
    assert learned.warnings == (
        "the wall between ring 2 and 3 would be 25 mm thick: was there a ring in which the ball never was?",
    )


def test_tracks_that_show_no_rings():
    track = Journey().round(0.0).track()
    with pytest.raises(TableError, match="the ball was seen in 60 samples, expected at least 200"):
        fit_bands(track.x, track.y, BALL)
    one = Journey().round(0.0, n=400).track()
    with pytest.raises(TableError, match="seen in 1 ring, expected at least 2: record with `mazeplan collect --rings`"):
        fit_bands(one.x, one.y, BALL)
    two = Journey().round(0.0, n=400).place(2, 0.0).round(0.0, n=400).track()
    with pytest.raises(TableError, match=r"radius of 3[89] mm, expected a disc"):
        fit_bands(two.x, two.y, BALL)
    with pytest.raises(TableError, match="seen 59 m from the centre, expected at most 2 m"):
        fit_bands(np.full(200, 59.0), np.zeros(200), BALL)
    with pytest.raises(TableError, match="min_count: got 0, expected at least 1"):
        learn(wander(40).track(), min_count=0)


def test_radial_walls_are_the_priors_where_they_fit_and_it_is_said():
    track = wander(60).track()
    wall = RadialWall("bar", 1, math.radians(320.0), 0.004)
    prior = replace(TRUTH, radial_walls=(wall,))
    found = learn_map(track, prior, prior_name="map mine")
    assert found.maze is not None
    assert found.maze.radial_walls == (wall,)
    assert found.warnings[-1] == "radial walls, which no log shows, are those of map mine"
    before = replace(prior, radial_walls=(replace(wall, angle=TRUTH.openings[0].angle),))
    found = learn_map(track, before, prior_name="map mine")
    assert found.maze is not None
    assert found.maze.radial_walls == ()
    assert "left out: stands in front of openings[0]" in found.warnings[-1]
    other = replace(PRIOR, radial_walls=(wall,))
    assert "left out: it has 5 rings" in learn_map(track, other, prior_name="map cme").warnings[-1]
