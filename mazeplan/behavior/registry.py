"""The nodes that a tree may name: packaged leaves, and nodes from users' modules (`--behavior-module MODULE`).

A node is a public class of its module, and has the name of the class. A leaf derives from `leaf.Leaf` and has a `step`.
A control node or decorator derives from `controls.Control` or `decorators.Decorator` and has a `run`. Scripts know the
members of a public `enum.IntEnum` of a user's module by name.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from enum import IntEnum
from types import ModuleType
from typing import Any

from mazeplan.behavior import ball_leaves, follow_policy, opening_leaves, recovery, travel
from mazeplan.btree.builder import BUILTIN, OPTION
from mazeplan.btree.controls import Control
from mazeplan.btree.decorators import Decorator
from mazeplan.btree.leaf import Leaf
from mazeplan.btree.node import Node, TreeNode
from mazeplan.btree.ports import CONVERSIONS, REQUIRED, Port, shown
from mazeplan.core.errors import InputError
from mazeplan.core.user_modules import user_module

OF_THE_MAP = ("openings", "rings")
CATEGORIES = ("Action", "Condition")
DIRECTIONS = ("in", "out", "inout")
EXPECTED = (
    "a class derived from mazeplan.MazeLeaf that has a step, or from mazeplan.Control or Decorator that has a run"
)
# names of the format itself, which no node of a user may have
RESERVED = (*CATEGORIES, *BUILTIN, "SubTree", "Control", "Decorator", "BehaviorTree", "TreeNodesModel")


class Registry(dict[str, type[TreeNode]]):
    """Nodes by name. enums: {name: number} for scripts"""

    def __init__(self) -> None:
        super().__init__(REGISTRY)
        self.enums: dict[str, int] = {}


def registry_with(modules: Iterable[str] = ()) -> Registry:
    """The packaged leaves, and the nodes and enums of the modules.

    Raises InputError if a module cannot be imported or has neither nodes nor enums, if a name is taken, or if a node
    cannot be used in a file."""
    registry = Registry()
    for name in dict.fromkeys(modules):
        module = user_module(name, OPTION)
        nodes, enums = nodes_of(module), [kind for kind in _public(module) if issubclass(kind, IntEnum)]
        if not nodes and not enums:
            raise InputError(f"{OPTION}: there is no node in module {name!r}; expected {EXPECTED}")
        for node in nodes:
            where = f"{OPTION}: {name}.{node.__name__}"
            if node.__name__ in registry or node.__name__ in RESERVED:
                raise InputError(f"{where}: this name is taken; expected another")
            if (mistake := _mistake(node)) is not None:
                raise InputError(f"{where}: {mistake}")
            registry[node.__name__] = node
        for member, number in ((key, int(value)) for kind in enums for key, value in kind.__members__.items()):
            if registry.enums.setdefault(member, number) != number:
                known = registry.enums[member]
                raise InputError(f"{OPTION}: {name}: got {member} = {number}, which is {known} elsewhere")
    return registry


def nodes_of(module: ModuleType) -> list[type[TreeNode]]:
    """Usable classes of nodes that a module defines: leaves with a step, control nodes and decorators with a run."""
    leaves = [kind for kind in _public(module) if issubclass(kind, Leaf) and kind.step is not Leaf.step]
    others = [kind for kind in _public(module) if issubclass(kind, Control | Decorator) and kind.run is not Node.run]
    return [*leaves, *others]


def _public(module: ModuleType) -> Iterator[type]:
    """Public classes that a module defines itself."""
    for kind in vars(module).values():
        if isinstance(kind, type) and kind.__module__ == module.__name__ and not kind.__name__.startswith("_"):
            yield kind


def _mistake(node: type[TreeNode]) -> str | None:
    """What no file could use: a category, a number of children, or a port."""
    if issubclass(node, Leaf) and node.category not in CATEGORIES:
        return f"category: got {shown(node.category)}, expected one of {', '.join(CATEGORIES)}"
    if issubclass(node, Node):
        least, most = node.least, node.most
        if type(least) is not int or least < 1 or not (most is None or (type(most) is int and most >= least)):
            return f"least, most: got {shown(least)}, {shown(most)}, expected numbers of children, 1 or more"
    if not isinstance(node.ports, Mapping):
        return f"ports: got {shown(node.ports)}, expected a dictionary of ports"
    for name, port in node.ports.items():
        if not isinstance(name, str) or not name.isidentifier() or name.startswith("_") or name in ("name", "ID"):
            return f"ports: got the name {shown(name)}, expected letters and digits, but not name or ID"
        if (mistake := _mistake_in(port)) is not None:
            return f"ports[{name!r}]: {mistake}"
    return None


def _mistake_in(port: Any) -> str | None:
    """Why a port could not check literals and entries, or would refuse its own default."""
    if not isinstance(port, Port):
        return f"got {shown(port)}, expected a Port"
    if port.type not in CONVERSIONS:
        return f"type: got {shown(port.type)}, expected one of {', '.join(kind.__name__ for kind in CONVERSIONS)}"
    if port.direction not in DIRECTIONS:
        return f"direction: got {shown(port.direction)}, expected one of {', '.join(DIRECTIONS)}"
    if port.choices is not None and port.choices not in OF_THE_MAP and not isinstance(port.choices, tuple | list):
        return f"choices: got {shown(port.choices)}, expected a tuple of values, or one of {', '.join(OF_THE_MAP)}"
    for bound in (port.least, port.most):
        number = isinstance(bound, int | float) and not isinstance(bound, bool) and bound == bound
        if bound is not None and not (number and port.type in (int, float)):
            return f"least, most: got {shown(bound)}, expected a number, and only for a port of numbers"
    if port.default is not REQUIRED and port.default is not None and not port.takes(port.default):
        return f"default: got {shown(port.default)}, expected {port.expects()}"
    return None


PACKAGED = (ball_leaves, follow_policy, opening_leaves, recovery, travel)
REGISTRY = {node.__name__: node for module in PACKAGED for node in nodes_of(module)}
