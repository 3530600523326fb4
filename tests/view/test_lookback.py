"""The time of a live run: its moments, its failures, and where a person looks."""

from __future__ import annotations

import pytest

from mazeplan.apps.view import lookback
from mazeplan.apps.view.lookback import Past, marks_html
from mazeplan.apps.view.moment import Moment
from mazeplan.core.records import Failure, FailureKind

STUCK, LOST = (Failure(FailureKind(kind), "Track", t, "") for kind, t in (("stuck", 0.4), ("ball_lost", 0.8)))


def moment(tick, failure=None, **more):
    return Moment(run=1, tick=tick, t=tick / 10, failure=failure, **more)


@pytest.fixture
def past():
    """Ten ticks of 0.1 s, with two failures."""
    past = Past()
    for tick in range(11):
        past.keep(moment(tick, STUCK if 4 <= tick < 8 else LOST if tick >= 8 else None))
    return past


def test_the_newest_moment_is_shown_until_a_person_looks_back(past):
    assert past.shown().tick == 10
    past.seek(0.55)
    assert past.shown().tick == 5
    past.keep(moment(11, LOST))
    assert past.shown().tick == 5
    past.seek(past.last)
    assert past.at is None
    past.keep(moment(12, LOST))
    assert past.shown().tick == 12


def test_one_can_jump_to_each_failure_and_beyond_the_last_to_the_present(past):
    assert [failure.kind for failure in past.failures] == ["stuck", "ball_lost"]
    past.jump(-1)
    assert past.shown().failure is LOST
    past.jump(-1)
    assert (past.at, past.shown().failure) == (0.4, STUCK)
    past.jump(-1)
    assert past.at == 0.4
    past.jump(1)
    past.jump(1)
    assert past.at is None


def test_another_run_begins_anew(past):
    past.seek(0.3)
    past.keep(Moment(run=2, tick=1, t=0.0))
    assert (past.shown().run, past.failures, past.at) == (2, [], None)


def test_the_end_of_a_run_is_kept_once_and_a_long_run_forgets_its_beginning(past, monkeypatch):
    for _ in range(3):
        past.keep(moment(10, LOST, result={"success": False}))
    assert past.shown().result is not None
    assert len(past._moments) == 10
    monkeypatch.setattr(lookback, "MOST", 20)
    monkeypatch.setattr(lookback, "FEWER", 5)
    for tick in range(11, 40):
        past.keep(moment(tick, LOST))
    assert len(past._moments) <= 20
    past.seek(0.0)
    assert past.shown().tick > 10  # the oldest that is left


def test_failures_are_crosses_at_their_times(past):
    html = marks_html(past, 2.0)
    assert "left:20.0%" in html
    assert "left:40.0%" in html
    assert "0.40 s: stuck" in html
    assert "looks back" not in html
    past.seek(0.3)
    assert "looks back to 0.30 s" in marks_html(past, 2.0)
