"""MuJoCo models from elsewhere: what they often have, and the line with the remedy."""

import pytest

from mazeplan.core.errors import SettingsError
from mazeplan.maze.mapfile import load_map
from mazeplan.rigs.registry import make_rig

MAZE = load_map("cme")
MODEL = """<mujoco><compiler{compiler}/><option timestep="{timestep}" integrator="implicitfast">{option}</option>
<default><geom condim="6" solref="0.004 1" friction="0.3 2e-5 2e-5"/></default>
<worldbody><body name="a"><inertial pos="0 0 0" mass="0.1" diaginertia="1e-4 1e-4 1e-4"/>
<joint name="first" axis="0 1 0" armature="0.05"/>
<body name="b"><inertial pos="0 0 0" mass="0.5" diaginertia="1e-3 1e-3 2e-3"/>
<joint name="second" axis="1 0 0" armature="0.05"/><geom type="box" size="0.12 0.12 0.005" pos="0 0 -0.005"/>
</body></body>
<body name="moved" mocap="true"><site name="on it"/></body>
<body name="marble" pos="0 0 1"><freejoint/><geom size="0.00635" mass="0.0084" friction="0 0 0" {ball}/></body>
</worldbody>
<actuator><position joint="first" kp="34" kv="2.3"/><position joint="second" kp="34" kv="2.3"/></actuator></mujoco>"""
PLAIN = {"compiler": "", "timestep": 1 / 600, "option": "", "ball": ""}
FILE = """class: mazeplan.rigs.sim.usermodel:ModelRig
mjcf: old.xml
plate: {plate}
ball: marble
beta: {{joint: first}}
gamma: {{joint: second}}
"""


def made(folder, plate="b", **changes):
    (folder / "old.xml").write_text(MODEL.format(**(PLAIN | changes)))
    (folder / "old.yaml").write_text(FILE.format(plate=plate))
    return make_rig(str(folder / "old.yaml"), MAZE)


def test_without_any_of_it_the_model_is_a_rig(tmp_path):
    assert made(tmp_path).rate_hz == 30.0
    assert made(tmp_path, timestep=1 / 450).rate_hz == 30.0


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"compiler": ' coordinate="global"'}, r"mjcf: .*old\.xml: coordinate=.global. .* save .* with MuJoCo 2\.3\.3"),
        ({"plate": "moved"}, r"plate: .moved. is a mocap body .*; expected a body without mocap=.true., on two hinges"),
        ({"plate": "on it"}, r"plate: .on it. is a mocap body or fixed to one"),
        ({"ball": 'pos="0 0.003 0"'}, r"ball: the sphere is 3 mm off the origin of body .marble.; .* into the body's"),
        ({"option": '<flag override="enable"/>'}, r"mjcf: its flag override .*; expected the flag off"),
        (
            {"timestep": 1 / 150},
            r"mjcf: its timestep is 0\.00666667 s, .*; expected at most 0\.0026 s, such as 0\.0022222",
        ),
        ({"timestep": 0.02}, r"mjcf: its timestep is 0\.02 s, in which a ball may go through a wall"),
    ],
)
def test_what_is_wrong_is_one_line_with_the_remedy(tmp_path, changes, said):
    with pytest.raises(SettingsError, match=said) as caught:
        made(tmp_path, **changes)
    assert "\n" not in str(caught.value)
