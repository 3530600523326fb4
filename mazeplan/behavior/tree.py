"""A tree that is ready to run."""

from __future__ import annotations

from collections.abc import Iterator

from py_trees.behaviour import Behaviour
from py_trees.common import Status

from mazeplan.behavior.blackboard import Blackboard


class BehaviorTree:
    """Root node and blackboard of one run."""

    def __init__(self, root: Behaviour, blackboard: Blackboard, name: str = "") -> None:
        self.root, self.blackboard, self.name = root, blackboard, name
        self._paths = [(path, node) for path, node in _walk(root, "")]

    def tick(self) -> Status:
        """Tick once from the root: SUCCESS, FAILURE or RUNNING."""
        for _ in self.root.tick():
            pass
        return self.root.status

    def halt(self) -> None:
        """Halt everything that runs, also what an exception in the middle of a tick has left running."""
        if self.root.status is Status.RUNNING:
            self.root.stop(Status.INVALID)
        for _, node in self._paths:
            if node.status is Status.RUNNING or getattr(node, "_running", False):
                node.stop(Status.INVALID)

    def nodes(self) -> Iterator[Behaviour]:
        """All nodes, parents first."""
        return (node for _, node in self._paths)

    def snapshot(self) -> list[tuple[str, str]]:
        """(path, status) of every node."""
        return [(path, node.status.name) for path, node in self._paths]

    def active_path(self) -> list[str]:
        """Names from the root to the leaf that is running; empty when none is."""
        path, node = [], self.root
        while node.status is Status.RUNNING:
            path.append(node.name)
            running = [child for child in node.children if child.status is Status.RUNNING]
            if not running:
                break
            node = running[0]
        return path


def _walk(node: Behaviour, above: str) -> Iterator[tuple[str, Behaviour]]:
    path = f"{above}/{node.name}" if above else node.name
    yield path, node
    for child in node.children:
        yield from _walk(child, path)
