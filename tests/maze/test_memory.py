"""What happened at openings: it fades, weighs in routes, and is kept in a file."""

from __future__ import annotations

import math

import pytest

from mazeplan.core.errors import InputError
from mazeplan.maze.graph import RouteGraph
from mazeplan.maze.mapfile import load_map
from mazeplan.maze.memory import KEPT, OpeningMemory, load_memory, save_memory

CME = load_map("cme")
NAMES = tuple(opening.name for opening in CME.openings)


def test_counts_fade_by_the_time_that_passes():
    memory = OpeningMemory(fading_s=50.0)
    memory.record("a", success=False, now=10.0)
    memory.record("a", success=True, now=60.0)
    assert memory.tries("a", 60.0) == pytest.approx((1.0, math.exp(-1.0)))
    assert memory.tries("a", 110.0) == pytest.approx((math.exp(-1.0), math.exp(-2.0)))
    assert memory.tries("b", 110.0) == (0.0, 0.0)


def test_an_opening_that_failed_is_as_good_as_new_after_a_while():
    graph, theta = RouteGraph(CME), math.radians(20.0)
    for _ in range(5):
        graph.record("1-2@45", success=False)

    def chosen():
        found = graph.route(1, 2, theta)
        return found is not None and found.openings

    assert chosen() != ("1-2@45",)
    graph.now = 10.0 * graph.memory.fading_s
    assert chosen() == ("1-2@45",)


def test_a_file_brings_it_to_the_next_run(tmp_path):
    path = tmp_path / "openings.yaml"
    assert load_memory(path, NAMES).at_end(0.0) == {}
    memory = OpeningMemory()
    memory.record("1-2@45", success=False, now=3.0)
    memory.record("2-3@0", success=True, now=3.0)
    save_memory(memory, path, now=3.0)
    again = load_memory(path, NAMES)
    assert again.tries("1-2@45", 0.0) == pytest.approx((0.0, KEPT))
    assert again.tries("2-3@0", 0.0) == pytest.approx((KEPT, 0.0))
    assert [p.name for p in tmp_path.iterdir()] == ["openings.yaml"]


@pytest.mark.parametrize("name", ["cme", "true", "12", "a: b " * 40])
def test_a_memory_of_another_map_is_refused_with_both_names(tmp_path, name):
    path = tmp_path / "openings.yaml"
    save_memory(OpeningMemory(), path, 0.0, name)
    assert load_memory(path, NAMES, name).at_end(0.0) == load_memory(path, NAMES).at_end(0.0) == {}
    with pytest.raises(InputError) as error:
        load_memory(path, NAMES, "detour")
    assert f":3: map: got '{name[:20]}" in str(error.value)
    assert "expected 'detour', the map of this run; give another file" in str(error.value)
    assert "\n" not in str(error.value)


def test_names_that_yaml_would_read_otherwise_survive(tmp_path):
    path, names = tmp_path / "openings.yaml", ("12", "yes", "a: b", "# x", "é")
    memory = OpeningMemory()
    for name in names:
        memory.record(name, success=False, now=0.0)
    save_memory(memory, path, now=0.0)
    assert set(load_memory(path, names).at_end(0.0)) == set(names)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("format: 2\nopenings: {}\n", ":1: format: got 2, expected 1"),
        (
            "format: 1\nopenings:\n  nowhere: {failures: 1}\n",
            ":3: openings.nowhere: unknown key, expected one of 1-2@45",
        ),
        ("format: 1\nopenings:\n  1-2@45: {failures: -1}\n", "failures: got -1"),
        ("format: 1\nopenings:\n  1-2@45: {failures: .nan}\n", "openings"),
        ("format: 1\nopenings:\n  1-2@45: {losses: 1}\n", "losses: unknown key, expected one of successes, failures"),
        ("format: 1\nopenings: [1]\n", ":2: openings: got a list, expected a mapping"),
        ("", "got an empty file, expected a file of `navigate --memory`"),
    ],
)
def test_mistakes_are_one_line_with_place(tmp_path, text, said):
    path = tmp_path / "openings.yaml"
    path.write_text(text)
    with pytest.raises(InputError) as error:
        load_memory(path, NAMES)
    assert said in str(error.value)
    assert str(error.value).startswith(f"{path}:")
    assert "\n" not in str(error.value)


def test_a_folder_that_cannot_be_written_to_is_said(tmp_path):
    (tmp_path / "file").touch()
    with pytest.raises(InputError, match="cannot be written"):
        save_memory(OpeningMemory(), tmp_path / "file" / "openings.yaml", now=0.0)
