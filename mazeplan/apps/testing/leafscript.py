"""Scripts of leaves: what a leaf does in place of its work, such as `RUNNING x3 then FAILURE(stuck) then SUCCESS`.

    script = act { "then" act } [ "again" ]        the last act goes on for ever, or the script begins again
    act    = status [ "(" kind of failure ")" ] [ "x" number ]
    status = RUNNING | SUCCESS | FAILURE | SKIPPED

The short form has one letter for each tick, such as `RRRFS`, with `-` for SKIPPED. SKIPPED acts like a precondition:
it halts a leaf that runs. When the tree enters the leaf again, the script continues where it was.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from mazeplan.btree.leaf import Leaf
from mazeplan.btree.ports import shown
from mazeplan.btree.status import FAILURE, RUNNING, SKIPPED, SUCCESS, Result, Status
from mazeplan.core.errors import InputError
from mazeplan.core.records import Failure, FailureKind

STATUSES: dict[str, Result] = {"RUNNING": RUNNING, "SUCCESS": SUCCESS, "FAILURE": FAILURE, "SKIPPED": SKIPPED}
LETTERS: dict[str, Result] = {"R": RUNNING, "S": SUCCESS, "F": FAILURE, "-": SKIPPED}
MOST = 100_000  # maximum number of ticks that a script may spell out
ACT = re.compile(r"(?P<status>[A-Z]+)\s*(\(\s*(?P<kind>\w+)\s*\))?\s*(x\s*(?P<times>[0-9]{1,6}))?")
GRAMMAR = "acts such as RUNNING x3, SUCCESS, FAILURE(stuck) or SKIPPED, joined by then; again at the end; or RRS"


@dataclass(frozen=True)
class Act:
    """One tick of a script: the status that the leaf returns, and the kind of failure that it reports, if any."""

    status: Result
    kind: FailureKind | None = None


@dataclass(frozen=True)
class Script:
    """What a leaf does, tick by tick.

    text: the script as written
    acts: one for each tick
    again: whether the script begins again after the last act; otherwise the last act goes on for ever
    sets: values that the leaf writes to its ports when it succeeds"""

    text: str
    acts: tuple[Act, ...]
    again: bool = False
    sets: Mapping[str, Any] = field(default_factory=dict)


def script(text: str, **sets: Any) -> Script:
    """Read a script. Raises InputError.

    sets: {port: value} that the leaf writes when it succeeds"""
    words = text.strip()
    if words and set(words) <= set(LETTERS):
        return Script(text, tuple(Act(LETTERS[letter]) for letter in words), sets=sets)
    again = words.endswith(" again")
    acts: list[Act] = []
    for part in re.split(r"\s+then\s+", words.removesuffix(" again").rstrip(" ,")):
        found = ACT.fullmatch(part.strip())
        if found is None or found["status"] not in STATUSES:
            raise InputError(f"got {shown(part.strip())}, expected {GRAMMAR}", key=f"script {shown(text)}")
        acts += [_act(found, text)] * int(found["times"] or 1)
        if len(acts) > MOST:
            raise InputError(f"more than {MOST} ticks", key=f"script {shown(text)}")
    if not acts:
        raise InputError("got no act, expected at least one", key=f"script {shown(text)}")
    return Script(text, tuple(acts), again, sets)


def _act(found: re.Match[str], text: str) -> Act:
    status, kind = STATUSES[found["status"]], found["kind"]
    kinds = [str(known) for known in FailureKind]
    if kind is not None and (status is not FAILURE or kind not in kinds):
        expected = f"FAILURE with one of {', '.join(kinds)}"
        raise InputError(f"got {shown(found[0].strip())}, expected {expected}", key=f"script {shown(text)}")
    return Act(status, None if kind is None else FailureKind(kind))


class Player:
    """Makes a leaf do what a script says. The leaf keeps its name, place, ports and preconditions.

    ticks: number of steps
    starts: how often the leaf was entered
    halts: how often the leaf was interrupted
    ends: how often the leaf succeeded or failed"""

    def __init__(self, leaf: Leaf, script: Script) -> None:
        self.leaf, self.script = leaf, script
        self.at = self.ticks = self.starts = self.halts = self.ends = 0
        self._conditions = leaf.conditions
        leaf.start, leaf.step, leaf.halt = self._start, self._step, self._halt
        leaf.wind_down = lambda: SUCCESS
        leaf.conditions = self  # type: ignore[assignment]  # has the same methods

    @property
    def given(self) -> Mapping[str, Any]:
        """The pre- and postconditions that the tree gives to the leaf."""
        return {} if self._conditions is None else self._conditions.given

    def decide(self, status: Result) -> Result | None:
        """The decision of the tree's preconditions for the leaf, otherwise SKIPPED if the script says so."""
        decided = None if self._conditions is None else self._conditions.decide(status)
        if decided is None and self.script.acts[self.at].status is SKIPPED:
            self._next()
            return SKIPPED
        return decided

    def after(self, result: Result) -> None:
        """The postconditions that the tree gives to the leaf."""
        if self._conditions is not None:
            self._conditions.after(result)

    def halted(self) -> None:
        """The script that the tree gives to the leaf for a halt."""
        if self._conditions is not None:
            self._conditions.halted()

    def _next(self) -> Act:
        act, n = self.script.acts[self.at], len(self.script.acts)
        self.at = (self.at + 1) % n if self.script.again else min(self.at + 1, n - 1)
        return act

    def _start(self) -> None:
        self.starts += 1

    def _step(self) -> Status:
        act = self._next()
        self.ticks += 1
        self.ends += act.status is not RUNNING
        if act.kind is not None:
            self.leaf.fail(Failure(act.kind, self.leaf.name, self.leaf.context.clock(), "as the script says"))
        if act.status is SUCCESS:
            for port, value in self.script.sets.items():
                self.leaf.set(port, value)
        assert isinstance(act.status, Status)  # SKIPPED was decided before
        return act.status

    def _halt(self) -> None:
        self.halts += 1
