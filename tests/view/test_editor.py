"""A map that is being edited: steps, problems, and the file."""

from __future__ import annotations

import asyncio
import math
import os
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from fake_scene import FakeServer
from hypothesis import given, settings
from hypothesis import strategies as st

from mazeplan.apps.view.editor.mapeditor import MapEditor
from mazeplan.apps.view.editor.scene import EditScene
from mazeplan.apps.view.editor.tab import head_html
from mazeplan.apps.view.scene import UNIT
from mazeplan.core import resources
from mazeplan.core.errors import MapError
from mazeplan.maze.mapedit import SECTIONS
from mazeplan.maze.mapfile import load_map

LOPSIDED = resources.share("maps") / "lopsided.yaml"


@pytest.fixture
def editor(tmp_path) -> MapEditor:
    path = tmp_path / "mine.yaml"
    path.write_bytes(LOPSIDED.read_bytes())
    return MapEditor(path)


def angles(editor: MapEditor) -> list[float]:
    return [opening.angle_deg for opening in editor.openings]


def test_a_drag_is_one_step_back_and_one_forth(editor):
    for angle in (20, 25, 30.04):
        editor.move(0, angle, gesture="drag 1")
    editor.settle()
    editor.move(0, 33, gesture="drag 1")
    assert angles(editor)[0] == 33
    assert editor.undo()
    assert angles(editor)[0] == 30
    assert editor.undo()
    assert editor.text == LOPSIDED.read_text()
    assert not editor.undo()
    assert not editor.can_undo
    assert not editor.changed
    assert editor.redo()
    assert angles(editor)[0] == 30
    editor.widen(0, 15)
    assert not editor.redo()
    assert not editor.can_redo


STEPS = st.tuples(st.sampled_from(["move", "close", "add", "remove", "undo", "undo", "redo"]), st.integers(0, 400))


@given(st.lists(STEPS, max_size=12))
@settings(max_examples=50, deadline=None)
def test_undo_and_redo_walk_along_the_texts(steps):
    editor = MapEditor("lopsided")
    texts, at = [editor.text], 0
    for kind, n in steps:
        if kind in ("undo", "redo"):
            wanted = at + (1 if kind == "redo" else -1)
            assert getattr(editor, f"can_{kind}") == (0 <= wanted < len(texts))
            assert getattr(editor, kind)() == (0 <= wanted < len(texts))
            at = min(max(wanted, 0), len(texts) - 1)
        elif kind == "add":
            editor.add(1 + n % 2, float(n))
        elif editor.openings:
            value = {"move": (float(n),), "close": (n % 2 == 1,), "remove": ()}[kind]
            getattr(editor, kind)(n % len(editor.openings), *value)
        if editor.text != texts[at]:
            texts, at = [*texts[: at + 1], editor.text], at + 1
        assert editor.text == texts[at]
        assert editor.changed == (editor.text != texts[0])


def test_problems_are_told_at_their_line_while_one_drags_and_the_last_good_maze_stays(editor):
    good = editor.maze
    editor.move(1, 18, gesture=1)
    (error,) = editor.check.errors
    assert (error.line, error.key) == (19, "openings[1].angle_deg")
    assert "overlaps openings[0]" in error.problem
    assert editor.wrong == {("openings", 0), ("openings", 1)}
    assert editor.maze is good
    editor.move(1, 60, gesture=1)
    assert editor.check.errors == ()
    assert editor.maze is not good
    assert math.degrees(editor.maze.openings[1].angle) == pytest.approx(60)
    editor.widen(3, 12.7)
    assert [error.problem for error in editor.check.errors] == ["got 12.7, expected more than the ball's diameter 12.7"]


def test_what_is_typed_may_be_anything(editor):
    editor.write("{[")
    assert editor.openings == ()
    assert editor.check.errors[0].line == 1
    for edit in (lambda: editor.move(0, 10), lambda: editor.remove(0), lambda: editor.add(1)):
        with pytest.raises(MapError):
            edit()
    editor.write("{[1")
    assert editor.undo()
    assert editor.text == LOPSIDED.read_text()
    with pytest.raises(MapError, match="1048576 bytes"):
        editor.write("#" * (1 << 20) + "\n")


