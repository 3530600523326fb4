"""Random trees run and halt cleanly; damaged files are errors at a line, or load. `tools/bench.py` does the same
with larger counts."""

from __future__ import annotations

from contextlib import suppress
from random import Random

import pytest
from fuzz_files import damaged_maps, damaged_trees
from fuzzing import KEYS, Dice, DiceRun, random_expression, random_tree, run_tree
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from mazeplan.btree.blackboard import Blackboard
from mazeplan.btree.script import parse_script
from mazeplan.btree.script_values import ScriptError

FEW = settings(deadline=None, derandomize=True, database=None, suppress_health_check=list(HealthCheck))


@pytest.mark.slow
@settings(FEW, max_examples=300)
@given(seed=st.integers(0, 2**32 - 1))
def test_random_trees_load_tick_and_halt_cleanly(tmp_path_factory, seed):
    path, rng = tmp_path_factory.getbasetemp() / "random.xml", Random(seed)
    path.write_text(random_tree(rng), encoding="utf-8")
    ended, _ = run_tree(path, rng, 200)
    assert ended in {"RUNNING", "SUCCESS", "FAILURE", "SKIPPED", "error"}


def test_random_trees_come_to_every_end_and_use_every_node(tmp_path):
    ends, started, text = set(), 0, ""
    for seed in range(80):
        rng = Random(seed)
        text += (xml := random_tree(rng))
        (tmp_path / "random.xml").write_text(xml, encoding="utf-8")
        ended, leaves = run_tree(tmp_path / "random.xml", rng, 30)
        ends.add(ended)
        started += leaves
    assert ends == {"RUNNING", "SUCCESS", "FAILURE", "SKIPPED", "error"}
    assert started > 500
    for word in ("<SubTree", "<Parallel", "<Timeout", "<KeepRunningUntilFailure", "_while=", "_failureIf=", "_skipIf="):
        assert word in text


def test_what_a_random_tree_is_judged_by_is_noticed():
    run = DiceRun(Random(0))
    leaf = Dice("d", run, Blackboard(), {})
    leaf.start()
    leaf.start()
    leaf.halt()
    leaf.halt()
    assert run.wrong == ["d was started twice", "d was halted, but did not run"]


@settings(FEW, max_examples=500)
@given(st.one_of(st.text(max_size=40), st.text("nx1.5()!&|=<>+-*/'\" aé_", max_size=40)))
def test_any_text_is_an_expression_or_an_error_with_its_column(text):
    said, expression = "column", None
    try:
        expression = parse_script(text)
    except ScriptError as error:
        said = str(error)
    assert "column" in said
    if expression is not None:
        with suppress(ScriptError):  # it can be read, and has no value
            assert expression.holds(Blackboard(values=KEYS)) in (True, False)


@settings(FEW, max_examples=200)
@given(seed=st.integers(0, 2**32 - 1))
def test_random_expressions_can_be_read_whatever_stands_on_the_blackboard(seed):
    rng = Random(seed)
    expression = parse_script(random_expression(rng))
    board = {key: rng.choice((0, -1.5, True, "red", "3", None, [], float("nan"), 10**400)) for key in KEYS}
    with suppress(ScriptError):
        assert expression.holds(Blackboard(values=board)) in (True, False)


@pytest.mark.slow
@pytest.mark.parametrize("damaged", [damaged_trees, damaged_maps])
def test_damaged_files_load_or_are_errors_at_a_line(damaged, tmp_path):
    outcome = damaged(1000, tmp_path)
    assert outcome.wrong == []
    for kind in outcome.refused:  # each kind of damage is sometimes harmless, mostly not
        assert 0 < outcome.loaded[kind] < outcome.refused[kind]
