"""The user's files of a campaign: they make its identity, and other machines get them."""

from __future__ import annotations

import os
import pickle
import subprocess
import sys
from dataclasses import replace

import pytest

from mazeplan.core.errors import InputError
from mazeplan.core.resources import share
from mazeplan.learning.modelfile import PACKAGED
from mazeplan.rigs.registry import make_rig
from mazeplan.run.campaign.evaluate import Campaign
from mazeplan.run.campaign.identity import difference, digest_of, identity
from mazeplan.run.campaign.one_run import measured
from mazeplan.run.campaign.user_files import packed, unpack, user_files
from mazeplan.run.campaign.versions import program, program_mismatch

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
    for name in ("parcel_rig", "parcel_helper"):
        sys.modules.pop(name, None)


CAMPAIGN = Campaign(1, "rigs/mine.yaml", "mine.yaml", None, "mine.xml", settings="how.yaml")


def test_packaged_names_need_no_files():
    assert user_files(Campaign(1)) == {}


def test_everything_of_the_desk_is_found_and_works_elsewhere(desk, tmp_path, monkeypatch):
    files = user_files(CAMPAIGN)
    assert set(files) == {
        "map", "behavior", "settings", "rig", "rig/../how.yaml", "model/model.yaml", "modules/parcel_rig",
        "modules/parcel_helper",
    }  # fmt: skip
    parcel, campaign = packed(replace(CAMPAIGN, map=str(desk / "mine.yaml")), files.values())
    assert campaign == CAMPAIGN
    desk.rename(tmp_path / "gone")
    (tmp_path / "far").mkdir()
    code = (
        "import sys, pickle; from mazeplan.run.campaign.user_files import unpack; "
        "from mazeplan.rigs.registry import make_rig; parcel, campaign = pickle.load(sys.stdin.buffer); "
        "unpack(parcel); rig = make_rig(campaign.rig, campaign.maze()); print(campaign.maze().name, rig.light)"
    )
    words = [sys.executable, "-c", code]
    done = subprocess.run(words, cwd=tmp_path / "far", input=pickle.dumps((parcel, campaign)), capture_output=True)
    assert done.stdout.split() == [b"mine", b"helper"], done.stderr.decode()


def test_another_parcel_brings_its_own_modules(desk, tmp_path, monkeypatch):
    first, _ = packed(CAMPAIGN, user_files(CAMPAIGN).values())
    (desk / "parcel_helper.py").write_text("def light():\n    return 'another one'\n")
    second, _ = packed(CAMPAIGN, user_files(CAMPAIGN).values())
    assert first != second
    monkeypatch.setattr(sys, "path", [place for place in sys.path if place != str(desk)])
    forget()
    lights = []
    for parcel in (first, second, first):
        unpack(parcel)
        lights.append(make_rig(CAMPAIGN.rig, CAMPAIGN.maze()).light)
    assert lights == ["helper", "another one", "helper"]


def test_a_model_of_ones_own_comes_with_what_it_names(desk):
    (desk / "rigs" / "meshes").mkdir()
    (desk / "rigs" / "meshes" / "plate.stl").write_bytes(b"plate")
    (desk / "rigs" / "more.xml").write_text('<mujoco><mesh file="plate.stl"/><mesh file="gone.stl"/></mujoco>')
    (desk / "rigs" / "arm.xml").write_text('<mujoco><compiler meshdir="meshes"/><include file="more.xml"/></mujoco>')
    (desk / "rigs" / "arm.yaml").write_text("class: mazeplan.rigs.sim.usermodel:ModelRig\nmjcf: arm.xml\n")
    files = set(user_files(Campaign(1, "rigs/arm.yaml")))
    assert files == {"rig", "rig/arm.xml", "rig/more.xml", "rig/meshes/plate.stl"}


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


def test_files_that_a_tree_includes_are_found(including):
    for behavior in ("trees/my.xml", str(including / "trees" / "my.xml")):
        files = user_files(Campaign(1, behavior=behavior))
        assert set(files) == {"behavior", "behavior/inc.xml", "behavior/../shared/far.xml"}


def test_a_file_that_is_not_there_is_named(desk):
    with pytest.raises(InputError, match=r"gone\.xml"):
        identity(Campaign(1, behavior="gone.xml"))


# -- what makes campaigns the same ----------------------------------------------------------------------------------


def of(campaign: Campaign) -> dict:
    return identity(campaign)


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
        "mine.xml": ("<root", "<!-- other --><root", "behavior"), "parcel_rig.py": ("class", "\nclass", "files"),
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


def test_another_program_is_told_by_what_differs():
    ours = dict(program())
    assert program_mismatch(ours, ours) == ""
    assert program_mismatch(ours, {**ours, "numpy": "1.0", "sources": "x"}) == f"numpy 1.0 instead of {ours['numpy']}"
    assert program_mismatch(ours, {**ours, "sources": "x"}) == f"mazeplan {ours['mazeplan']} of other sources"


def test_what_a_run_cost_is_a_span_of_time():
    result, wall_s, cpu_s, host = measured(lambda: sum(range(100_000)))
    assert result == 4999950000
    assert host.endswith(f":{os.getpid()}")
    assert 0.0 < wall_s < 60.0
    assert 0.0 <= cpu_s < 0.5
