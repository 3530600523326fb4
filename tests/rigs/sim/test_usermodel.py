"""A rig on a MuJoCo model that a user brings: the example, and what is said where a model cannot be as described."""

from __future__ import annotations

import math
import re

import mujoco
import numpy as np
import pytest
from pages import ROOT

from mazeplan import check_rig, navigate
from mazeplan.core.errors import RigError, SettingsError
from mazeplan.maze.mapfile import load_map
from mazeplan.rigs.registry import make_rig
from mazeplan.rigs.sim.settings import Fault

MAZE = load_map("cme")
HERE = ROOT / "examples" / "own-model"
QUIET = {"camera_noise_mm": 0.2, "camera_delay_frames": 1, "tilt_noise_deg": 0.02}

# a plate without walls, turned by 90 deg and away from the origin, which springs a little; an actuator pulls at a cord
SMALL = """<mujoco><option timestep="{timestep}" integrator="implicitfast"/>
<default><geom condim="6" solref="0.004 1" friction="0.3 2e-5 2e-5"/></default>
<worldbody><body name="a" pos="0.2 -0.1 0.5" euler="0 0 90">
<inertial pos="0 0 0" mass="0.1" diaginertia="1e-4 1e-4 1e-4"/>
<joint name="first" axis="0 1 0" armature="0.05" {limits}/>
<body name="b" euler="0 {tilted} 0"><inertial pos="0 0 0" mass="0.5" diaginertia="1e-3 1e-3 2e-3"/>
<joint name="second" axis="1 0 0" armature="0.05"/>
<joint name="lift" type="slide" axis="0 0 1" range="0 1e-5" limited="true" stiffness="1e5" damping="1e3"/>
<geom type="box" size="0.12 0.12 0.005" pos="0 0 -0.005"/><site name="low" pos="0 0 -0.003"/>
<site name="upside" euler="180 0 0"/><site name="skew" euler="0 0 45"/></body></body>
<body name="marble" pos="0 0 1">{free}<geom type="{shape}" size="{radius} 0.01" mass="0.0084" friction="0 0 0"/></body>
<body name="loose" pos="1 0 1"><freejoint/><geom size="0.01"/></body></worldbody>
<tendon><fixed name="cord"><joint joint="second" coef="0.5"/></fixed></tendon>
<actuator><position name="one" joint="first" kp="34" kv="2.3" {ctrl}/>
<{kind} name="two" joint="second" {gains}/>
<position name="pull" tendon="cord" {cord}/>{more}</actuator></mujoco>"""
PLAIN = {
    "timestep": 1 / 1500, "limits": "", "tilted": 0, "free": "<freejoint/>", "shape": "sphere", "radius": 0.00635,
    "ctrl": "",
    "kind": "position", "gains": 'kp="34" kv="2.3"', "cord": 'kp="1e-6"', "more": "",
}  # fmt: skip
FILE = """class: mazeplan.rigs.sim.usermodel:ModelRig
mjcf: small.xml
plate: b
ball: marble
beta: {joint: first}
gamma: {joint: second, actuator: two}
"""


@pytest.fixture
def made(tmp_path):
    """A rig of a small model; changes of the model, and of lines of its file."""

    def make(*lines, **changes):
        (tmp_path / "small.xml").write_text(SMALL.format(**{**PLAIN, **changes}))
        keys = {line.split(":")[0] for line in lines}
        kept = [line for line in FILE.splitlines() if line.split(":")[0] not in keys]
        (tmp_path / "small.yaml").write_text("\n".join([*kept, *lines]) + "\n")
        return make_rig(str(tmp_path / "small.yaml"), MAZE)

    return make


def placed(rig, ring=1, theta=0.0):
    rig.reset(ring=ring, theta=theta, rng=np.random.default_rng(0))
    return rig


def driven(rig, seconds, u_beta=0.0, u_gamma=0.0):
    true = []
    for _ in range(round(30 * seconds)):
        rig.observe()
        rig.command(u_beta, u_gamma)
        true.append(rig.truth())
    return np.array(true)


# -- the example -----------------------------------------------------------------------------------------------------


@pytest.mark.slow
def test_the_example_is_a_rig_and_the_ball_arrives():
    rig = make_rig(str(HERE / "table.yaml"), MAZE)
    assert [check for check in check_rig(rig, MAZE) if not check.passed] == []
    assert {name: getattr(rig.settings, name) for name in QUIET} == QUIET  # pyright: ignore
    result = navigate(1, 5, rig=str(HERE / "table.yaml"), seed=2)
    assert result.success, result.reason
    assert result.rig == "table"


