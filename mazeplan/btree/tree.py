"""A tree that is ready to run, and a tree as text. If a SubTree occurs again in the text, its line is folded."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

from mazeplan.btree.blackboard import Blackboard
from mazeplan.btree.decorators import SubTree
from mazeplan.btree.leaf import Leaf
from mazeplan.btree.node import TreeNode, Waker
from mazeplan.btree.ports import Key, shown
from mazeplan.btree.status import FINISHED, INVALID, RUNNING, Status

MOST_ROUNDS = 1000  # maximum ticks of the root in one tick; a tree that asks for more goes on at the next tick
SYMBOLS = {
    "Sequence": "→", "SequenceWithMemory": "→*", "ReactiveSequence": "→ᴿ", "Fallback": "?", "ReactiveFallback": "?ᴿ",
    "Parallel": "⇉", "Repeat": "↻", "RetryUntilSuccessful": "↺", "Inverter": "¬",
}  # fmt: skip
FOLDED = "(as above)"


class BehaviorTree:
    """Root node and blackboard of one tree. again: called before the root is ticked once more within a tick."""

    def __init__(
        self, root: TreeNode, blackboard: Blackboard, name: str = "", again: Callable[[], None] | None = None
    ) -> None:
        self.root, self.blackboard, self.name = root, blackboard, name
        self._paths = list(_walk(root, ""))
        self._waker, self._again = Waker(), again
        for _, node in self._paths:
            node.waker = self._waker

    def tick(self) -> Status:
        """One tick of the tree: SUCCESS, FAILURE, RUNNING, or SKIPPED if conditions or children of the root say so.

        If a loop pauses, the root is ticked again at once, so that reactive nodes check their conditions."""
        self._waker.asked = False
        result, rounds = self.root.execute(), 1
        while result is RUNNING and self._waker.asked and rounds < MOST_ROUNDS:
            self._waker.asked = False
            if self._again is not None:
                self._again()
            result, rounds = self.root.execute(), rounds + 1
        if result in FINISHED:
            self.root.status = INVALID
        return result

    def halt(self) -> None:
        """Halt all nodes that run, also nodes that an exception in the middle of a tick has left running.

        If a script or a leaf raises an exception while it is halted, the other nodes are still halted; then the first
        exception is raised."""
        problems = list[Exception]()
        try:
            self.root.reset()
        except Exception as problem:
            problems.append(problem)
        for _, node in reversed(self._paths):  # children first, so that a parent finds nothing left to halt
            if node.status is RUNNING or (isinstance(node, Leaf) and node.interrupted):
                try:
                    node.halt_node()
                except Exception as problem:
                    problems.append(problem)
        if problems:
            raise problems[0]

    def nodes(self) -> Iterator[TreeNode]:
        """All nodes, parents first."""
        return (node for _, node in self._paths)

    def snapshot(self) -> list[tuple[str, str]]:
        """(path, result of the last tick) of every node; INVALID: it was halted since then, or never ticked."""
        return [(path, node.last.name) for path, node in self._paths]

    def outline(self) -> dict[str, tuple[Any, ...]]:
        """Facts of all nodes, parents first: paths, kinds and names, numbers of the parents (-1: none), and numbers of
        the conditions."""
        number = {id(node): i for i, (_, node) in enumerate(self._paths)}
        parents = [-1] * len(self._paths)
        for _, node in self._paths:
            for child in node.parts:
                parents[number[id(child)]] = number[id(node)]
        nodes = list(self.nodes())
        return {
            "paths": tuple(path for path, _ in self._paths),
            "kinds": tuple(type(node).__name__ for node in nodes),
            "names": tuple(node.name for node in nodes),
            "parents": tuple(parents),
            "conditions": tuple(i for i, node in enumerate(nodes) if node.category == "Condition"),
        }


def _walk(node: TreeNode, above: str) -> Iterator[tuple[str, TreeNode]]:
    path = f"{above}/{node.name}" if above else node.name
    yield path, node
    for child in node.parts:
        yield from _walk(child, path)


def tree_text(tree: BehaviorTree, whole: bool = False) -> str:
    """The tree as text, one line for each node, with its ports. whole: whether nothing is folded"""
    lines, drawn = list[str](), set[str]()

    def draw(node: TreeNode, branch: str, below: str) -> None:
        """branch: before the node; below: before what is below it"""
        folded = False
        if isinstance(node, SubTree) and not whole:
            name = str(node.values.get("ID", node.name))
            folded = name in drawn
            drawn.add(name)
        lines.append(f"{branch}{_words(node)}{f' {FOLDED}' if folded else ''}")
        for child in () if folded else node.parts:
            last = child is node.parts[-1]
            draw(child, below + ("└── " if last else "├── "), below + ("    " if last else "│   "))

    draw(tree.root, "", "")
    return "\n".join(lines)


def _words(node: TreeNode) -> str:
    """Kind of node, with a symbol; its name, if it is not that of its kind; ports and conditions as in the file."""
    kind = type(node).__name__
    ports = [f"{name}={_written(value)}" for name, value in node.values.items()]
    given = {} if node.conditions is None else node.conditions.given
    scripts = [f'{name}="{_written(script.text)}"' for name, script in given.items()]
    return " ".join(filter(None, (SYMBOLS.get(kind), kind, f"'{node.name}'" * (node.name != kind), *ports, *scripts)))


def _written(value: Any) -> str:
    if isinstance(value, Key):
        return str(value)
    text = ";".join(map(str, value)) if isinstance(value, list) else str(value)
    return text if text.isprintable() and len(text) <= 60 else shown(text)
