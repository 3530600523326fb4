"""Claims of a run: that they hold where they should, and what they say where they do not."""

from __future__ import annotations

import re

import pytest

from mazeplan.apps.testing import run_tree
from mazeplan.core.errors import InputError


def hold(seconds):
    return lambda rig: setattr(rig, "glued", rig.t < seconds)


@pytest.fixture(scope="module")
def stuck():
    return run_tree(mishap=hold(1.5))


@pytest.fixture(scope="module")
def smooth():
    return run_tree()


@pytest.fixture(scope="module")
def held():
    return run_tree(mishap=hold(9.0), time_limit=3.99)


def test_what_holds_can_be_claimed_in_one_breath(stuck):
    stuck.reaches().reaches(3).reaches("ring5").reaches(2).reaches().within(5.0)
    stuck.ends_with("arrived").never("ball_lost", "BackOff", "AvoidOpening")
    stuck.visits("Track", "Dither", "PassOpening", "Settle")
    assert stuck.failures == ["stuck"]
    assert stuck.recoveries == ["dither"]
    assert stuck.openings == ["1-2@45", "2-3@90", "3-4@135", "4-5@180"]
    assert stuck.result is not None
    assert stuck.result.time_s == pytest.approx(stuck.time_s)


@pytest.mark.parametrize(
    ("claim", "said"),
    [
        (lambda r: r.reaches(), "expected the tree to succeed with the ball in ring 5"),
        (lambda r: r.reaches(4), "expected the ball in ring 4, it was in 1"),
        (lambda r: r.within(3.0), "expected an end within 3 s, it took 4.000 s"),
        (lambda r: r.ends_with("arrived"), "expected the end 'arrived', got 'out_of_time'"),
        (lambda r: r.never("stuck"), "expected never stuck, it happened at "),
        (lambda r: r.never("Dither"), "expected Dither never to be ticked, it was at "),
        (lambda r: r.never("out_of_time"), "expected never out_of_time, it happened at 4.000 s"),
        (lambda r: r.visits("Settle"), "expected Settle to be ticked, it never was"),
        (
            lambda r: r.visits("Dither", "shake it free", "BallSeen", "PassOpening"),
            "expected PassOpening to be ticked, it n",
        ),
    ],
)
def test_what_does_not_hold_is_said_with_what_happened_instead(held, claim, said):
    with pytest.raises(AssertionError, match="^" + re.escape(said)) as caught:
        claim(held)
    text = str(caught.value)
    assert "Navigate ended after 4.000 s: out_of_time\n" in text
    assert "failure stuck" in text
    assert len(text.splitlines()) <= 18


def test_a_name_that_is_nothing_is_refused_or_the_claim_would_hold_for_ever(smooth):
    for claim in (smooth.never, smooth.visits, smooth.statuses):
        with pytest.raises(InputError, match="got 'Dithr', expected a leaf"):
            claim("Dithr")
    with pytest.raises(InputError, match="ring: got 'ring7', expected ring1 to ring5"):
        smooth.reaches("ring7")
