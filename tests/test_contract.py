"""The names that scripts, measurements and rigs of users rely on: commands, options, effects, rigs, Python, columns.

Everything else may be renamed. What the commands print as JSON is checked where each command is tested.
"""

from __future__ import annotations

from dataclasses import fields
from importlib import import_module
from inspect import signature

import pytest
from pages import ROOT
from typer.main import get_command

import mazeplan
from mazeplan.apps.cli.app import app
from mazeplan.behavior.current_leg import measured_miss
from mazeplan.core.logs.columns import KNOWN
from mazeplan.core.records import Failure, NavigationResult, Observation, State
from mazeplan.core.results import DocumentResult, Result
from mazeplan.physics.registry import PACKAGED
from mazeplan.rigs.registry import rig_names

COMMANDS = {
    "navigate": "--from --to --map --rig --model --behavior --start-angle --seed --time-limit --log --view --json "
    "--policy --balls --via --video --behavior-module --force",
    "evaluate": "--runs --rig --model --seed --workers --dask --json --report --compare",
    "collect": "--seconds --output --rig --json",
    "learn": "--output --kind --device --columns",
    "compare": "--test --json --columns",
    "diagnose": "--model --radius --declare --reference --ring --test --effects --system --output --json --columns",
    "improve": "--rig --rounds --runs --json --columns",
    "map check": "",
    "map show": "--output --log",
    "map route": "",
    "map learn": "--output --columns",
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
    "score": "--columns",
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
FUNCTIONS = ("evaluate", "collect", "learn", "compare", "diagnose", "improve")
PYTHON = ("Maze", "Observation", "Rig", "check_rig", "navigate", "MazeLeaf", "Port", "Status",
          *FUNCTIONS)  # fmt: skip
COLUMNS = (
    "t theta r x y beta gamma u_beta u_gamma segment ring theta_dot beta_dot gamma_dot theta_ddot beta_ddot gamma_ddot"
)
MISSED = "passed_deg off_mm radial_m_s tangential_m_s"
NOT_PYTHON = {"force", "as_json", "report", "page", "compare"}  # of files and the terminal; methods of results
PYTHON_WORDS = {"behavior_module": "behavior_modules", "no_deadline": "deadline"}
RESULT = "success reason time_s seed rig rings failures replans planner_ms log"


@pytest.mark.parametrize("path", COMMANDS)
def test_a_command_keeps_its_options(path):
    command = get_command(app)
    for name in path.split():
        command = command.commands[name]
    given = {name for parameter in command.params for name in parameter.opts}
    assert set(COMMANDS[path].split()) <= given


def test_several_columns_may_follow_the_option():
    words = ["a.csv", "--columns", "t=time:ms", "x=east:mm", "b.csv", "--columns", "beta=tilt:deg"]
    given = get_command(app).commands["compare"].make_context("compare", words).params
    assert given["columns"] == ["t=time:ms", "x=east:mm", "beta=tilt:deg"]
    assert [str(log) for log in given["logs"]] == ["a.csv", "b.csv"]


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


def test_a_missed_opening_has_what_was_measured():
    state = State(0.0, 0.06, 0.06, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1)
    detail = measured_miss(state, state, mazeplan.load_map("cme").opening("1-2@45"), 1)
    assert list(detail) == MISSED.split()
    assert "detail" in {field.name for field in fields(Failure)}


@pytest.mark.parametrize("kind", Result.__subclasses__() + DocumentResult.__subclasses__())
def test_a_result_has_a_document_a_page_and_words_for_a_notebook(kind):
    for name in ("json", "report", "_repr_html_"):
        assert callable(getattr(kind, name))
    assert kind.__dataclass_params__.frozen


def test_the_page_of_functions_is_that_of_the_program(monkeypatch):
    monkeypatch.syspath_prepend(str(ROOT / "docs"))
    page = (ROOT / "docs" / "functions.md").read_text(encoding="utf-8")
    assert page == "\n".join(import_module("generate").functions()) + "\n", "write it anew: python docs/generate.py"


@pytest.mark.parametrize("name", FUNCTIONS)
def test_a_function_of_python_has_the_words_of_its_command(name):
    command = get_command(app).commands[name]
    words = {parameter.name.removesuffix("_") for parameter in command.params} - NOT_PYTHON
    words = {PYTHON_WORDS.get(word, word) for word in words}
    assert words <= set(signature(getattr(mazeplan, name)).parameters)
