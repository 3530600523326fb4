"""Records that others measured on hardware, where they are at hand, and the axis of the benchmark EMPS."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from bench_measured import diagnosed, is_right, measured_folder

from mazeplan.diagnosis.engine.emps import Axis, emps_result, read_drive
from mazeplan.diagnosis.engine.system import system_of

FOLDER = measured_folder()
ANSWERS = json.loads((FOLDER / "answers.json").read_text()) if FOLDER else {}


@pytest.mark.slow
@pytest.mark.skipif(FOLDER is None, reason="the measured records are not here")
@pytest.mark.parametrize("table", ANSWERS)
def test_the_right_effects_are_named(table):
    assert FOLDER is not None
    done = diagnosed(FOLDER, table)
    assert is_right(done, ANSWERS[table]), done.sentence()


@pytest.mark.slow
def test_the_published_friction_is_found_on_the_measured_axis():
    """Published: 4.08 % with symmetric, 3.11 % with direction-dependent friction."""
    roots = Path(__file__).resolve().parents[2:4]
    path = next((p for home in roots if (p := home / "shared/data/emps/DATA_EMPS.mat").is_file()), None)
    if path is None:
        pytest.skip("the record of the benchmark EMPS is not here")
    record, _ = read_drive(path)
    done = emps_result(system_of(Axis), record, {}, (), None)
    found = {e["name"]: e["parameters"]["coefficient"]["stderr"] for e in done.effects}
    assert {"dry_friction", "viscous_friction", "viscous_asymmetry"} == set(found)
    assert found["viscous_friction"] > 0.5  # N s/m; where the axis stops, a derivative says .1
    assert done.after.nrmse < 0.0311
    assert done.after.free_run < 0.01
