"""What `learn` and `score` say in the end: a word, the number behind it, and what to do next."""

from __future__ import annotations

import json
import re
from dataclasses import replace

import numpy as np
import pytest
from planar_rig import PlanarRig

from mazeplan.core.logs.table import read_table
from mazeplan.learning.identification import effect_ball, fit_rig
from mazeplan.learning.model_score import ring_errors
from mazeplan.learning.modelfile import save_model
from mazeplan.maze.mapfile import load_map
from mazeplan.run.collect import Collection, run_collection

MAZE = load_map("cme")


@pytest.fixture(scope="module")
def log(tmp_path_factory):
    """60 s of the planar rig, excited in ring 2."""
    path = tmp_path_factory.mktemp("logs") / "log.mcap"
    run_collection(PlanarRig(MAZE), MAZE, Collection(60.0, (2,), seed=2), path)
    return path


@pytest.fixture(scope="module")
def fit(log):
    return fit_rig(read_table(log), MAZE)


@pytest.fixture(scope="module")
def fitted(fit):
    return fit.model


@pytest.mark.slow
def test_a_fitted_model_is_better_than_none_and_one_that_hardly_feels_gravity_is_poor(log, fitted):
    tables = [read_table(log)]
    rings = ring_errors(fitted, tables, MAZE)
    assert rings[2].verdict in ("good", "fair")
    assert rings[2].noise < rings[2].error < 0.5 * rings[2].persistence
    light = replace(fitted, balls=dict.fromkeys(fitted.balls, effect_ball([0.05, 0, 0, 0, 0], [0] * 5)))
    wrong = ring_errors(light, tables, MAZE)[2]
    assert wrong.verdict == "poor"
    assert (wrong.windows, wrong.persistence, wrong.noise) == (
        rings[2].windows,
        rings[2].persistence,
        rings[2].noise,
    )


def test_lost_pictures_cost_a_score_hardly_any_windows(log, fitted):
    whole = read_table(log)
    lost = np.random.default_rng(0).random(len(whole)) < 0.05
    columns = {name: np.where(lost, np.nan, whole[name]) for name in ("x", "y", "theta", "r")}
    now, before = (ring_errors(fitted, [table], MAZE)[2] for table in (
        replace(whole, columns={**whole.columns, **columns}), whole))  # fmt: skip
    assert now.windows > 0.9 * before.windows
    assert now.error == pytest.approx(before.error, rel=0.1)


def test_a_log_without_tilts_is_judged_by_its_commands(log, fitted):
    whole = read_table(log)
    blind = replace(whole, columns={**whole.columns, **dict.fromkeys(("beta", "gamma"), np.full(len(whole), np.nan))})
    now, before = (ring_errors(fitted, [table], MAZE)[2] for table in (blind, whole))
    assert now.windows == before.windows
    assert now.error == pytest.approx(before.error, rel=0.2)


def test_score_prints_the_errors_and_the_verdict(call, log, fitted, tmp_path):
    save_model(fitted, tmp_path / "model")
    code, out, _ = call("score", tmp_path / "model", log)
    assert code == 0
    because, *_, advice = out.splitlines()
    assert re.match(r"(Good|Fair): after 40 samples \(1\.33 s\) the angle is off by 0\.", because)
    assert f"--model {tmp_path / 'model'}" in advice
    code, out, _ = call("score", tmp_path / "model", log, "--json")
    document = json.loads(out)
    assert document["steps"] == 40
    assert because.lower().startswith(f"{document['verdict']}: ")
    assert document["error"] < 0.5 * document["persistence"]
    assert f"{document['error']:.3f} rad" in because
    assert document["because"].endswith("; the log says nothing of ring 4")
