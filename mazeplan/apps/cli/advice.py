"""What to look at after a run that did not arrive: the check, report or setting of the line `next:`."""

from __future__ import annotations

import shlex
from collections import Counter
from typing import TYPE_CHECKING

from mazeplan.core.records import FailureKind

if TYPE_CHECKING:
    from mazeplan.core.records import NavigationResult

BY_HAND = ("stopped", "interrupted", "skipped")
NOT_THE_BALL = (FailureKind.OUT_OF_TIME, FailureKind.MISFIT)
NO_WAY = (FailureKind.NO_ROUTE, FailureKind.OPENING_CLOSED)
MEASURED = (FailureKind.BALL_LOST, FailureKind.BALL_OUT, FailureKind.RIG_FAILED)


def next_step(result: NavigationResult, rig: str) -> str:
    """The next thing to do, in a line; empty if the run arrived or somebody ended it. rig: as --rig takes it"""
    if result.success or result.reason in BY_HAND:
        return ""
    kinds = Counter(f.kind for f in result.failures if f.kind not in NOT_THE_BALL)
    kind = kinds.most_common(1)[0][0] if kinds else None
    if kind in NO_WAY:
        return "mazeplan map route: it shows which openings lead to the goal"
    if result.reason == FailureKind.MISFIT or result.doubts or kind in MEASURED:
        return f"mazeplan rig check {shlex.quote(rig)}: it tests signs, axes, clock and sensors of the rig"
    if kind is None:
        return "a larger --time-limit: nothing went wrong"
    if result.log is None:
        return "the same command with --log run.mcap, then mazeplan report run.mcap: it draws each failure"
    log, what = shlex.quote(result.log), kind.replace("_", " ")
    return f"mazeplan report {log}: it draws each {what}; mazeplan diagnose {log}: it says what the model lacks"
