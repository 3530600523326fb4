"""A tree that is ready to run."""

from __future__ import annotations

from collections.abc import Iterator

from mazeplan.behavior.blackboard import Blackboard
from mazeplan.behavior.leaf import TreeNode
from mazeplan.behavior.nodes import Node
from mazeplan.behavior.status import INVALID, RUNNING, Result


class BehaviorTree:
    """Root node and blackboard of one run."""

    def __init__(self, root: TreeNode, blackboard: Blackboard, name: str = "") -> None:
        self.root, self.blackboard, self.name = root, blackboard, name
        self._paths = [(path, node) for path, node in _walk(root, "")]

    def tick(self) -> Result:
        """Tick once from the root: SUCCESS, FAILURE, RUNNING, or SKIPPED if its conditions or children say so."""
        for _ in self.root.tick():
            pass
        return self.root.result

    def halt(self) -> None:
        """Halt everything that runs, also what an exception in the middle of a tick has left running."""
        self.root.reset()
        for _, node in self._paths:
            if node.status is RUNNING or getattr(node, "_running", False):
                node.stop(INVALID)

    def nodes(self) -> Iterator[TreeNode]:
        """All nodes, parents first."""
        return (node for _, node in self._paths)

    def snapshot(self) -> list[tuple[str, str]]:
        """(path, how its last tick ended) of every node; INVALID: it was halted since, or never ticked."""
        return [(path, node.result.name) for path, node in self._paths]

    def outline(self) -> tuple[list[str], list[str], list[str], list[int], list[int]]:
        """Paths, kinds (class names), names and parents (numbers, -1 of the root) of all nodes, parents first; and the
        numbers of those that only ask, whose failure is the answer no."""
        number = {id(node): i for i, (_, node) in enumerate(self._paths)}
        parents = [-1] * len(self._paths)
        for _, node in self._paths:
            for child in parts_of(node):
                parents[number[id(child)]] = number[id(node)]
        nodes = list(self.nodes())
        return (
            [path for path, _ in self._paths], [type(node).__name__ for node in nodes],
            [node.name for node in nodes], parents,
            [i for i, node in enumerate(nodes) if getattr(node, "category", "") == "Condition"],
        )  # fmt: skip

    def results(self) -> list[str]:
        """How the last tick of each node ended, in the same order; see `snapshot`."""
        return [node.result.name for _, node in self._paths]

    def active_path(self) -> list[str]:
        """Names from the root to the leaf that is running; empty when none is."""
        path, node = [], self.root
        while node.status is RUNNING:
            path.append(node.name)
            running = [child for child in parts_of(node) if child.status is RUNNING]
            if not running:
                break
            node = running[0]
        return path


def _walk(node: TreeNode, above: str) -> Iterator[tuple[str, TreeNode]]:
    path = f"{above}/{node.name}" if above else node.name
    yield path, node
    for child in parts_of(node):
        yield from _walk(child, path)


def parts_of(node: TreeNode) -> tuple[TreeNode, ...]:
    """The children of a node, none of a leaf."""
    return node.parts if isinstance(node, Node) else ()
