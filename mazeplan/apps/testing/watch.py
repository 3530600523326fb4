"""Puts scripts into the leaves of a tree, and records all that happens in it: nodes, halts, events, commands.

A script says what a leaf does in place of its work, such as `RUNNING x3 then FAILURE(stuck) then SUCCESS`:

    script = act { "then" act }                    the last act goes on for ever
    act    = status [ "(" kind of failure ")" ] [ "x" number ]
    status = RUNNING | SUCCESS | FAILURE | SKIPPED

The short form has one letter for each tick, such as `RRRFS`, with `-` for SKIPPED. SKIPPED acts like a precondition:
it halts a leaf that runs. When the tree enters the leaf again, the script continues where it was.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

from mazeplan.apps.testing.lightrig import LightRig
from mazeplan.apps.testing.record import HALTED, NodeInfo, Record, Step, Tick
from mazeplan.behavior.context import RunContext
from mazeplan.btree.leaf import Leaf
from mazeplan.btree.node import TreeNode
from mazeplan.btree.ports import shown
from mazeplan.btree.status import FAILURE, RUNNING, SKIPPED, SUCCESS, Status
from mazeplan.btree.tree import BehaviorTree
from mazeplan.core.errors import InputError
from mazeplan.core.events import RunEvent, TimedEvent
from mazeplan.core.records import Failure, FailureKind, Plan

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


class Watch:
    """Call it with a tree that has not begun, and its context. It puts scripts into leaves and writes the record.

    leaves: {name, kind or path of leaves: script}; the call raises InputError for a leaf that the tree does not have
    rig: gives the true place of the ball; None: the record has the estimate"""

    def __init__(
        self, record: Record, leaves: Mapping[str, str | Script] | None = None, rig: LightRig | None = None
    ) -> None:
        self.record, self._rig = record, rig
        self._scripts = {name: one if isinstance(one, Script) else script(one) for name, one in (leaves or {}).items()}
        self._players: dict[TreeNode, Player] = {}
        self._numbers: dict[TreeNode, int] = {}
        self._ticking: list[int] = []  # numbers in `record.steps` of the nodes that are being ticked now

    def __call__(self, tree: BehaviorTree, context: RunContext) -> None:
        """Watch a tree from now on. A second tree of the same file belongs to the next goal of the same run."""
        self._context, self.record.tree = context, tree.name
        self._numbers = {node: number for number, node in enumerate(tree.nodes())}
        self.record.nodes = [
            NodeInfo(path, node.name, type(node).__name__, isinstance(node, Leaf))
            for node, path in zip(tree.nodes(), tree.outline()["paths"], strict=True)
        ]
        leaves = [info for info in self.record.nodes if info.is_leaf]
        for name in self._scripts:
            if not any(name in (info.path, info.name, info.kind) for info in leaves):
                known = dict.fromkeys(info.name for info in leaves)
                raise InputError(f"got {shown(name)}, expected a leaf of the tree: {', '.join(known)}", key="leaves")
        for node, info in zip(self._numbers, self.record.nodes, strict=True):
            # a path counts before a name, a name before a kind
            name = next((name for name in (info.path, info.name, info.kind) if name in self._scripts), None)
            if name is not None and isinstance(node, Leaf):
                self._players[node] = Player(node, self._scripts[name])
            node.probe = self
            self._watch_halts(node)
        self._watch_ticks(tree)
        self._watch_events(context)

    @property
    def now(self) -> float:
        """Rig time, s, rounded because adding up samples leaves errors in the last digits."""
        return round(self._context.now, 9)

    def before(self, node: TreeNode) -> Status | None:
        """Called before a tick of a node (`btree.node.Probe`). The step keeps the place before those of children."""
        self._ticking.append(len(self.record.steps))
        self._note(node, RUNNING.name, ticked=True)
        player = self._players.get(node)
        return None if player is None else player.before(node)

    def after(self, node: TreeNode, result: Status) -> None:
        """Called after a tick of a node, and when a precondition has decided in its place."""
        steps, at = self.record.steps, self._ticking[-1] if self._ticking else None
        if at is not None and steps[at].node == self._numbers[node]:
            self._ticking.pop()
            steps[at] = replace(steps[at], what=result.name, ticked=result.name != "SKIPPED")
        else:
            self._note(node, result.name)

    def _note(self, node: TreeNode, what: str, ticked: bool = False) -> None:
        self.record.steps.append(Step(self.now, self._numbers[node], what, ticked))

    def _watch_halts(self, node: TreeNode) -> None:
        halt_node = node.halt_node

        def watched() -> None:
            if node.status is RUNNING:
                self._note(node, HALTED)
            halt_node()

        node.halt_node = watched

    def _watch_ticks(self, tree: BehaviorTree) -> None:
        tick = tree.tick

        def watched() -> Status:
            status, run, rig = tick(), self._context, self._rig
            ring, theta = (run.here.ring, run.here.theta) if rig is None else (rig.ring, rig.theta)
            seen, command, leaf = run.here.seen, run.command, run.commanded_by
            self.record.ticks.append(Tick(self.now, ring, theta, seen, status.name, command, leaf))
            return status

        tree.tick = watched

    def _watch_events(self, context: RunContext) -> None:
        report = context.report

        def watched(event: RunEvent | Plan) -> None:
            if not isinstance(event, Plan):
                self.record.events.append(TimedEvent(self.now, event))
            report(event)

        context.report = watched
