"""A bare name of something packaged means that, whatever lies in the current folder; ./name is what lies there."""

from pathlib import Path

import pytest

from mazeplan.behavior.trees import read_tree
from mazeplan.core.errors import InputError, ShortWarning
from mazeplan.learning.modelfile import is_packaged_model, load_model, model_stamp
from mazeplan.maze.mapfile import find_map, load_map
from mazeplan.rigs.registry import make_rig
from mazeplan.run.resolve import model_from, model_source, resolve_model

MAZE = load_map("cme")
TOY = load_model("toy")


@pytest.fixture
def littered(tmp_path, monkeypatch):
    """A folder with folders of all packaged names in it."""
    monkeypatch.chdir(tmp_path)
    for name in ("cme", "toy", "navigate", "ideal"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "note.txt").write_text("mine")
    return tmp_path


@pytest.mark.usefixtures("littered")
def test_folders_of_the_same_names_hide_nothing():
    with pytest.warns(ShortWarning, match=r"'cme' means the packaged one; what .* is \./cme"):
        assert load_map("cme") == MAZE
    with pytest.warns(ShortWarning, match="navigate"):
        assert len(read_tree("navigate").files) == 1
    with pytest.warns(ShortWarning, match="toy"):
        assert load_model("toy") == TOY
    with pytest.warns(ShortWarning, match="toy"):
        assert model_source(None, "toy") == "toy"
    with pytest.warns(ShortWarning, match="toy"):
        assert model_stamp("toy") == ()
    with pytest.warns(ShortWarning, match="toy"):
        assert resolve_model(None, "toy", MAZE) == model_from("toy", MAZE)
    assert make_rig("toy", MAZE).rate_hz == 30.0


@pytest.mark.usefixtures("littered")
def test_a_path_is_what_lies_there():
    assert find_map("./cme") == find_map(Path("cme")) == Path("cme")
    with pytest.raises(InputError, match="a folder"):
        load_model("./toy")
    assert not is_packaged_model(Path("toy"))
    assert Path(model_source("./toy", None) or "") == Path.cwd() / "toy"


def test_a_models_folder_beside_a_rigs_file_still_comes_first(tmp_path, monkeypatch):
    from mazeplan.rigs.registry import rig_model_hint

    monkeypatch.chdir(tmp_path)
    (tmp_path / "toy").mkdir()
    (tmp_path / "mine.yaml").write_text("model: toy\n")
    assert Path(rig_model_hint("mine.yaml") or "") == tmp_path / "toy"
