"""The map editor as a person uses it in Chromium: a new map, its rings and walls, a run on it."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest
from watching import browser, page, program

from mazeplan.maze.mapfile import load_map, packaged_maps

KEPT = Path(__file__).resolve().parent.parent.parent / "build" / "page"  # pictures to be looked at

pytestmark = pytest.mark.realtime


@pytest.fixture(scope="module")
def chromium():
    with browser() as opened:
        yield opened


def take(shown, label: str, choice: str) -> None:
    """Take a choice of a dropdown."""
    shown.get_by_role("combobox", name=label, exact=True).click()
    shown.get_by_role("option", name=choice, exact=True).click()


def press(shown, label: str) -> None:
    shown.get_by_role("button", name=label, exact=True).click()


def test_a_new_map_loses_a_ring_gains_walls_and_is_run(chromium, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    taken, mine, complaints = tmp_path / "taken.yaml", tmp_path / "mine.yaml", []
    taken.write_text("theirs")
    with program("--map", "lopsided", "--edit") as (_, url), page(chromium, url, complaints) as shown:
        shown.set_viewport_size({"width": 1300, "height": 1000})
        shown.get_by_text("New map", exact=True).click()
        take(shown, "Template", "cme")
        name = shown.get_by_role("textbox", name="File name", exact=True)
        name.fill("taken.yaml")
        press(shown, "Begin it")
        shown.locator("[data-refused]", has_text="exists already, expected the name of a new file").wait_for()
        name.fill("mine.yaml")
        press(shown, "Begin it")
        shown.locator("[data-line='14']", has_text='name: "mine"').wait_for()
        take(shown, "Part", "ring 1")
        press(shown, "Remove it")
        shown.locator("[data-line='23']", has_text="# removed ring 1").wait_for()
        take(shown, "Where", "wall 3–4")
        press(shown, "Add")
        shown.locator("[data-line]", has_text="{rings: [3, 4], angle_deg: 0, width_mm: 15.5}").wait_for()
        take(shown, "What", "radial wall")
        take(shown, "Where", "ring 2")
        press(shown, "Add")
        shown.locator("[data-line]", has_text="- {ring: 2, angle_deg: ").wait_for()
        shown.locator("[data-errors='0']").wait_for()
        assert not mine.exists()
        press(shown, "Save and run")
        shown.locator("[data-trial=over]", has_text="✓ arrived after").wait_for()
        shown.wait_for_timeout(500)  # until the path is drawn
        shown.screenshot(path=KEPT / "editor.png")
        maze = load_map(mine)
        assert (len(maze.rings), len(maze.openings), len(maze.radial_walls)) == (4, 10, 1)
        press(shown, "Add")
        press(shown, "Begin it")  # the name is now taken; but first the question
        shown.get_by_role("button", name="Leave them", exact=True).wait_for()
        press(shown, "Back to the map")
        shown.locator("[data-changed='1']").wait_for()
    assert taken.read_text() == "theirs"
    assert load_map(mine).radial_walls == maze.radial_walls  # what was not saved is not in the file
    checked = subprocess.run(
        [sys.executable, "-m", "mazeplan", "map", "check", str(mine)], capture_output=True, text=True, check=False
    )
    assert (checked.returncode, checked.stderr) == (0, "")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["mine.yaml", "taken.yaml"]
    assert "mine" not in packaged_maps()
    assert complaints == []
