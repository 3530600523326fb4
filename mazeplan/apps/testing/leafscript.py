"""Scripts of leaves: what a leaf does in place of its work, such as `RUNNING x3 then FAILURE(stuck) then SUCCESS`.

    script = act { "then" act }                    the last act goes on for ever
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
from mazeplan.btree.node import TreeNode
from mazeplan.btree.ports import shown
from mazeplan.btree.status import FAILURE, RUNNING, SKIPPED, SUCCESS, Status
from mazeplan.core.errors import InputError
from mazeplan.core.records import Failure, FailureKind

STATUSES: dict[str, Status] = {"RUNNING": RUNNING, "SUCCESS": SUCCESS, "FAILURE": FAILURE, "SKIPPED": SKIPPED}
LETTERS: dict[str, Status] = {"R": RUNNING, "S": SUCCESS, "F": FAILURE, "-": SKIPPED}
KINDS = "|".join(FailureKind)
ACT = re.compile(rf"(RUNNING|SUCCESS|SKIPPED|FAILURE(?:\s*\(\s*({KINDS})\s*\))?)\s*(?:x\s*([0-9]{{1,4}}))?")
GRAMMAR = (
    "acts such as RUNNING x3, SUCCESS, FAILURE(KIND) or SKIPPED, joined by then; or RRS; "
    f"KIND is one of {', '.join(FailureKind)}"
)


@dataclass(frozen=True)
class Act:
    """One tick of a script: the status that the leaf returns, and the kind of failure that it reports, if any."""

    status: Status
    kind: FailureKind | None = None


@dataclass(frozen=True)
class Script:
    """What a leaf does, tick by tick."""

    acts: tuple[Act, ...]  # one for each tick; the last act goes on for ever
    sets: Mapping[str, Any] = field(default_factory=dict)  # values that the leaf writes to its ports when it succeeds


def script(text: str, **sets: Any) -> Script:
    """Read a script. Raises InputError.

    sets: {port: value} that the leaf writes when it succeeds"""
    words = text.strip()
    if words and set(words) <= set(LETTERS):
        return Script(tuple(Act(LETTERS[letter]) for letter in words), sets)
    acts: list[Act] = []
    for part in re.split(r"\s+then\s+", words):
        found = ACT.fullmatch(part.strip())
        if found is None:
            raise InputError(f"got {shown(part.strip())}, expected {GRAMMAR}", key=f"script {shown(text)}")
        status, kind, times = found.groups()
        act = Act(STATUSES[status.split("(")[0].strip()], None if kind is None else FailureKind(kind))
        acts += [act] * int(times or 1)
    return Script(tuple(acts), sets)


class Player:
    """Does what a script says in place of a leaf, as its probe (`btree.node.Probe`). Preconditions still count.

    ticks: number of steps
    starts: how often the leaf was entered
    halts: how often the leaf was interrupted
    ends: how often the leaf succeeded or failed"""

    def __init__(self, leaf: Leaf, script: Script) -> None:
        self.leaf, self.script = leaf, script
        self.at = self.ticks = self.starts = self.halts = self.ends = 0
        leaf.probe, leaf.on_halt = self, self._count_halt

    def before(self, node: TreeNode) -> Status:
        """The result of this tick."""
        act = self.script.acts[self.at]
        self.at = min(self.at + 1, len(self.script.acts) - 1)
        if act.status is SKIPPED:
            node.reset()
            return SKIPPED
        self.starts += node.status is not RUNNING
        self.ticks += 1
        self.ends += act.status is not RUNNING
        if act.kind is not None:
            self.leaf.fail(Failure(act.kind, self.leaf.name, self.leaf.context.clock(), "as the script says"))
        if act.status is SUCCESS:
            for port, value in self.script.sets.items():
                self.leaf.set(port, value)
        return act.status

    def after(self, node: TreeNode, result: Status) -> None:
        """The result stays."""

    def _count_halt(self) -> None:
        self.halts += 1
