"""The palette: readable on white, apart in grey and for eyes that see two of the three colours, one set of names."""

import re
from itertools import combinations
from pathlib import Path

import numpy as np
import pytest

from mazeplan.core import palette

NAMES = """planned real commanded measured good bad unsure neutral ring1 ring2 ring3 ring4 ring5 sixth
running success failure skipped idle second"""
TOGETHER = [
    ["planned", "real"],
    ["real", "second", "neutral"],
    ["commanded", "measured"],
    ["good", "bad", "unsure"],
    [f"ring{i}" for i in range(1, 6)],
    ["running", "success", "failure", "skipped", "idle"],
]
ROOT = Path(palette.__file__).parents[2]
# linear RGB as they are seen with one kind of cone missing (Machado, Oliveira, Fernandes 2009, severity 1)
SEEN = {
    "all cones": np.eye(3),
    "protanopia": [[0.152286, 1.052583, -0.204868], [0.114503, 0.786281, 0.099216], [-0.003882, -0.048116, 1.051998]],
    "deuteranopia": [[0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413], [-0.011820, 0.042940, 0.968881]],
    "tritanopia": [[1.255528, -0.076749, -0.178779], [-0.078411, 0.930809, 0.147602], [0.004733, 0.691367, 0.303900]],
}
TO_XYZ = np.array([[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]])


def linear(name):
    """Linear RGB of a name of the palette, or of a colour."""
    colour = palette.COLOURS.get(name, name)
    c = np.array([int(colour[i : i + 2], 16) for i in (1, 3, 5)]) / 255
    return np.where(c <= 0.04045, c / 12.92, ((c + 0.055) / 1.055) ** 2.4)


def lab(rgb):
    """CIE L*a*b* of linear RGB."""
    x = TO_XYZ @ np.clip(rgb, 0.0, 1.0) / TO_XYZ.sum(1)
    f = np.where(x > 0.008856, np.cbrt(x), 7.787 * x + 16 / 116)
    return np.array([116 * f[1] - 16, 500 * (f[0] - f[1]), 200 * (f[1] - f[2])])


def test_every_name_has_a_colour_and_nothing_else_has_a_style():
    assert set(palette.COLOURS) == set(NAMES.split())
    assert set(palette.DASHES) <= set(palette.COLOURS)
    assert palette.rgb("planned") == (0xD5, 0x5E, 0x00)


def contrast(one, other):
    """Contrast of two colours by WCAG 2.1: 1 (the same) to 21 (black on white)."""
    dark, light = sorted(TO_XYZ[1] @ linear(colour) for colour in (one, other))
    return (light + 0.05) / (dark + 0.05)


@pytest.mark.parametrize("name", [n for n in NAMES.split() if n not in ("skipped", "idle")])
def test_a_line_can_be_read_on_white(name):
    assert contrast(name, "#FFFFFF") >= 3.0  # WCAG 2.1, graphical objects


def test_contrast_is_that_of_wcag():
    assert contrast("#000000", "#FFFFFF") == pytest.approx(21.0)
    assert contrast("#777777", "#FFFFFF") == pytest.approx(4.48, abs=0.005)  # its textbook example that just fails


@pytest.mark.parametrize("name", palette.INKS)
def test_words_can_be_read_on_white_and_on_the_fills_below_them(name):
    tints = {"bad": ["bad"], "quiet": ["band", "bad", "chosen"], "ink": [*palette.TINTS]}
    for below in ["#FFFFFF", *(palette.TINTS[tint] for tint in tints.get(name, []))]:
        assert contrast(palette.INKS[name], below) >= 4.5, below  # WCAG 2.1, text


def test_the_edges_of_a_maze_are_seen_on_its_floor_and_the_ball_is_seen_as_one():
    for name in ("edge", "closed", "ball"):
        assert contrast(palette.MAZE[name], palette.MAZE["floor"]) >= 3.0
    assert contrast(palette.COLOURS["planned"], palette.MAZE["floor"]) >= 3.0  # the route


def test_no_other_file_of_the_program_or_its_tools_has_a_colour_of_its_own():
    files = [*(ROOT / "mazeplan").rglob("*.py"), *(ROOT / "mazeplan").rglob("*.html"), *(ROOT / "tools").glob("*.py")]
    found = {
        f"{file.relative_to(ROOT)}:{number}: {line.strip()}"
        for file in files
        if file.resolve() != Path(palette.__file__).resolve()
        for number, line in enumerate(file.read_text(encoding="utf-8").splitlines(), start=1)
        if re.search(r"""(?i)[:'"\s]#(?:[0-9a-f]{6}|[0-9a-f]{3})\b""", line) and "# " not in line[: line.find("#") + 2]
    }
    assert len(files) > 200
    assert not found


@pytest.mark.parametrize("seen", SEEN)
@pytest.mark.parametrize("group", TOGETHER, ids=" ".join)
def test_what_is_shown_together_looks_different(group, seen):
    for a, b in combinations(group, 2):
        here, there = (lab(np.array(SEEN[seen]) @ linear(name)) for name in (a, b))
        assert np.linalg.norm(here - there) > 15, (a, b)


@pytest.mark.parametrize("group", TOGETHER, ids=" ".join)
def test_it_stays_apart_in_grey(group):
    for a, b in combinations(group, 2):
        assert abs(lab(linear(a))[0] - lab(linear(b))[0]) > 7, (a, b)


@pytest.mark.parametrize("group", [g for g in TOGETHER if "idle" not in g], ids=" ".join)
def test_lines_differ_in_more_than_colour(group):
    drawn = [palette.DASHES.get(name) for name in group]
    assert len(set(drawn)) == len(drawn)
