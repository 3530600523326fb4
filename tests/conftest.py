"""What holds for all tests."""

from __future__ import annotations

import signal
from functools import cache
from pathlib import Path

import pytest
import typer.main
from in_real_time import judge, try_again

TESTS = Path(__file__).resolve().parent
WHOLE = (TESTS, TESTS / "testing", TESTS / "run")  # folders whose tests drive the whole program, tick by tick
LONG = (  # a quarter of a minute or more in one test
    "test_pages.py", "diagnosis/test_walls.py", "rigs/sim/test_simulated.py",
    "run/test_improve.py",
)  # fmt: skip
# Typer builds all commands anew for each call, which takes longer than most calls of a test
typer.main.get_command = cache(typer.main.get_command)


def pytest_configure() -> None:
    """Tests that were begun in the background by a shell ignore Ctrl-C, and so would the programs that they start and
    end by it."""
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Long tests go first, so that no worker is at one when the others have done. Lines are counted by the tests of the
    rooms and of the command line: counting makes the long runs of the whole program half as long again, and there is
    little that they alone reach. With --cov-context (tools/reached.py), all tests count."""
    first = [TESTS / name for name in LONG]
    assert all(path.is_file() for path in first), "a file of long tests has another name now"
    items.sort(key=lambda item: first.index(item.path) if item.path in first else len(first))
    for item in items:
        if item.path.parent in WHOLE and not config.getoption("cov_context", None):
            item.add_marker("no_cover")
        try_again(item)


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(item: pytest.Item):
    report = yield
    judge(item, report)
    return report


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    """One run on the toy in which the deadline ended searches: its log, and its result."""
    from replayed import HURRIED

    from mazeplan.run.execution import navigate

    path = tmp_path_factory.mktemp("replay") / "run.mcap"
    result = navigate(3, 5, rig="toy", settings=HURRIED, log=path, seed=4)
    return path, result


@pytest.fixture(autouse=True)
def _compiling_is_not_reported():
    """Any test may be the first to compile, also before its command begins. The patch is this fixture's own: the one of
    a test is to be taken back before the effects are, below."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("mazeplan.apps.cli.progress.report_compiling", lambda: None)
        yield


@pytest.fixture(autouse=True)
def _effects_of_this_test_alone():
    """Effects that a test registers are forgotten behind it."""
    from mazeplan.physics import registry

    before = dict(registry.EFFECTS)
    yield
    registry.EFFECTS.clear()
    registry.EFFECTS.update(before)
