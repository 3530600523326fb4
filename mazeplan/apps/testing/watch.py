"""Records all that happens in a tree: each node of each tick, halts, preconditions, events, the command of the tick."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from itertools import count

from mazeplan.apps.testing.leafscript import Player, Script, script
from mazeplan.behavior.context import RunContext
from mazeplan.btree.conditions import Conditions
from mazeplan.btree.leaf import Leaf
from mazeplan.btree.node import Node, TreeNode
from mazeplan.btree.ports import shown
from mazeplan.btree.status import Result
from mazeplan.btree.tree import BehaviorTree, parts_of
from mazeplan.core.errors import InputError
from mazeplan.core.events import RunEvent, TimedEvent
from mazeplan.core.records import Command, Plan

HALTED, RAISED = "HALTED", "RAISED"


@dataclass(frozen=True)
class NodeInfo:
    """A node of the tree that ran.

    index: number of the node, in the order of `BehaviorTree.nodes()`
    path: names from the root of the main tree to the node"""

    index: int
    path: str
    name: str
    kind: str
    is_leaf: bool


TICKED = ("RUNNING", "SUCCESS", "FAILURE")


@dataclass(frozen=True)
class Step:
    """One thing that happened to a node in a tick.

    tick: number of the tick
    t: rig time, s
    node: index of the node
    what: RUNNING, SUCCESS, FAILURE, SKIPPED, HALTED or RAISED
    decided: whether a precondition decided in place of the node"""

    tick: int
    t: float
    node: int
    what: str
    decided: bool = False

    @property
    def ticked(self) -> bool:
        """Whether the node itself was ticked: no precondition decided in its place."""
        return self.what in TICKED and not self.decided


@dataclass(frozen=True)
class Tick:
    """One tick of the tree.

    t: rig time, s
    ring, theta: place of the ball, theta in rad; the true place if the rig gives it, else the estimate
    seen: whether the camera saw the ball
    status: of the root
    command: in rad
    leaf: the leaf that gave the command"""

    t: float
    ring: int
    theta: float
    seen: bool
    status: str
    command: Command | None
    leaf: str


Truth = Callable[[], tuple[int, float] | None]  # true ring and theta of the ball; None if the rig does not give them


class Watch:
    """Call it with a tree that has not begun, and its context. It puts scripts into leaves and records what happens.

    leaves: {name, kind or path of leaves: script}; the call raises InputError for a leaf that the tree does not have
    truth: gives the true place of the ball"""

    def __init__(self, leaves: Mapping[str, str | Script] | None = None, truth: Truth = lambda: None) -> None:
        self._scripts = {
            name: given if isinstance(given, Script) else script(given) for name, given in (leaves or {}).items()
        }
        self._truth = truth
        self.tree_name = ""
        self.nodes: list[NodeInfo] = []
        self.ticks: list[Tick] = []
        self.events: list[TimedEvent] = []
        self._steps: list[Step] = []

    @property
    def steps(self) -> list[Step]:
        """All steps in order; a node comes before its children."""
        return list(self._steps)

    def __call__(self, tree: BehaviorTree, context: RunContext) -> None:
        """Watch a tree from now on. A second tree of the same file belongs to the next goal of the same run."""
        self.tree_name, self._context, nodes = tree.name, context, list(tree.nodes())
        if not self.nodes:
            self.nodes = list(_described(tree.root))
        unused = set(self._scripts)
        for info, node in zip(self.nodes, nodes, strict=True):
            name = self._script_for(info)
            if name is not None and isinstance(node, Leaf):
                unused.discard(name)
                Player(node, self._scripts[name])  # keeps itself alive in the leaf
            self._watch_node(info.index, node)
        self._refuse(unused)
        self._watch_tree(tree)
        self._watch_events(context)

    def _script_for(self, info: NodeInfo) -> str | None:
        """The key of the script for a leaf, if any. A path counts before a name, a name before a kind."""
        if not info.is_leaf:
            return None
        names = (info.path, info.name, info.kind)
        return next((name for name in names if name in self._scripts), None)

    def _refuse(self, unused: set[str]) -> None:
        for name in sorted(unused):
            if not any(name in (info.path, info.name, info.kind) and info.is_leaf for info in self.nodes):
                known = dict.fromkeys(info.name for info in self.nodes if info.is_leaf)
                raise InputError(f"got {shown(name)}, expected a leaf of the tree: {', '.join(known)}", key="leaves")

    @property
    def now(self) -> float:
        """Rig time, s, rounded because adding up samples leaves errors in the last digits."""
        return round(self._context.now, 9)

    # -- what is recorded -------------------------------------------------------------------------------------------

    def _note(self, node: int, what: str) -> None:
        self._steps.append(Step(len(self.ticks), self.now, node, what))

    def _watch_node(self, index: int, node: TreeNode) -> None:
        execute, conditions = node.execute, None
        if node.conditions is not None:
            conditions = _Conditions(node.conditions)
            node.conditions = conditions  # pyright: ignore[reportAttributeAccessIssue]  # has the same methods

        def watched_execute() -> Result:
            at = len(self._steps)
            self._note(index, RAISED)  # keeps the place before the children; stays only if the tick raises
            result = execute()
            first, decided = self._steps[at], conditions is not None and conditions.decided
            self._steps[at] = Step(first.tick, first.t, index, result.name, decided)
            return result

        def watched_halt() -> None:
            self._note(index, HALTED)  # called only while the node runs
            halt()

        node.execute = watched_execute
        if isinstance(node, Leaf):
            halt, node.halt = node.halt, watched_halt
        else:
            halt, node.halt_node = node.halt_node, watched_halt

    def _watch_tree(self, tree: BehaviorTree) -> None:
        tick = tree.tick

        def watched() -> Result:
            status = RAISED
            try:
                result = tick()
                status = result.name
                return result
            finally:
                run = self._context
                ring, theta = self._truth() or (run.here.ring, run.here.theta)
                self.ticks.append(Tick(self.now, ring, theta, run.here.seen, status, run.command, run.commanded_by))

        tree.tick = watched

    def _watch_events(self, context: RunContext) -> None:
        report = context.report

        def watched(event: RunEvent | Plan) -> None:
            if not isinstance(event, Plan):
                self.events.append(TimedEvent(self.now, event))
            report(event)

        context.report = watched


class _Conditions:
    """Pre- and postconditions of a node. decided: whether a precondition decided at the last tick"""

    def __init__(self, conditions: Conditions) -> None:
        self._decide, self.decided = conditions.decide, False
        self.given, self.after, self.halted = conditions.given, conditions.after, conditions.halted

    def decide(self, status: Result) -> Result | None:
        """The same as `Conditions.decide`."""
        result = self._decide(status)
        self.decided = result is not None
        return result


def _described(root: TreeNode) -> Iterator[NodeInfo]:
    """All nodes, parents first, in the order of `BehaviorTree.nodes()`."""
    numbers = count()

    def walk(node: TreeNode, above: str) -> Iterator[NodeInfo]:
        path = f"{above}/{node.name}".lstrip("/")
        yield NodeInfo(next(numbers), path, node.name, type(node).__name__, not isinstance(node, Node))
        for child in parts_of(node):
            yield from walk(child, path)

    yield from walk(root, "")
