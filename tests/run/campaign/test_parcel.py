"""What is sent to a machine without the user's files, and that it is enough there."""

from __future__ import annotations

import pickle
import sys
from importlib.metadata import EntryPoint
from pathlib import Path

import pytest

from mazeplan.behavior.treefile import tree_files
from mazeplan.core.errors import InputError, MazeplanError
from mazeplan.core.plugins import RIGS, Plugin
from mazeplan.core.resources import share
from mazeplan.learning.modelfile import PACKAGED, load_model
from mazeplan.maze.mapfile import load_map
from mazeplan.rigs import registry
from mazeplan.rigs.registry import make_rig
from mazeplan.run.campaign import parcel as parcels
from mazeplan.run.campaign.evaluate import Campaign
from mazeplan.run.campaign.identity import difference, digest_of, identity
from mazeplan.run.campaign.parcel import Parcel, errors_name_origins, packed, unpacked
from mazeplan.run.campaign.versions import program, program_mismatch
from mazeplan.run.campaign.worker import measured, run_packed

RIG = """\
from parcel_helper import light
from mazeplan.apps.testing.lightrig import LightRig


class MyRig(LightRig):
    def __init__(self, maze, settings):
        super().__init__(maze)
        self.settings, self.light = dict(settings), light()
"""


@pytest.fixture
def desk(tmp_path, monkeypatch):
    """A folder where one works, with files of all kinds, and modules that nobody has loaded."""
    folder = tmp_path / "desk"
    (folder / "rigs").mkdir(parents=True)
    (folder / "fit").mkdir()
    text = (share("maps") / "cme.yaml").read_text()
    (folder / "mine.yaml").write_text(text.replace("name: cme", "name: mine"))
    (folder / "mine.xml").write_text((share("behaviors") / "navigate.xml").read_text())
    (folder / "how.yaml").write_text("travel: {deadline_ms: 1e6}\n")
    (folder / "rigs" / "mine.yaml").write_text("class: parcel_rig:MyRig\nmodel: ../fit\npicture: ../how.yaml\n")
    (folder / "fit" / "model.yaml").write_text((PACKAGED / "ideal" / "model.yaml").read_text())
    (folder / "parcel_rig.py").write_text(RIG)
    (folder / "parcel_helper.py").write_text("def light():\n    return 'helper'\n")
    (folder / "unused.py").write_text("raise SystemExit\n")
    monkeypatch.chdir(folder)
    monkeypatch.setattr(sys, "path", [str(folder), *sys.path])
    yield folder
    forget()


def forget() -> None:
    parcels._clear()
    for name in ("parcel_rig", "parcel_helper"):
        sys.modules.pop(name, None)


CAMPAIGN = Campaign(1, "rigs/mine.yaml", "mine.yaml", None, "mine.xml", settings="how.yaml")


def test_packaged_names_need_no_parcel():
    assert packed(Campaign(1)) == Parcel()
    assert unpacked(Parcel(), Campaign(1)) == Campaign(1)


def test_everything_of_the_desk_is_in_it_and_works_elsewhere(desk, tmp_path, monkeypatch):
    parcel = packed(CAMPAIGN)
    assert set(dict(parcel.files)) == {
        "map/mine.yaml", "behavior/mine.xml", "settings/how.yaml", "rig/in/mine.yaml", "rig/how.yaml",
        "model/fit/model.yaml", "modules/parcel_rig.py", "modules/parcel_helper.py",
    }  # fmt: skip
    forget()
    desk.rename(tmp_path / "gone")
    (tmp_path / "far").mkdir()
    monkeypatch.chdir(tmp_path / "far")
    there = unpacked(parcel, CAMPAIGN)
    maze = load_map(there.map)
    assert maze.name == "mine"
    assert load_model(there.model) == load_model("ideal")
    assert Path(there.behavior).name == "mine.xml"
    rig = make_rig(there.rig, maze)
    assert rig.light == "helper"
    assert (Path(there.rig).parent / rig.settings["picture"]).read_text() == Path(there.settings).read_text()
    assert sys.modules["parcel_rig"].__file__.startswith(parcels._unpack_cache[0][1].name)


