"""Notes all that happens in a tree: every node of every tick, halts, preconditions, events, the command of the tick."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

from mazeplan.apps.testing.leafscript import Player, Script, script
from mazeplan.behavior.conditions import CONDITIONS, DECISIONS, WHILE, Conditions
from mazeplan.behavior.context import RunContext
from mazeplan.behavior.controls import Fallback, ReactiveFallback
from mazeplan.behavior.decorators import SubTree
from mazeplan.behavior.leaf import Leaf
from mazeplan.behavior.node import Node, TreeNode
from mazeplan.behavior.ports import shown
from mazeplan.behavior.status import RUNNING, Result
from mazeplan.behavior.tree import BehaviorTree, parts_of
from mazeplan.core.errors import InputError
from mazeplan.core.events import RunEvent, TimedEvent
from mazeplan.core.records import Command, Plan

Key = tuple[str | int, ...]
HALTED, RAISED = "HALTED", "RAISED"


@dataclass(frozen=True)
class NodeInfo:
    """A node of the tree that ran.

    short: its path in its own <BehaviorTree>, which begins with the name of that; element: the same for all uses of one
    place in the file, as a subtree used twice has; parent: index of the node above; chooses: it takes one of its
    children after the other until one will do; conditions: names of its preconditions."""

    index: int
    path: str
    short: str
    name: str
    kind: str
    file: Path | None
    line: int
    element: tuple[str | int, ...]
    parent: int | None
    is_leaf: bool
    chooses: bool
    conditions: tuple[str, ...]

    @property
    def place(self) -> str:
        """file:line."""
        return f"{self.file}:{self.line}"


TICKED = ("RUNNING", "SUCCESS", "FAILURE")


@dataclass(frozen=True)
class Step:
    """One thing that happened to a node in a tick: RUNNING, SUCCESS, FAILURE, SKIPPED, HALTED, RAISED; or one of its
    preconditions was looked at (`_skipIf`), and decided or let it pass."""

    tick: int
    t: float
    node: int
    what: str
    decided: bool = False

    @property
    def ticked(self) -> bool:
        """Whether a node did something: a precondition that decides passes it by."""
        return self.what in TICKED and not self.decided


@dataclass(frozen=True)
class Tick:
    """One tick: rig time in s, where the ball was (rad; the truth, where the rig tells it), how the root ended, and the
    command in rad with the leaf that gave it."""

    t: float
    ring: int
    theta: float
    seen: bool
    status: str
    command: Command | None
    leaf: str


Truth = Callable[[], tuple[int, float] | None]  # ring and theta of the ball, as the rig knows them


class Watch:
    """Called with a tree that has not begun, and its context: puts scripts into leaves and notes what happens.

    leaves: {name, kind or path of leaves: script}. Raises InputError for one that is not in the tree."""

    def __init__(self, leaves: Mapping[str, str | Script] | None = None, truth: Truth = lambda: None) -> None:
        self._scripts = {
            name: given if isinstance(given, Script) else script(given) for name, given in (leaves or {}).items()
        }
        self._truth = truth
        self.tree_name = ""
        self.nodes: list[NodeInfo] = []
        self.ticks: list[Tick] = []
        self.events: list[TimedEvent] = []
        self.players: dict[str, list[Player]] = {}
        self._steps: list[Step] = []

    @property
    def steps(self) -> list[Step]:
        """All steps in order; a node comes before its children."""
        return list(self._steps)

    def __call__(self, tree: BehaviorTree, context: RunContext) -> None:
        """Watch a tree from now on; a second one of the same file is the next goal of the same run."""
        self.tree_name, self._context, nodes = tree.name, context, list(tree.nodes())
        if not self.nodes:
            self.nodes = list(_described(tree.root, tree.name))
        self.players = {}
        unused = set(self._scripts)
        for info, node in zip(self.nodes, nodes, strict=True):
            if node.conditions is not None:
                node.conditions = _Conditions(node.conditions, info.index, self._note)  # type: ignore[assignment]  # asked as conditions are
            name = self._script_for(info)
            if name is not None and isinstance(node, Leaf):
                unused.discard(name)
                self.players.setdefault(name, []).append(Player(node, self._scripts[name]))
            self._watch_node(info.index, node)
        self._refuse(unused)
        self._watch_tree(tree)
        self._watch_events(context)

    def _script_for(self, info: NodeInfo) -> str | None:
        """By path before name before kind."""
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
        """Rig time, s, without the last digits that adding up samples leaves."""
        return round(self._context.now, 9)

    # -- what is noted ----------------------------------------------------------------------------------------------

    def _note(self, node: int, what: str, decided: bool = False) -> None:
        self._steps.append(Step(len(self.ticks), self.now, node, what, decided))

    def _watch_node(self, index: int, node: TreeNode) -> None:
        execute = node.execute

        def watched_execute() -> Result:
            at = len(self._steps)
            self._note(index, RAISED)  # keeps the place before the children; stays only where the tick raises
            result = execute()
            first = self._steps[at]
            passed = isinstance(node.conditions, _Conditions) and node.conditions.decided
            self._steps[at] = Step(first.tick, first.t, index, result.name, passed)
            return result

        def watched_halt() -> None:
            self._note(index, HALTED)  # called while it runs only
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
    """Pre- and postconditions that tell which precondition decided. decided: whether one did at the last tick."""

    def __init__(self, conditions: Conditions, node: int, note: Callable[[int, str, bool], None]) -> None:
        self._conditions, self._node, self._note, self.decided = conditions, node, note, False
        self.given, self.scope = conditions.given, conditions.scope
        self.after, self.halted = conditions.after, conditions.halted

    def decide(self, status: Result) -> Result | None:
        """As `Conditions.decide`, one after the other."""
        self.decided = False
        for name in DECISIONS:
            if name in self.given and (status is not RUNNING or name == WHILE):
                result = Conditions({name: self.given[name]}, self.scope).decide(status)
                self._note(self._node, name, result is not None)
                if result is not None:
                    self.decided = True
                    return result
        return None


def _described(root: TreeNode, tree: str) -> Iterator[NodeInfo]:
    """All nodes, parents first, as BehaviorTree.nodes() gives them."""
    count = 0

    def walk(node: TreeNode, parent: int | None, above: str, tree: str, element: Key) -> Iterator[NodeInfo]:
        nonlocal count
        index, count = count, count + 1
        path, short = f"{above}/{node.name}".lstrip("/"), f"{tree}/{node.name}"
        file, line = (None, 0) if node.place is None else (node.place.file, node.place.line)
        given = () if node.conditions is None else tuple(name for name in CONDITIONS if name in node.conditions.given)
        leaf, chooses = not isinstance(node, Node), isinstance(node, Fallback | ReactiveFallback)
        kind = type(node).__name__
        yield NodeInfo(index, path, short, node.name, kind, file, line, element, parent, leaf, chooses, given)
        if isinstance(node, SubTree):  # what it uses is the same wherever it is used
            short = str(node._values.get("ID", node.name))
            element = (short,)
        for i, child in enumerate(parts_of(node)):
            yield from walk(child, index, path, short, (*element, i))

    yield from walk(root, None, "", tree, (tree, 0))
