"""Faults on purpose: valid code that differs in one place, and a test that does not notice one is told."""

from __future__ import annotations

import ast

import mutate
import pytest
import reached
from mutate import Fault, drawn, faults_in, files_for, main

SOURCE = """
LIMIT: int = 3

def f(a, b):
    '''Not a < b.'''
    if not (a < b) and a - b > 0.5:
        raise ValueError(f"got {a + b}, expected less than 7")
    return a * b if a <= 2 or b == LIMIT else True
"""


@pytest.fixture
def module(tmp_path, monkeypatch):
    monkeypatch.setattr(mutate, "ROOT", tmp_path)
    monkeypatch.setattr(reached, "OUTPUT", tmp_path / "build" / "reached")
    monkeypatch.setattr(reached, "OUTPUT_SLOW", tmp_path / "build" / "reached-slow")
    path = tmp_path / "mazeplan" / "core" / "small.py"
    path.parent.mkdir(parents=True)
    path.write_text(SOURCE)
    for folder in path.parents[:2]:
        (folder / "__init__.py").write_text("")
    return path


def test_each_fault_is_one_valid_change_and_texts_and_messages_are_left_alone(module):
    changes = set()
    for fault in faults_in(module):
        changed = SOURCE.encode()[: fault.start] + fault.after.encode() + SOURCE.encode()[fault.end :]
        assert ast.dump(ast.parse(changed)) != ast.dump(ast.parse(SOURCE))
        assert SOURCE.splitlines()[fault.line - 1].count(fault.before)
        changes.add((fault.line, fault.before, fault.after))
    assert changes == {
        (2, "3", "4"), (6, "not", "not not"), (6, "<", "<="), (6, "and", "or"), (6, "-", "+"), (6, ">", ">="),
        (6, "0.5", "0.75"), (8, "*", "/"), (8, "<=", "<"), (8, "2", "3"), (8, "or", "and"), (8, "==", "!="),
        (8, "True", "False"),
    }  # fmt: skip
    assert drawn(5, 1, ["mazeplan/core"]) == drawn(5, 1, ["mazeplan/core"]) != drawn(5, 2, ["mazeplan/core"])


@pytest.mark.slow
def test_a_fault_that_no_test_notices_is_told_and_a_second_call_goes_on(module, monkeypatch, capsys):
    tests = module.parents[2] / "tests" / "core"
    tests.mkdir(parents=True)
    (tests / "test_small.py").write_text(
        "from mazeplan.core.small import f\n\n\ndef test_f():\n    assert f(1, 4) == 4\n    assert f(5, 6) is True\n"
    )
    assert files_for("mazeplan/core/small.py") == ["tests/core/test_small.py"]
    faults = [f for f in faults_in(module) if (f.line, f.before) in ((8, "*"), (8, "<="), (6, "0.5"))]
    monkeypatch.setattr(mutate, "drawn", lambda *arguments: faults)
    monkeypatch.setattr("sys.argv", ["mutate.py", "-o", str(module.parents[2] / "out.jsonl")])
    main()
    told = capsys.readouterr().out
    assert "survived: mazeplan/core/small.py:6: '0.5' -> '0.75'" in told
    assert "survived: mazeplan/core/small.py:8: '<=' -> '<'" in told
    assert "survived 2" in told
    assert "noticed 1" in told
    assert module.read_text() == SOURCE
    monkeypatch.setattr(mutate, "noticed", lambda *arguments: pytest.fail("asked again"))
    main()
    assert capsys.readouterr().out == told
    assert isinstance(faults[0], Fault)