# -- frames ----------------------------------------------------------------------------------------------------------


def test_signs_hold_in_a_turned_and_moved_plate(made):
    cord = "gamma: {joint: second, actuator: pull, scale: 0.5}"
    for rig in (made(), made(cord, kind="motor", gains="", cord='kp="136" kv="9.2"')):
        assert [check.name for check in check_rig(rig, MAZE) if not check.passed] == []
        placed(rig, theta=0.5 * math.pi)
        true = driven(rig, 0.8, 0.05, 0.03)
        assert true[-1, 5:] == pytest.approx([0.05, 0.03], abs=2e-3)
        assert true[-1, 0] > 0.01  # beta lowers +x
        assert true[-1, 1] < MAZE.track_radius(1) - 5e-3  # gamma lifts +y


def test_a_level_plate_may_have_joints_off_zero(made):
    rig = placed(made("beta: {joint: first, zero_deg: 10.0}", tilted=-10), theta=0.5 * math.pi)
    assert rig.truth()[:3] == pytest.approx([0.0, MAZE.track_radius(1), MAZE.ball.radius], abs=1e-9)
    true = driven(rig, 0.8, 0.05, 0.0)
    assert true[-1, 5:] == pytest.approx([0.05, 0.0], abs=2e-3)
    assert true[-1, 0] > 0.01


def test_state_of_the_ball_in_a_turning_plate(made):
    rig = placed(made("plate: low", "floor_mm: 3.0"), ring=2, theta=0.4)
    driven(rig, 0.15, 0.08, -0.06)
    wanted = (np.array([0.03, -0.06, 0.02]), np.array([0.1, 0.05, 0.0]), np.array([-7.9, 15.7, 3.0]))
    rig.machine.set_ball(*wanted)
    for got, asked in zip(rig.machine.ball(), wanted, strict=True):
        assert got == pytest.approx(asked, abs=1e-9)
    # velocities are what places and frames do within a microsecond
    gimbal, (place, velocity, _), (turned, omega) = rig.machine.gimbal, rig.machine.ball(), rig.machine.gimbal.plate()
    mujoco.mj_integratePos(gimbal.model, gimbal.data.qpos, gimbal.data.qvel, 1e-6)
    mujoco.mj_kinematics(gimbal.model, gimbal.data)
    assert (rig.machine.ball()[0] - place) / 1e-6 == pytest.approx(velocity, abs=1e-4)
    change = turned.T @ (gimbal.plate()[0] - turned) / 1e-6
    assert [change[2, 1], change[0, 2], change[1, 0]] == pytest.approx(omega, abs=1e-4)
    assert np.linalg.norm(omega) > 0.1


def test_faults_act_on_it(made):
    rig = placed(made(), theta=0.3)
    driven(rig, 0.3, 0.02, -0.03)
    rig.inject(Fault(kind="teleport", at_s=0.0, ring=3, direction_deg=100.0))
    true = driven(rig, 0.1)
    assert math.hypot(*true[1, :2]) == pytest.approx(MAZE.track_radius(3), abs=1e-3)
    assert math.degrees(math.atan2(true[1, 1], true[1, 0])) == pytest.approx(100.0, abs=1.0)


def test_an_unstable_model_fails_the_rig(made, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)  # MuJoCo writes a log beside one
    rig = placed(made(timestep=1 / 450, gains='kp="1e12" kv="0"'))
    with pytest.raises(RigError, match="became unstable at t = 0"):
        driven(rig, 2.0, 0.05, 0.05)


# -- what cannot be --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("lines", "changes", "key"),
    [
        ("beta: {joint: frist}", {}, "beta.joint"),
        ("beta: {joint: second}\ngamma: {joint: first}", {}, "beta"),
        ("plate: a", {}, "gamma"),
        ("plate: disc", {}, "plate"),
        ("faults: [{kind: blocked, at_s: 0.0, opening: 1-2@45}]", {}, "faults[0].kind"),
        ("", {"free": ""}, "ball"),
        ("", {"timestep": 0.002}, "mjcf"),
    ],
)
def test_a_model_that_does_not_fit_names_its_key(made, tmp_path, lines, changes, key):
    with pytest.raises(SettingsError) as problem:
        made(*lines.splitlines(), **changes)
    text = str(problem.value)
    assert "\n" not in text
    assert re.match(rf"{re.escape(str(tmp_path / 'small.yaml'))}:\d+: {re.escape(key)}: ", text), text