def test_what_is_wrong_with_a_file_is_told_of_the_one_that_was_packed(desk, tmp_path, monkeypatch):
    (desk / "rigs" / "mine.yaml").write_text("class: parcel_rig:MyRig\n")
    (desk / "parcel_helper.py").write_text("def light():\n    return 1 / 0\n")
    campaign = Campaign(1, "rigs/mine.yaml", "mine.yaml", None, "mine.xml")
    parcel = packed(campaign)
    forget()
    (tmp_path / "far").mkdir()
    monkeypatch.chdir(tmp_path / "far")
    monkeypatch.setattr(sys, "path", [place for place in sys.path if place != str(desk)])
    with pytest.raises(MazeplanError) as told:
        run_packed(parcel, campaign, 0)
    assert "ZeroDivisionError" in str(told.value)
    assert parcels._unpack_cache[0][1].name not in str(told.value)
    assert f"{desk / 'parcel_helper.py'}:2" in str(told.value)

    there = Path(unpacked(parcel, campaign).behavior)
    problem = ValueError("oh")
    problem.add_note(f"raised by the leaf at {there}:16: Rest")
    with pytest.raises(ValueError, match="oh") as raised, errors_name_origins(parcel):
        raise problem
    assert pickle.loads(pickle.dumps(raised.value)).__notes__ == ["raised by the leaf at mine.xml:16: Rest"]
    with pytest.raises(InputError) as told, errors_name_origins(parcel):
        raise InputError("is odd", file=there, line=7, key="here")
    again = pickle.loads(pickle.dumps(told.value))  # as it comes from another process
    assert str(again) == "mine.xml:7: here: is odd"
    assert again.file == "mine.xml"


def test_another_parcel_brings_its_own_modules(desk, tmp_path, monkeypatch):
    first = packed(CAMPAIGN)
    (desk / "parcel_helper.py").write_text("def light():\n    return 'another one'\n")
    second = packed(CAMPAIGN)
    assert first.digest != second.digest
    (tmp_path / "far").mkdir()
    monkeypatch.chdir(tmp_path / "far")
    monkeypatch.setattr(sys, "path", [place for place in sys.path if place != str(desk)])
    forget()
    lights = []
    for parcel in (first, second, first):
        there = unpacked(parcel, CAMPAIGN)
        lights.append(make_rig(there.rig, load_map(there.map)).light)
    assert lights == ["helper", "another one", "helper"]


def test_a_model_of_ones_own_comes_with_what_it_names(desk):
    (desk / "rigs" / "meshes").mkdir()
    (desk / "rigs" / "meshes" / "plate.stl").write_bytes(b"plate")
    (desk / "rigs" / "more.xml").write_text('<mujoco><mesh file="plate.stl"/><mesh file="gone.stl"/></mujoco>')
    (desk / "rigs" / "arm.xml").write_text('<mujoco><compiler meshdir="meshes"/><include file="more.xml"/></mujoco>')
    (desk / "rigs" / "arm.yaml").write_text("class: mazeplan.rigs.sim.usermodel:ModelRig\nmjcf: arm.xml\n")
    files = dict(packed(Campaign(1, "rigs/arm.yaml")).files)
    assert set(files) == {"rig/arm.yaml", "rig/arm.xml", "rig/more.xml", "rig/meshes/plate.stl"}


LEAN = '<root BTCPP_format="4"><BehaviorTree ID="{}"><AlwaysSuccess/></BehaviorTree></root>'
INCLUDING = """\
<root BTCPP_format="4" main_tree_to_execute="Main">
  <include path="inc.xml"/><include path="navigate.xml"/><include path="../shared/far.xml"/>
  <BehaviorTree ID="Main"><Sequence><SubTree ID="Inc"/><SubTree ID="Far"/></Sequence></BehaviorTree>
</root>
"""


@pytest.fixture
def including(desk):
    """The desk with a tree in the folder trees, which includes a file beside it, a packaged one, and one elsewhere."""
    for folder in ("trees", "shared"):
        (desk / folder).mkdir()
    (desk / "trees" / "my.xml").write_text(INCLUDING)
    (desk / "trees" / "inc.xml").write_text(LEAN.format("Inc"))
    (desk / "shared" / "far.xml").write_text(LEAN.format("Far"))
    return desk


def test_files_that_a_tree_includes_come_along(including, tmp_path, monkeypatch):
    for behavior in ("trees/my.xml", str(including / "trees" / "my.xml")):
        parcel = packed(Campaign(1, behavior=behavior))
        assert set(dict(parcel.files)) == {"behavior/in/my.xml", "behavior/in/inc.xml", "behavior/shared/far.xml"}
    including.rename(tmp_path / "gone")
    (tmp_path / "far").mkdir()
    monkeypatch.chdir(tmp_path / "far")
    there = tree_files(unpacked(parcel, Campaign(1)).behavior)
    assert [path.name for path in there] == ["my.xml", "inc.xml", "navigate.xml", "far.xml"]


