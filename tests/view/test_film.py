"""A film shows the run: as long as it, the ball where it is, and the tree as it changes."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from commands import call

from mazeplan.apps.view.film import END_S, HZ, at_even_times, write_film
from mazeplan.apps.view.story import Moment, moments
from mazeplan.maze.mapfile import load_map
from mazeplan.run.execution import navigate

MAZE, SHORT_END_S = load_map("cme"), 0.3


@pytest.fixture(scope="module")
def messages():
    """Of a run from ring 4 to ring 5 (simulated)."""
    told = []
    navigate(4, 5, map=MAZE, rig="ideal", seed=1, feed=lambda topic, t, document: told.append((topic, document)))
    return told


@pytest.fixture
def shorter_end(monkeypatch):
    """The last frame stays for less long."""
    monkeypatch.setattr("mazeplan.apps.view.film.END_S", SHORT_END_S)


@pytest.mark.slow
@pytest.mark.usefixtures("shorter_end")
def test_a_gif_is_as_long_as_the_run_and_moves(messages, tmp_path):
    image = pytest.importorskip("PIL.Image")
    write_film(messages, tmp_path / "run.gif")
    shown = moments(messages)
    with image.open(tmp_path / "run.gif") as film:
        pictures = []
        for k in range(film.n_frames):
            film.seek(k)
            pictures.append((np.asarray(film.convert("RGB"), dtype=float), film.info["duration"]))
    took = sum(duration for _, duration in pictures) / 1000.0
    assert took == pytest.approx(shown[-1].t - shown[0].t + SHORT_END_S, abs=2.5 / HZ)
    halves = [abs(a[0] - b[0]).mean(axis=(0, 2)) for a, b in pairwise(pictures)]
    moved = np.max(halves, axis=0)
    width = len(moved)
    assert moved[: width // 2].max() > 1.0  # the ball
    assert moved[width // 2 :].max() > 1.0  # the tree
    assert (tmp_path / "run.gif").stat().st_size < 2_000_000


def test_frames_come_at_even_times_and_the_last_one_stays():
    shown = [Moment(tick=k + 1, t=t) for k, t in enumerate((0.0, 0.1, 0.5, 0.6))]
    told = [moment.t for moment in at_even_times(shown, 10.0)]
    assert told[:7] == [0.0, 0.1, 0.1, 0.1, 0.1, 0.5, 0.6]
    assert set(told[7:]) == {0.6}
    assert len(told) == 6 + round(10.0 * END_S)


@pytest.mark.slow
@pytest.mark.usefixtures("shorter_end")
def test_navigate_writes_a_film(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    way = ("--from", "4", "--to", "5", "--rig", "ideal")
    status, _, told = call(monkeypatch, capsys, "navigate", *way, "--video", "a.gif")
    assert status == 0, told
    assert (tmp_path / "a.gif").read_bytes()[:4] == b"GIF8"
    assert call(monkeypatch, capsys, "navigate", "--view", "--video", "c.gif")[0] == 2
