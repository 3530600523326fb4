"""A model is judged by what a run would predict with it; parts that predict worse than a textbook are dropped."""

from __future__ import annotations

from dataclasses import replace

import pytest
from planar_rig import PlanarRig, known

from mazeplan.core.logs.table import read_table
from mazeplan.learning.modelfile import load_model
from mazeplan.learning.rigid_body_entries import stamp
from mazeplan.maze.mapfile import load_map
from mazeplan.physics.rig.stage import StageModel
from mazeplan.run.collect import Collection, run_collection
from mazeplan.run.commands.learn import later_part
from mazeplan.run.judge import judge

MAZE = load_map("cme")
GOOD = replace(known(MAZE), camera_delay_stderr=1e-3)


@pytest.fixture(scope="module")
def table(tmp_path_factory):
    """60 s of the planar rig."""
    path = tmp_path_factory.mktemp("logs") / "log.mcap"
    run_collection(PlanarRig(MAZE), MAZE, Collection(60.0, (1, 2, 3, 4, 5), seed=0), path)
    return read_table(path)


@pytest.fixture(scope="module")
def judged(table):
    """The judgement of a model."""
    return lambda model, **more: judge(model, table, MAZE, later_part(table), **more)


@pytest.fixture(scope="module")
def good(judged):
    return judged(GOOD)


def on_stage(**numbers):
    axes = {name: replace(getattr(GOOD.stage, name), **numbers) for name in ("beta", "gamma")}
    return replace(GOOD, stage=StageModel(**axes))


def test_a_good_model_keeps_all_parts(good):
    assert good.dropped == ()
    assert good.model == GOOD
    assert good.errors["learned"] < 0.2 * good.errors["nothing"]


@pytest.mark.parametrize("numbers", [{"natural_frequency": 2.0}, {"dead_time": 0.3}])
def test_a_stage_that_is_wrong_is_replaced_by_a_textbook_one(judged, good, numbers):
    done = judged(on_stage(**numbers))
    assert "stage" in done.dropped
    assert done.model.stage == StageModel()
    assert not done.model.delay_known, "it was identified on the wrong stage"
    assert done.model.balls == GOOD.balls
    assert done.errors["learned"] > 2.0 * good.errors["learned"]


def test_a_wrong_delay_is_judged_worse(judged, good):
    done = judged(replace(GOOD, camera_delay=0.2))
    assert done.errors["learned"] > 2.0 * good.errors["learned"]
    assert not done.model.delay_known or done.model.camera_delay != 0.2


def test_a_rigid_ball_on_a_rig_of_beads_loses_its_contact(judged):
    body = replace(load_model("toy").body, of=stamp(GOOD.balls))
    done = judged(replace(GOOD, body=body))
    assert done.errors["learned"] > done.errors["contact"]
    assert done.dropped == ("contact",)
    assert done.model == GOOD
