"""Tests that go by the clock on the wall, on machines that may be busy with something else.

Such a test runs up to three times, as any pause of the machine can fail it once. The program itself may report that the
machine was too slow (`this machine does not keep up: ...`, for example as pictures of an emulated camera were lost).
Then the third failure says nothing of the program: the test is skipped with that line as the reason.
"""

from __future__ import annotations

import pytest

RETRIES = 2
TOO_SLOW = "this machine does not keep up"


def try_again(item: pytest.Item) -> None:
    """Let a test in real time run up to three times."""
    if item.get_closest_marker("realtime"):
        item.add_marker(pytest.mark.flaky(reruns=RETRIES))


def too_slow(report: pytest.TestReport) -> str | None:
    """The line by which the program reported a machine that is too slow for it, or None."""
    said = f"{report.longreprtext}\n{report.capstderr}".splitlines()
    return next((line[line.index(TOO_SLOW) :] for line in said if TOO_SLOW in line), None)


def judge(item: pytest.Item, report: pytest.TestReport) -> None:
    """Skip a test whose last try failed on a machine that is too slow."""
    if report.when != "call" or not report.failed or getattr(item, "execution_count", 1) <= RETRIES:
        return
    if item.get_closest_marker("realtime") and (reason := too_slow(report)) is not None:
        report.outcome = "skipped"
        report.longrepr = (str(item.path), item.location[1] or 0, f"{RETRIES + 1} tries failed: {reason}")
