"""A test in real time is tried again, and says why it was skipped."""

from __future__ import annotations

from pathlib import Path

import pytest

pytest_plugins = ["pytester"]
TESTS = Path(__file__).resolve().parent
HOOKS = """
import pytest
from in_real_time import judge, try_again

def pytest_configure(config):
    config.addinivalue_line("markers", "realtime: by the clock on the wall")

def pytest_collection_modifyitems(items):
    for item in items:
        try_again(item)

@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(item):
    report = yield
    judge(item, report)
    return report
"""


def outcomes(pytester: pytest.Pytester, test: str) -> tuple[dict[str, int], str]:
    pytester.makeconftest(HOOKS)
    pytester.makepyfile(f"import sys, pytest\ntries = []\n{test}")
    pytester.makeini(f"[pytest]\npythonpath = {TESTS}\n")
    result = pytester.runpytest_subprocess("-rs", "-p", "no:cacheprovider", "-p", "no:xdist")
    return result.parseoutcomes(), result.stdout.str()


@pytest.mark.slow
@pytest.mark.parametrize(("fails", "expected"), [(2, {"passed": 1, "rerun": 2}), (3, {"failed": 1, "rerun": 2})])
def test_a_test_in_real_time_has_three_tries(pytester, fails, expected):
    test = f"@pytest.mark.realtime\ndef test_it():\n    tries.append(1)\n    assert len(tries) > {fails}"
    assert outcomes(pytester, test)[0] == expected


def test_another_test_has_one(pytester):
    assert outcomes(pytester, "def test_it():\n    tries.append(1)\n    assert len(tries) > 1")[0] == {"failed": 1}


def test_on_a_machine_that_is_too_slow_the_third_failure_is_skipped_with_the_reason(pytester):
    line = "this machine does not keep up: 9 of 20 pictures were lost"
    test = f"@pytest.mark.realtime\ndef test_it():\n    print({line!r}, file=sys.stderr)\n    assert False"
    found, text = outcomes(pytester, test)
    assert found == {"skipped": 1, "rerun": 2}
    assert f"3 tries failed: {line}" in text


def test_a_test_that_does_not_go_by_the_clock_fails_on_a_slow_machine_too(pytester):
    line = "this machine does not keep up: 9 of 20 pictures were lost"
    test = f"def test_it():\n    print({line!r}, file=sys.stderr)\n    assert False"
    assert outcomes(pytester, test)[0] == {"failed": 1}
