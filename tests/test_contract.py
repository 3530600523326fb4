"""The names that scripts, measurements and rigs of users rely on: commands, options, effects, rigs, Python, columns.

Everything else may be renamed. What the commands print as JSON is checked where each command is tested.
"""

from __future__ import annotations

from dataclasses import fields

import pytest
from typer.main import get_command

import mazeplan
from mazeplan.apps.cli.app import app
from mazeplan.core.logs.table_checks import KNOWN
from mazeplan.core.records import NavigationResult, Observation
from mazeplan.physics.registry import PACKAGED
from mazeplan.rigs.registry import rig_names

COMMANDS = {
    "navigate": "--from --to --map --rig --model --behavior --start-angle --seed --time-limit --log --view --json "
    "--policy --balls --via --video --behavior-module --force",
    "evaluate": "--runs --rig --model --seed --workers --dask --json --report",
    "collect": "--seconds --output --rig",
    "learn": "--output --kind --device",
    "compare": "--test --json",
    "diagnose": "--model --radius --declare --reference --ring --test --effects --system --output --json",
    "improve": "--rig --rounds --runs --json",
    "map check": "",
    "map show": "--output --log",
    "map route": "",
    "map learn": "--output",
    "log info": "",
    "log export": "--output",
    "log replay": "",
    "view": "",
    "report": "--output",
    "behavior check": "--behavior-module",
    "behavior show": "",
    "behavior list": "",
    "behavior palette": "",
    "rig check": "",
    "rig list": "",
    "calibrate tilt": "",
    "calibrate camera": "",
    "data import-cme": "--output",
    "effect list": "--json",
    "effect show": "",
    "model list": "",
    "model show": "",
    "score": "",
    "policy train": "",
    "new rig": "",
    "new tree": "--output",
    "doctor": "",
}
EFFECTS = {
    "rolling_inertia": "factor",
    "viscous_friction": "coefficient",
    "dry_friction": "coefficient asymmetry",
    "quadratic_drag": "coefficient",
    "tilt_offset": "beta gamma",
    "constant_torque": "acceleration",
    "surface_profile": "",
    "gate_loss": "angle loss",
    "friction_drift": "rate",
    "tilt_gain": "beta gamma",
    "axis_misalignment": "angle",
    "camera_offset": "x y",
    "sensor_delay": "delay",
    "command_delay": "delay",
    "deadband": "beta gamma",
    "backlash": "beta gamma",
    "wall_friction": "coefficient",
    "servo_gain": "beta gamma",
    "servo_lag": "beta_natural_frequency beta_damping gamma_natural_frequency gamma_damping",
    "axis_coupling": "beta_from_gamma gamma_from_beta",
    "camera_scale": "factor",
    "lens_distortion": "k x y",
    "table_rocking": "frequency beta gamma phase",
    "constant_force": "x y",
    "local_friction": "ring start end coefficient",
    "ball_imbalance": "amplitude phase",
}
PYTHON = ("Maze", "Observation", "Rig", "check_rig", "navigate", "MazeLeaf", "Port", "Status")
COLUMNS = (
    "t theta r x y beta gamma u_beta u_gamma segment ring theta_dot beta_dot gamma_dot theta_ddot beta_ddot gamma_ddot"
)
RESULT = "success reason time_s seed rig rings failures replans planner_ms log"


@pytest.mark.parametrize("path", COMMANDS)
def test_a_command_keeps_its_options(path):
    command = get_command(app)
    for name in path.split():
        command = command.commands[name]
    given = {name for parameter in command.params for name in parameter.opts}
    assert set(COMMANDS[path].split()) <= given


@pytest.mark.parametrize("name", EFFECTS)
def test_an_effect_keeps_its_parameters(name):
    assert set(EFFECTS[name].split()) <= set(PACKAGED[name].parameters)


@pytest.mark.parametrize("name", PYTHON)
def test_a_name_can_be_imported_from_the_package(name):
    assert getattr(mazeplan, name).__name__ == name


def test_rigs_and_columns_of_tables_and_keys_of_results_keep_their_names():
    assert {"ideal", "toy"} <= set(rig_names())
    assert set(COLUMNS.split()) <= set(KNOWN)
    assert [field.name for field in fields(Observation)][:5] == ["t", "x", "y", "beta", "gamma"]
    assert set(RESULT.split()) <= {field.name for field in fields(NavigationResult)}
