"""What a rig was like, beside its model: written, read again, and refused where it is wrong."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mazeplan.control.estimation.rigid_body_filter import BodyModel
from mazeplan.control.estimation.rigid_body_fit import with_values
from mazeplan.core.errors import ModelError
from mazeplan.core.logs.table import Table
from mazeplan.diagnosis.rig.fitting import Reference
from mazeplan.diagnosis.rig.reference import (
    KEPT,
    NAME,
    RECORD,
    RigReference,
    known_reference,
    load_reference,
    save_reference,
)
from mazeplan.diagnosis.stage.comparison import Known
from mazeplan.learning.modelfile import RigModel, load_model, model_names, save_model
from mazeplan.maze.mapfile import load_map
from mazeplan.physics.effect import Term
from mazeplan.physics.effects.ball import viscous_friction
from mazeplan.physics.effects.local_forces import floor_bump
from mazeplan.physics.rig.stage import StageAxis, StageModel

MAZE = load_map("cme")
MODEL = RigModel.nominal(MAZE)
BODY = with_values(BodyModel(), {"rolling": 0.0631, "offset_x": -0.0021, "delay": 0.0667, "wall": 0.23})
BUMP = Term(floor_bump, (0.05, -0.07, 0.02, 0.015))
KNOWN = RigReference(
    Reference(BODY._replace(terms=(BUMP,)), {"rolling": 6e-4, "wall": 0.003}), Known.of_model(MODEL), 0.02, 1.08,
    errors={1: 0.035, 4: 0.18},
)  # fmt: skip


def test_what_is_written_is_read_again(tmp_path):
    save_model(MODEL, tmp_path)
    save_reference(KNOWN, MODEL, tmp_path)
    again = load_reference(tmp_path, MODEL)
    assert again is not None
    assert again.body.stderr == KNOWN.body.stderr
    assert again.body.model.terms == (BUMP,)
    assert (again.memory, again.remaining) == (0.02, 1.08)
    assert again.errors == {1: 0.035, 4: 0.18}
    for part in ("ball", "tilting", "view"):
        assert getattr(again.body.model, part)[:-1] == pytest.approx(getattr(BODY, part)[:-1], rel=1e-5)


def test_it_belongs_to_the_rings_that_the_model_had(tmp_path):
    save_reference(KNOWN, MODEL, tmp_path)
    ball = MODEL.ball(1)
    other = replace(MODEL, balls={**MODEL.balls, 1: replace(ball, effects=(*ball.effects, viscous_friction(0.4)))})
    assert load_reference(tmp_path, other) is None
    assert load_reference(tmp_path / "nowhere", MODEL) is None
    assert known_reference(tmp_path / "nowhere", MODEL, MAZE).body.open, "walls and spin are not told"


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("format: 1", "format: 2", "format: got 2, expected 1, which mazeplan"),
        ("value: 0.0631", "value: much", "body.rolling: value: got 'much', expected a number"),
        ("value: 0.0631", "value: 900", "expected a number from"),
        ("rolling:", "roling:", "body.roling: got roling, expected one of rolling, "),
        ("floor_bump:", "floor_dent:", "terms.floor_dent: got floor_dent, expected one of"),
        ("depth: 0.02", "depth: 9", "terms.floor_bump: depth: got 9"),
        ("body:", "body: [", "cannot be read"),
    ],
)
def test_a_file_that_is_wrong_is_told_with_its_place(tmp_path, old, new, message):
    path = save_reference(KNOWN, MODEL, tmp_path)
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new, 1))
    with pytest.raises(ModelError) as told:
        load_reference(tmp_path, MODEL)
    assert message in str(told.value)
    assert NAME in str(told.value)


def test_the_record_of_that_time_and_its_stage_are_kept(tmp_path):
    stage = StageModel(StageAxis.prompt(0.98, 0.05), StageAxis(1.01, 13.0, 1.0, order=1, stderr={"gain": 3e-4}))
    columns = np.random.default_rng(1).normal(size=(len(KEPT), 1200))
    table = Table(dict(zip(KEPT, columns, strict=True)) | {"t": np.arange(1200) / 30.0, "segment": np.zeros(1200)})
    was = replace(KNOWN, table=table, stage=Known.of_model(replace(MODEL, stage=stage)))
    save_reference(was, MODEL, tmp_path)
    again = known_reference(tmp_path, MODEL, MAZE)
    assert again.stage.kind == stage
    assert again.stage.kind.gamma.stderr == {"gain": 3e-4}
    assert again.table is not None
    for name in KEPT:
        np.testing.assert_array_equal(again.table[name], table[name])
    assert again.then is not None
    assert len(again.then.pictures) == 1200
    (tmp_path / RECORD).write_bytes(b"no archive")
    with pytest.raises(ModelError, match=NAME):
        load_reference(tmp_path, MODEL)


@pytest.mark.parametrize("name", model_names())
def test_packaged_models_know_what_their_rigs_are_like(name):
    kept = load_reference(name, load_model(name))
    assert kept is not None
    assert kept.remaining < 1.3
    assert kept.body.model.view.noise > 0.0