def test_a_new_one_comes_into_the_middle_of_the_longest_piece(editor):
    index = editor.add(1)
    new = editor.piece("openings", index)
    assert (new.outer, new.angle_deg, new.width_mm) == (1, 290, 17)
    assert editor.check.errors == ()
    assert editor.piece("openings", editor.add(2, 150, 16)).angle_deg == 150
    for opening in reversed(editor.openings):
        editor.remove(opening.index)
    assert editor.usual_width(1) == 15.3  # 1.2 diameters of the ball, upwards
    assert editor.piece("openings", editor.add(1)).angle_deg == 0


def test_a_place_in_the_plate_is_at_the_nearest_wall(editor):
    assert editor.wall_at(0.0, 0.048) == (1, pytest.approx(90))
    assert editor.wall_at(-0.001, 0.0) == (2, pytest.approx(180))
    assert editor.wall_at(0.0, -0.5) == (1, pytest.approx(270))


def test_save_writes_the_text_with_its_comments_and_rights(editor):
    os.chmod(editor.path, 0o640)
    editor.move(0, 33)
    assert editor.changed
    assert editor.save() == editor.path
    assert not editor.changed
    assert editor.path.read_text() == LOPSIDED.read_text().replace("angle_deg: 17,", "angle_deg: 33,")
    assert math.degrees(load_map(editor.path).openings[0].angle) == pytest.approx(33)
    assert editor.path.stat().st_mode & 0o777 == 0o640
    assert os.listdir(editor.path.parent) == ["mine.yaml"]
    editor.undo()
    editor.save()  # again, over what it wrote itself
    assert editor.path.read_text() == LOPSIDED.read_text()


def test_a_read_only_map_stays(editor):
    os.chmod(editor.path, 0o444)
    editor.move(0, 33)
    with pytest.raises(MapError, match="cannot be written: the file is read-only"):
        editor.save()
    assert editor.path.read_text() == LOPSIDED.read_text()


def test_bytes_that_are_no_part_of_the_edit_stay(tmp_path):
    path, content = tmp_path / "dos.yaml", LOPSIDED.read_bytes().replace(b"\n", b"\r\n")
    path.write_bytes(b"\xef\xbb\xbf" + content)
    editor = MapEditor(path)
    editor.move(0, 33)
    editor.write(editor.text.replace("\r\n", "\n") + "# a page ends lines with LF\n")
    editor.save()
    expected = content.replace(b"angle_deg: 17,", b"angle_deg: 33,") + b"# a page ends lines with LF\r\n"
    assert path.read_bytes() == b"\xef\xbb\xbf" + expected


def test_a_map_with_errors_is_saved_only_by_who_says_so(editor):
    editor.move(1, 18)
    with pytest.raises(MapError, match=r"mine.yaml:19: openings\[1\].angle_deg: overlaps openings\[0\]"):
        editor.save()
    assert editor.path.read_text() == LOPSIDED.read_text()
    editor.save(with_errors=True)
    assert editor.path.read_text() == editor.text
    assert len(MapEditor(editor.path).wrong) == 2  # and may be opened again, to be mended


@pytest.mark.parametrize("what", ["changed", "gone"])
def test_a_file_that_another_changed_is_not_written_over(editor, what):
    theirs = LOPSIDED.read_text() + "# theirs\n"
    editor.path.write_text(theirs) if what == "changed" else editor.path.unlink()
    editor.move(0, 33)
    words = "was changed by another program" if what == "changed" else "is gone"
    with pytest.raises(MapError, match=f"mine.yaml: {words} since it was opened here: save under another name"):
        editor.save()
    assert not editor.path.exists() if what == "gone" else editor.path.read_text() == theirs
    saved = editor.save("other.yaml")
    assert saved.read_text() == editor.text
    assert editor.path == saved
    editor.move(0, 35)
    editor.save()
    assert "angle_deg: 35," in saved.read_text()


@pytest.mark.parametrize("name", ["../other.yaml", "a/b.yaml", ".yaml", "", "other", "other.py", "a\0.yaml", ".a.yaml"])
def test_another_name_stays_in_the_folder_and_is_a_map(editor, name):
    with pytest.raises(MapError, match="got the file name"):
        editor.save(name)


def test_another_name_must_be_new(editor):
    other = editor.path.with_name("other.yaml")
    other.write_text("theirs")
    with pytest.raises(MapError, match="exists already"):
        editor.save("other.yaml")
    assert other.read_text() == "theirs"