def test_a_rig_of_an_installed_package_stays_a_name(monkeypatch):
    entry = EntryPoint("cart", "mazeplan.apps.testing.lightrig:LightRig", RIGS)
    cart = Plugin(RIGS, "cart", entry.value, "carts", "1.2", entry)
    monkeypatch.setattr(parcels, "plugin", lambda group, name: cart if name == "cart" else None)
    monkeypatch.setattr(registry, "plugin", lambda group, name: cart if name == "cart" else None)
    assert packed(Campaign(1, "cart")) == Parcel()
    source, digest = of(Campaign(1, "cart"))["packages"]["cart"]
    assert source == "carts 1.2"
    assert len(digest) == 64


def test_a_file_that_is_not_there_is_named(desk):
    with pytest.raises(InputError, match=r"^gone\.xml: cannot be read"):
        packed(Campaign(1, behavior="gone.xml"))


# -- what makes campaigns the same ----------------------------------------------------------------------------------


def of(campaign: Campaign) -> dict:
    return identity(campaign, packed(campaign))


def test_neither_places_nor_names_of_files_nor_the_number_of_runs_make_another_campaign(desk):
    (desk / "elsewhere").mkdir()
    for name in ("mine.yaml", "mine.xml", "how.yaml"):
        (desk / "elsewhere" / f"other_{name}").write_text((desk / name).read_text())
    moved = Campaign(
        7, "rigs/mine.yaml", "elsewhere/other_mine.yaml", "fit", "elsewhere/other_mine.xml",
        settings="elsewhere/other_how.yaml", own_process=True,
    )  # fmt: skip
    assert of(moved) == of(CAMPAIGN)


def test_all_that_determines_results_makes_another(desk):
    before = of(CAMPAIGN)
    changes = {
        "mine.yaml": ("tilt_limit_deg: ", "tilt_limit_deg: 4.", "map"), "how.yaml": ("1e6", "2e6", "settings"),
        "mine.xml": ("<root", "<!-- other --><root", "behavior"), "parcel_rig.py": ("class", "\nclass", "modules"),
        "parcel_helper.py": ("helper", "other", "files"), "fit/model.yaml": ("rate_hz: 30", "rate_hz: 31", "model"),
        "rigs/mine.yaml": ("class:", "more: 1\nclass:", "rig"),
    }  # fmt: skip
    for name, (old, new, what) in changes.items():
        path = desk / name
        kept = path.read_text()
        assert old in kept, name
        path.write_text(kept.replace(old, new, 1))
        now = of(CAMPAIGN)
        assert what in difference(before, now).split(", "), name
        assert digest_of(now) != digest_of(before)
        path.write_text(kept)
    assert of(CAMPAIGN) == before
    for other, what in ((Campaign(1, seed=3), "seed"), (Campaign(1, start=4), "start ring"),
                        (Campaign(1, deadline=False), "settings"), (Campaign(1, time_limit=3.0), "time limit"),
                        (Campaign(1, sense="camera"), "rig")):  # fmt: skip
        assert difference(of(Campaign(1)), of(other)) == what


def test_an_included_file_that_changes_makes_another_campaign(including):
    before = of(Campaign(1, behavior="trees/my.xml"))
    (including / "trees" / "inc.xml").write_text(LEAN.format("Inc") + "<!-- other -->")
    now = of(Campaign(1, behavior="trees/my.xml"))
    assert difference(before, now) == "files"
    absolute = INCLUDING.replace("../shared", str(including / "shared"))
    (including / "trees" / "my.xml").write_text(absolute)
    assert "behavior/shared/far.xml" not in dict(packed(Campaign(1, behavior="trees/my.xml")).files)
    before = of(Campaign(1, behavior="trees/my.xml"))
    (including / "shared" / "far.xml").write_text(LEAN.format("Far") + "<!-- other -->")
    assert difference(before, of(Campaign(1, behavior="trees/my.xml"))) == "files"


def test_campaigns_without_included_files_keep_their_identity(desk):
    assert "behavior/mine.xml" in dict(packed(CAMPAIGN).files)
    assert set(of(CAMPAIGN)["files"]) == {"rig/how.yaml", "modules/parcel_rig.py", "modules/parcel_helper.py"}
    assert of(Campaign(1))["files"] == {}


def test_another_program_is_told_by_what_differs():
    ours = dict(program())
    assert program_mismatch(ours, ours) == ""
    assert program_mismatch(ours, {**ours, "numpy": "1.0", "sources": "x"}) == f"numpy 1.0 instead of {ours['numpy']}"
    assert program_mismatch(ours, {**ours, "sources": "x"}) == f"mazeplan {ours['mazeplan']} of other sources"


def test_what_a_run_cost_is_a_span_of_time():
    result, wall_s, cpu_s = measured(lambda: sum(range(100_000)))
    assert result == 4999950000
    assert 0.0 < wall_s < 60.0
    assert 0.0 <= cpu_s < 0.5
