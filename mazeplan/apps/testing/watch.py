"""Records all that happens in a tree: each node of each tick, halts, preconditions, events, the command of the tick."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from mazeplan.apps.testing.leafscript import Player, Script, script
from mazeplan.apps.testing.lightrig import LightRig
from mazeplan.apps.testing.record import HALTED, NodeInfo, Record, Step, Tick
from mazeplan.behavior.context import RunContext
from mazeplan.btree.leaf import Leaf
from mazeplan.btree.node import TreeNode
from mazeplan.btree.ports import shown
from mazeplan.btree.status import RUNNING, Status
from mazeplan.btree.tree import BehaviorTree
from mazeplan.core.errors import InputError
from mazeplan.core.events import RunEvent, TimedEvent
from mazeplan.core.records import Plan


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
        self._check_names()
        for node, info in zip(self._numbers, self.record.nodes, strict=True):
            # a path counts before a name, a name before a kind
            name = next((name for name in (info.path, info.name, info.kind) if name in self._scripts), None)
            if name is not None and isinstance(node, Leaf):
                self._players[node] = Player(node, self._scripts[name])
            node.probe = self
            self._watch_halts(node)
        self._watch_ticks(tree)
        self._watch_events(context)

    def _check_names(self) -> None:
        leaves = [info for info in self.record.nodes if info.is_leaf]
        for name in self._scripts:
            if not any(name in (info.path, info.name, info.kind) for info in leaves):
                known = dict.fromkeys(info.name for info in leaves)
                raise InputError(f"got {shown(name)}, expected a leaf of the tree: {', '.join(known)}", key="leaves")

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