def test_what_cannot_be_written_leaves_all_as_it_was(editor, monkeypatch):
    def full(*_):
        raise OSError(28, "No space left on device")

    editor.move(0, 33)
    monkeypatch.setattr(os, "fsync", full)
    for name in (None, "other.yaml"):
        with pytest.raises(MapError, match="cannot be written: No space left on device"):
            editor.save(name)
    assert os.listdir(editor.path.parent) == ["mine.yaml"]
    assert editor.path.read_text() == LOPSIDED.read_text()
    assert editor.changed


def test_a_packaged_map_is_saved_in_the_folder_where_one_works(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    before = LOPSIDED.read_bytes()
    editor = MapEditor("lopsided")
    editor.move(0, 33)
    assert editor.save() == tmp_path / "lopsided.yaml"
    assert "angle_deg: 33," in Path("lopsided.yaml").read_text()
    assert LOPSIDED.read_bytes() == before
    with pytest.raises(MapError, match="exists already"):
        MapEditor("lopsided").save()


@pytest.mark.parametrize(
    ("content", "problem"),
    [
        (None, "no such file"),
        (b"\xff\xfe", "got UTF-16 text, not UTF-8, expected a map"),
        (b"a: [", "not valid YAML"),
        (b"", "got an empty file, expected a map"),
    ],
)
def test_what_is_no_text_or_yaml_is_refused_in_one_line(tmp_path, content, problem):
    path = tmp_path / "bad.yaml"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(MapError, match=problem) as told:
        MapEditor(path)
    assert str(told.value).count("\n") == 0


def test_radial_walls_stay_with_their_comments_and_an_opening_is_not_moved_onto_one(tmp_path):
    path = tmp_path / "mine.yaml"
    path.write_text(resources.share("maps").joinpath("detour.yaml").read_text())
    editor = MapEditor(path)
    kept = editor.text[editor.text.index("radial_walls:\n") :]
    editor.move(0, 98)  # 1-2@60 to the wall at 100
    assert editor.wrong == {("openings", 0), ("radial_walls", 0)}
    assert "radial_walls[0].angle_deg: stands in front of openings[0]" in str(editor.check.errors[0])
    with pytest.raises(MapError, match="stands in front"):
        editor.save()
    editor.move(0, 70)
    assert not editor.wrong
    added = editor.add(1)
    assert editor.check.errors == ()  # between openings and walls
    editor.remove(added)
    editor.widen(0, 16)
    assert editor.text.endswith(kept)
    assert load_map(editor.save()).radial_walls == load_map("detour").radial_walls


@pytest.fixture
def dragged(editor):
    """A scene of a fake page, and what it tells of drags; `pull` drags from a place, m, straight up the picture."""
    told = []
    page = SimpleNamespace(server=FakeServer(), framing=SimpleNamespace(show=lambda *layouts: None))
    scene = EditScene(page, lambda key, angle, phase: told.append((key, angle, phase)), lambda key: None)
    scene.show(editor, None)

    def pull(name, radius, angle, further):
        for phase, end in (("start", angle), ("update", angle + further), ("end", angle + further)):
            places = [UNIT * radius * np.array([np.cos(a), np.sin(a), 0.0]) for a in np.radians((angle, end))]
            camera = SimpleNamespace(position=(0.0, 0.0, 9.0))
            event = SimpleNamespace(
                phase=phase, start_position=places[0], end_position=places[1],
                client=SimpleNamespace(client_id=1, camera=camera),
            )  # fmt: skip
            asyncio.run(page.server.nodes[f"/map/{name}"].drag(event))
        return told

    return pull


@pytest.mark.parametrize("name", ["ring1", "ring2", "grip1"])
def test_a_drag_that_begins_beside_an_opening_grabs_it(editor, dragged, name):
    opening = editor.openings[0]
    told = dragged(name, editor.maze.threshold_radius(editor.maze.openings[0]), opening.angle_deg + 6.0, 20.0)
    assert [(key, phase) for key, _, phase in told] == [(("openings", 0), at) for at in ("start", "update", "end")]
    assert [angle for _, angle, _ in told] == pytest.approx([opening.angle_deg + d for d in (0.0, 20.0, 20.0)])


def test_a_drag_far_from_any_opening_moves_nothing(editor, dragged):
    far = editor.free_angle(1)
    assert dragged("ring1", 0.09, far, 20.0) == []


def test_a_file_that_others_change_is_told_and_read_again(tmp_path):
    path = tmp_path / "mine.yaml"
    text = (resources.share("maps") / "cme.yaml").read_text()
    path.write_text(text)
    editor = MapEditor(path)
    assert editor.overtaken() == ""
    path.write_text(f"# of another\n{text}")
    assert editor.overtaken() == "was changed by another program"
    shown = head_html(editor, "", "", editor.overtaken())
    assert "the file was changed by another program" in shown
    assert "as in the file" not in shown
    editor.read_again()
    assert editor.text.startswith("# of another")
    assert not editor.changed
    assert editor.overtaken() == ""
    editor.undo()
    assert editor.text == text
    path.unlink()
    assert editor.overtaken() == "is gone"


def test_rings_and_radial_walls_are_added_removed_and_undone(editor):
    assert editor.add_ring(2) == 1
    assert editor.check.errors == ()
    assert [len(editor.of(section)) for section in SECTIONS] == [6, 0, 4]
    new = next(opening for opening in editor.openings if opening.outer == 1)
    assert (new.angle_deg, new.width_mm) == (290, 17)  # where there is most room in the wall outside ring 2, as before
    wall = editor.piece("radial_walls", editor.add_wall(3))
    assert (wall.outer, wall.width_mm) == (3, 5)
    assert editor.check.errors == ()
    editor.move(0, wall.angle_deg + 40.0, section="radial_walls")
    editor.widen(0, 4, section="radial_walls")
    assert editor.piece("radial_walls", 0).width_mm == 4
    editor.remove(0, "radial_walls")
    editor.remove(1, "rings")
    assert editor.check.maze.rings == load_map(LOPSIDED).rings
    for _ in range(6):
        assert editor.undo()
    assert editor.text == LOPSIDED.read_text()


def test_a_new_map_is_a_packaged_one_under_a_name_that_no_file_has(editor):
    folder = editor.path.parent
    (folder / "taken.yaml").write_text("theirs")
    for name, problem in (("taken.yaml", "exists already"), ("../a.yaml", "got the file name"), ("a", "got the file")):
        with pytest.raises(MapError, match=problem):
            editor.new("cme", name)
    with pytest.raises(MapError, match="got the template 'mine', expected one of cme, detour"):
        editor.new("mine", "b.yaml")
    assert editor.path.name == "mine.yaml"
    editor.new("detour", "b.yaml")
    assert editor.changed
    assert not editor.can_undo
    assert not (folder / "b.yaml").exists()
    (folder / "b.yaml").write_text("theirs, meanwhile")
    with pytest.raises(MapError, match="exists already"):
        editor.save()
    (folder / "b.yaml").unlink()
    assert load_map(editor.save()).name == "b"
    assert not editor.changed
    assert (folder / "taken.yaml").read_text() == "theirs"
    assert editor.path.read_text() == (resources.share("maps") / "detour.yaml").read_text().replace(
        "name: detour", 'name: "b"'
    )


def test_a_click_at_a_gap_chooses_its_opening_and_one_on_a_floor_its_ring(editor):
    chosen, page = [], SimpleNamespace(server=FakeServer(), framing=SimpleNamespace(show=lambda *layouts: None))
    scene = EditScene(page, lambda *drag: None, chosen.append)
    scene.show(editor, None)
    angle, radius = math.radians(17), UNIT * editor.maze.threshold_radius(editor.maze.openings[0])
    event = SimpleNamespace(
        ray_origin=(radius * math.cos(angle), radius * math.sin(angle), 9.0), ray_direction=(0.0, 0.0, -1.0)
    )
    asyncio.run(page.server.nodes["/map/grip1"].click(event))
    asyncio.run(page.server.nodes["/map/ring2"].click(event))
    assert chosen == [("openings", 0), ("rings", 1)]


def test_an_open_gap_stays_low_and_a_closed_one_is_filled(editor):
    def height(place: int) -> float:
        return float(np.max(page.server.nodes[f"/map/block{place}"].values[0][:, 2]))

    page = SimpleNamespace(server=FakeServer(), framing=SimpleNamespace(show=lambda *layouts: None))
    scene = EditScene(page, lambda *drag: None, lambda key: None)
    editor.close(1, True)
    scene.show(editor, None)
    wall = UNIT * editor.maze.wall_height
    assert height(0) < 0.1 * wall < 0.5 * wall < height(1)
