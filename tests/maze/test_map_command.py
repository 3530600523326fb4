from __future__ import annotations

import json
from dataclasses import replace

import pytest
from typer.testing import CliRunner

from mazeplan.apps.cli.map import app
from mazeplan.core.errors import InputError
from mazeplan.maze.mapfile import dump_map, load_map
from mazeplan.run.resolve import opening_name, ring_number

CME = load_map("cme")


def run(*words: str):
    return CliRunner().invoke(app, list(words))


@pytest.mark.parametrize(
    ("text", "ring"),
    [("ring1", 1), ("5", 5), ("Ring 3", 3), ("ring-2", 2), (" ring4 ", 4), ("center", 5), ("Centre", 5)],
)
def test_the_ways_to_write_a_ring(text, ring):
    assert ring_number(text, CME) == ring


@pytest.mark.parametrize("text", ["ring0", "ring6", "", "ring", "one", "-1", "1.0", "ring1 ring2", "9999999", "²"])
def test_what_is_no_ring_is_refused(text):
    with pytest.raises(InputError, match=r"expected ring1 to ring5 or centre \(map cme\)"):
        ring_number(text, CME)


def test_the_name_of_an_opening():
    assert opening_name("1-2@45", CME) == "1-2@45"
    with pytest.raises(InputError, match="expected one of 1-2@45, 1-2@135"):
        opening_name("1-2@46", CME)


def test_check_good_maps():
    result = run("check", "cme", "lopsided")
    assert result.exit_code == 0
    assert result.stdout.splitlines() == [
        "cme: ok: cme, 5 rings, 13 openings",
        "lopsided: ok: lopsided, 3 rings, 5 openings",
    ]


def test_check_names_every_problem_and_goes_on(tmp_path):
    bad = tmp_path / "bad.yaml"
    text = dump_map(CME)
    bad.write_text(text.replace("angle_deg: 45", "angle_deg: 400"))
    result = run("check", str(bad), "cme")
    assert result.exit_code == 2
    assert "cme: ok" in result.stdout
    line = text[: text.index("angle_deg: 45")].count("\n") + 1
    assert f"{bad}:{line}: openings[0].angle_deg: got 400" in result.stderr
    assert len(result.stderr.splitlines()) == 2
    document = json.loads(run("check", "--json", str(bad), "cme").stdout)
    assert [item["ok"] for item in document] == [False, True]
    assert len(document[0]["errors"]) == 2


def test_check_warns_of_rings_behind_closed_openings(tmp_path):
    path = tmp_path / "closed.yaml"
    path.write_text(dump_map(CME).replace("width_mm: 15.5", "width_mm: 15.5, closed: true"))
    result = run("check", str(path))
    assert result.exit_code == 0
    assert "warning: ring 5 can be reached only through closed openings" in result.stderr


def test_route_in_words():
    result = run("route", "--start-angle", "-20")
    assert result.exit_code == 0
    lines = result.stdout.splitlines()
    assert len(lines) == 5
    assert lines[0].startswith("ring 1: turn   -25.0 deg, opening 1-2@315 to ring 2")
    assert lines[-1].startswith("ring 5: goal")


def test_route_as_json():
    result = run("route", "lopsided", "--from", "3", "--to", "ring1", "--close", "wide", "--json")
    document = json.loads(result.stdout)
    assert document["found"] is True
    assert (document["map"], document["from"], document["to"]) == ("lopsided", 3, 1)
    assert [leg["ring"] for leg in document["legs"]] == [3, 2]
    assert "wide" not in [leg["opening"] for leg in document["legs"]]
    assert document["expected_s"] == pytest.approx(sum(leg["expected_s"] for leg in document["legs"]))


def test_without_a_route_closed_openings_are_told(tmp_path):
    maze = load_map("cme")
    closed = replace(maze, openings=tuple(replace(opening, closed=True) for opening in maze.openings))
    (tmp_path / "closed.yaml").write_text(dump_map(closed))
    result = run("route", str(tmp_path / "closed.yaml"))
    assert result.exit_code == 1
    assert "through the openings of map cme (13 of 13 are closed in it)" in result.stderr


def test_no_route_is_exit_status_1():
    result = run("route", "--close", "4-5@180")
    assert result.exit_code == 1
    assert "no route from ring1 to ring5" in result.stderr
    result = run("route", "--close", "4-5@180", "--json")
    assert result.exit_code == 1
    assert json.loads(result.stdout)["found"] is False


def test_show(tmp_path):
    plain, routed = tmp_path / "plain.png", tmp_path / "routed.png"
    assert run("show", "lopsided", "-o", str(plain)).exit_code == 0
    assert run("show", "lopsided", "-o", str(routed), "--route").exit_code == 0
    assert plain.read_bytes()[:4] == routed.read_bytes()[:4] == b"\x89PNG"
    assert plain.read_bytes() != routed.read_bytes()


def test_a_watched_map_is_drawn_again_at_each_save(tmp_path, monkeypatch):
    path, picture = tmp_path / "mine.yaml", tmp_path / "mine.png"
    good = dump_map(CME)
    path.write_text(good)
    saves = iter([good.replace("angle_deg: 45", "angle_deg: 400"), good.replace("angle_deg: 45", "angle_deg: 50")])
    pictures = []

    def save_next(seconds):
        pictures.append(picture.read_bytes())
        text = next(saves, None)
        if text is None:
            raise KeyboardInterrupt
        path.write_text(text)

    monkeypatch.setattr("time.sleep", save_next)
    ran = run("show", str(path), "-o", str(picture), "--watch")
    first, mistake, last = pictures
    assert first == mistake != last
    assert "openings[0].angle_deg: got 400" in ran.output


@pytest.mark.parametrize(
    "words",
    [
        ("route", "nope"),
        ("route", "--to", "ring9"),
        ("route", "--close", "x"),
        ("route", "detour", "--start-angle", "100"),  # a radial wall
    ],
)
def test_bad_input_is_an_input_error(words):
    error = run(*words).exception
    assert isinstance(error, InputError)
    assert error.exit_status == 2
    assert "\n" not in str(error)


@pytest.mark.parametrize("words", [("route", "--start-angle", "nan"), ("show", "-o", "maze.gif")])
def test_an_option_that_cannot_be_read_is_a_usage_error(words):
    assert run(*words).exit_code == 2
