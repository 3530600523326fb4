"""Faults on purpose: valid code that differs in one place, and a test that does not notice one is told."""

from __future__ import annotations

import ast

import mutate
import pytest
import reached
from mutate import Fault, chosen_tests, drawn, faults_in, files_for, main
from reached import FAST, SLOW, record

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


def test_files_of_tests_are_sorted_by_the_imports_between_them_and_the_module(module):
    room, tests = module.parent, module.parents[2] / "tests"
    (room / "near.py").write_text("from mazeplan.core.small import f\n")
    (room / "far.py").write_text("def g():\n    from mazeplan.core import near\n")
    (tests / "run").mkdir(parents=True)
    for name, text in {
        "test_far": "from mazeplan.core.far import g\n",
        "run/test_itself": "import mazeplan.core.small\n",
        "test_near": "from mazeplan.core.near import f\n",
        "test_small": "from helpers import bench\n",
        "test_of_something_else": "from mazeplan.core.records import State\n",
    }.items():
        (tests / f"{name}.py").write_text(text)
    assert files_for("mazeplan/core/small.py") == [
        "tests/run/test_itself.py",
        "tests/test_small.py",
        "tests/test_near.py",
        "tests/test_far.py",
    ]


@pytest.mark.slow
def test_a_test_that_fails_without_a_fault_too_hides_none(module, monkeypatch, capsys):
    tests = module.parents[2] / "tests" / "core"
    tests.mkdir(parents=True)
    (tests / "test_small.py").write_text(
        "import pytest\nfrom mazeplan.core.small import f\n\n\n"
        "def test_of_another_machine():\n    assert f is None\n\n\n"
        "@pytest.mark.parametrize('b', [4], ids=['two words - and a dash'])\ndef test_f(b):\n    assert f(1, b) == 4\n"
    )
    faults = [f for f in faults_in(module) if (f.line, f.before) in ((8, "*"), (8, "<="))]
    monkeypatch.setattr(mutate, "drawn", lambda *arguments: faults)
    monkeypatch.setattr("sys.argv", ["mutate.py", "-o", str(module.parents[2] / "out.jsonl")])
    main()
    told = capsys.readouterr().out
    assert "noticed 1" in told
    assert "survived 1" in told
    assert told.endswith("fail without a fault, too: tests/core/test_small.py::test_of_another_machine\n")


@pytest.mark.slow
def test_tests_that_run_the_changed_line_look_for_a_fault_and_no_others(module):
    module.write_text("def f():\n    return (\n        1 + 2\n    )\n\n\ndef g():\n    return 3 * 4\n\n\nLIMIT = 5\n")
    tests = module.parents[2] / "tests"
    tests.mkdir()
    (tests / "test_long.py").write_text(
        "import time\nfrom mazeplan.core.small import f\n\n\ndef test_f():\n    time.sleep(0.3)\n    assert f() == 3\n"
    )
    (tests / "test_short.py").write_text(
        "from mazeplan.core.small import f, g\ndef test_f():\n    assert f()\ndef test_g():\n    assert g() == 12\n"
    )
    record(FAST, reached.OUTPUT, module.parents[2], workers=1)
    plus, times, limit = (next(f for f in faults_in(module) if f.before == before) for before in ("+", "*", "5"))
    assert chosen_tests(plus, FAST) == ["tests/test_short.py::test_f", "tests/test_long.py::test_f"]
    assert chosen_tests(times, FAST) == ["tests/test_short.py::test_g"]
    assert chosen_tests(limit, FAST) == ["tests/test_short.py", "tests/test_long.py"]  # both import it
    assert chosen_tests(plus, SLOW) == ["tests/test_short.py", "tests/test_long.py"]  # not recorded
