"""`map learn`."""

from __future__ import annotations

import csv
import json
import math
import re
from functools import partial

import numpy as np
import pytest
from commands import plain

from mazeplan.core.logs.run_log import RunLogWriter
from mazeplan.core.records import Command, Observation
from mazeplan.maze.mapfile import dump_map, load_map

TRUTH = load_map("lopsided")
BALL = TRUTH.ball.radius
NOISE = 5e-4  # m
DT = 1.0 / 30.0


@pytest.fixture
def learn(call, tmp_path):
    """`map learn` into map.yaml, again and again."""
    return partial(call, "map", "learn", "--force", "-o", tmp_path / "map.yaml")


def places(openings=TRUTH.openings, times=4, seed=0):
    """x, y (N,) m of a ball that rides the walls of each ring and goes through each opening inwards and outwards."""
    rng = np.random.default_rng(seed)
    bands = [(max(r.inner_radius + BALL * (not r.is_disc), 0.0), r.outer_radius - BALL) for r in TRUTH.rings]
    r, theta = [], []

    def ride(ring, start, end, n=60):
        low, high = bands[ring - 1]
        lean = rng.permutation(np.repeat([low or high, high, math.nan], n // 3))
        r.extend(np.where(np.isfinite(lean), lean, rng.uniform(low, high, len(lean))).tolist())
        theta.extend(np.linspace(start, end + 2 * math.pi, len(lean)).tolist())

    def cross(opening, inwards):
        radii = np.linspace(bands[opening.outer - 1][0], bands[opening.inner - 1][1], 6)
        r.extend((radii if inwards else radii[::-1]).tolist())
        theta.extend([opening.angle + rng.uniform(-8e-4, 8e-4) / float(radii.mean())] * 6)

    for _ in range(times):
        for outer in (1, 2):
            for opening in (o for o in openings if o.outer == outer):
                ride(outer, 0.0, opening.angle)
                cross(opening, True)
                ride(outer + 1, opening.angle, opening.angle)
                cross(opening, False)
            way = next(o for o in TRUTH.openings if o.outer == outer)
            ride(outer, 0.0, way.angle)
            if outer == 1:
                cross(way, True)
        ride(2, way.angle, TRUTH.openings[0].angle)
        cross(TRUTH.openings[0], False)
    xy = np.array(r) * np.array([np.cos(theta), np.sin(theta)])
    return xy + rng.normal(0.0, NOISE, xy.shape)


def write_csv(path, x, y, scale=1.0, columns=("t", "x", "y", "beta", "gamma")):
    with path.open("w", newline="") as stream:
        rows = csv.writer(stream)
        rows.writerow(columns)
        for k, (a, b) in enumerate(zip(x, y, strict=True)):
            rows.writerow([k * DT, a * scale, b * scale, 0.0, 0.0][: len(columns)])
    return path


@pytest.fixture(scope="module")
def table(tmp_path_factory):
    return write_csv(tmp_path_factory.mktemp("logs") / "run.csv", *places())


def test_a_table_becomes_a_map_with_its_openings(learn, table, tmp_path):
    code, out, err = learn(table)
    assert (code, err) == (0, f"wrote {tmp_path / 'map.yaml'}\n")
    maze = load_map(tmp_path / "map.yaml")
    assert [(o.outer, o.inner) for o in maze.openings] == [(o.outer, o.inner) for o in TRUTH.openings]
    for found, true in zip(maze.openings, TRUTH.openings, strict=True):
        assert found.angle == pytest.approx(true.angle, abs=math.radians(2.0))
    for found, true in zip(maze.rings, TRUTH.rings, strict=True):
        assert found.outer_radius == pytest.approx(true.outer_radius, abs=3e-4)
    lines = out.splitlines()
    assert len(lines) == 1 + 3 + 1 + 5 + 1  # two tables with their headings, and the camera
    assert sum(line.startswith("1-2  ") for line in lines) == 3


def test_the_document_has_the_figures_of_the_tables(learn, table, tmp_path):
    _, out, err = learn(table, "--json", terminal=True)
    got = json.loads(out)
    assert re.search(r"learning a map .*", plain(err))
    assert (got["map"], got["prior"]) == (str(tmp_path / "map.yaml"), "the packaged map cme")
    assert (got["problems"], got["skipped"]) == ([], 0)
    assert [o["outer"] for o in got["openings"]] == [1] * 3 + [2] * 2
    assert sum(o["count"] for o in got["openings"]) == got["passages"]
    for opening in got["openings"]:
        assert opening["problem"] == ""
    assert got["noise"] == pytest.approx(NOISE, abs=1e-4)
    again = tmp_path / "again.csv"
    again.write_text(table.read_text() + "\n")
    twice = json.loads(learn(table, again, "--json")[1])  # the end of a log is no passage
    assert twice["passages"] == 2 * got["passages"]
    assert "run.csv, again.csv" in (tmp_path / "map.yaml").read_text()


def test_a_run_log_supplies_its_own_map(learn, tmp_path):
    path, (x, y) = tmp_path / "run.mcap", places()
    heavy = dump_map(TRUTH).replace("mass_g: 8.4", "mass_g: 9.5")
    with RunLogWriter(path, {"rig": "toy", "seed": 3, "map": heavy}) as writer:
        for k, (a, b) in enumerate(zip(x.tolist(), y.tolist(), strict=True)):
            lost = k % 200 == 199
            o = Observation(k * DT, None if lost else a, None if lost else b, 0.0, 0.0)
            writer.sample(o, Command(0.0, 0.0), segment=0)
    got = json.loads(learn(path, "--json")[1])
    assert got["prior"] == "the log's map lopsided"
    assert got["samples"] == sum(k % 200 != 199 for k in range(len(x)))
    assert load_map(tmp_path / "map.yaml").ball.mass == pytest.approx(0.0095)
    learn(path, "--map", "cme")
    assert load_map(tmp_path / "map.yaml").ball.mass == pytest.approx(0.0084)
