"""Nodes from users' modules, `--behavior-module MODULE`.

A node is a public class of the module. A leaf derives from `leaf.Leaf` and has a `step`. A control node or decorator
derives from `controls.Control` or `decorators.Decorator` and has a `run`. The name of the node is that of the class.
Scripts know the members of a public `enum.IntEnum` by name.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from enum import IntEnum
from types import ModuleType
from typing import Any

from mazeplan.behavior.registry import REGISTRY
from mazeplan.btree.builder import BUILTIN, OPTION
from mazeplan.btree.controls import Control
from mazeplan.btree.decorators import Decorator
from mazeplan.btree.leaf import Leaf
from mazeplan.btree.node import Node, TreeNode
from mazeplan.btree.ports import CONVERSIONS, REQUIRED, Port, shown
from mazeplan.core.errors import InputError
from mazeplan.core.name_hints import one_of
from mazeplan.core.user_modules import user_module

OF_THE_MAP = ("openings", "rings")
CATEGORIES = ("Action", "Condition")
DIRECTIONS = ("in", "out", "inout")
EXPECTED = (
    "a class derived from mazeplan.MazeLeaf that has a step, or from mazeplan.Control or Decorator that has a run"
)
MOST_WIND_DOWN = 90  # maximum ticks of a wind-down; 3 s at 30 Hz: nobody waits longer for a run to end
# names of the format itself, which no node of a user may have
RESERVED = (*CATEGORIES, *BUILTIN, "SubTree", "Control", "Decorator", "BehaviorTree", "TreeNodesModel")


class Registry(dict[str, type[TreeNode]]):
    """Packaged leaves and users' nodes by name. enums: {name: number} for scripts"""

    def __init__(self, known: Mapping[str, type[TreeNode]], enums: Mapping[str, int]) -> None:
        super().__init__(known)
        self.enums = dict(enums)


def registry_with(modules: Iterable[str] = ()) -> Registry:
    """The nodes that a tree may name: packaged leaves, and nodes of the modules.

    Raises InputError if a module cannot be imported or has neither nodes nor enums, if a name is taken, or if a node
    cannot be used in a file."""
    registry, enums = dict[str, type[TreeNode]](REGISTRY), dict[str, int]()
    for module in dict.fromkeys(modules):
        found, numbers = _nodes(module), _enums(user_module(module, OPTION))
        if not found and not numbers:
            raise InputError(f"{OPTION}: there is no node in module {module!r}; expected {EXPECTED}")
        for name, node in found.items():
            if name in registry or name in RESERVED:
                raise InputError(f"{OPTION}: {module}.{name}: this name is taken; expected another")
            _check(node, f"{OPTION}: {module}.{name}")
            registry[name] = node
        for name, number in numbers:
            if enums.setdefault(name, number) != number:
                raise InputError(f"{OPTION}: {module}: got {name} = {number}, which is {enums[name]} elsewhere")
    return Registry(registry, enums)


def is_node(kind: Any) -> bool:
    """Whether an object is a usable class of nodes: a leaf with a step, or a control node or decorator with a run."""
    if not isinstance(kind, type):
        return False
    if issubclass(kind, Leaf):
        return kind.step is not Leaf.step
    return issubclass(kind, Control | Decorator) and kind.run is not Node.run


def _nodes(module: str) -> dict[str, type[TreeNode]]:
    """Classes of nodes that the module defines; leaves out the classes that it imports."""
    return {kind.__name__: kind for kind in _public(user_module(module, OPTION)) if is_node(kind)}


def _enums(module: ModuleType) -> list[tuple[str, int]]:
    """Names and numbers of the enums that the module defines."""
    enums = (kind for kind in _public(module) if issubclass(kind, IntEnum))
    return [(name, int(member)) for kind in enums for name, member in kind.__members__.items()]


def _public(module: ModuleType) -> Iterator[type]:
    """Public classes that a module defines itself."""
    for kind in vars(module).values():
        if isinstance(kind, type) and kind.__module__ == module.__name__ and not kind.__name__.startswith("_"):
            yield kind


def _check(node: type[TreeNode], where: str) -> None:
    """Raises InputError for ports, a category or a number of children that no file could use, and for a wind-down
    without a bound."""
    if issubclass(node, Leaf):
        _check_leaf(node, where)
    elif issubclass(node, Node):
        _check_children(node, where)
    if not isinstance(node.ports, Mapping):
        raise InputError(f"{where}: ports: got {shown(node.ports)}, expected a dictionary of ports")
    for name, port in node.ports.items():
        here = f"{where}: ports"
        if not isinstance(name, str) or not name.isidentifier() or name.startswith("_") or name in ("name", "ID"):
            raise InputError(f"{here}: got the name {shown(name)}, expected letters and digits, but not name or ID")
        if not isinstance(port, Port):
            raise InputError(f"{here}[{name!r}]: got {shown(port)}, expected a Port")
        _check_port(port, f"{here}[{name!r}]")


def _check_leaf(leaf: type[Leaf], where: str) -> None:
    if leaf.category not in CATEGORIES:
        raise InputError(f"{where}: category: got {shown(leaf.category)}, expected {one_of(CATEGORIES, leaf.category)}")
    ticks = leaf.wind_down_ticks
    if type(ticks) is not int or not 1 <= ticks <= MOST_WIND_DOWN:
        expected = f"expected a whole number from 1 to {MOST_WIND_DOWN}"
        raise InputError(f"{where}: wind_down_ticks: got {shown(ticks)}, {expected}")


def _check_children(node: type[Node], where: str) -> None:
    least, most = node.least, node.most
    if type(least) is not int or least < 1:
        raise InputError(f"{where}: least: got {shown(least)}, expected a number of children, 1 or more")
    if most is not None and (type(most) is not int or most < least):
        raise InputError(f"{where}: most: got {shown(most)}, expected a number of children, {least} or more, or None")


def _check_port(port: Port, where: str) -> None:
    """Raises InputError if a port cannot check literals and entries, or if it would refuse its own default."""
    if port.type not in CONVERSIONS:
        known = ", ".join(kind.__name__ for kind in CONVERSIONS)
        raise InputError(f"{where}: got the type {shown(port.type)}, expected one of {known}")
    if port.choices is not None and port.choices not in OF_THE_MAP and not isinstance(port.choices, tuple | list):
        expected = f"a tuple of values, or one of {', '.join(OF_THE_MAP)}"
        raise InputError(f"{where}: choices: got {shown(port.choices)}, expected {expected}")
    if port.direction not in DIRECTIONS:
        raise InputError(f"{where}: got {shown(port.direction)}, expected {one_of(DIRECTIONS, port.direction)}")
    for name in ("least", "most"):
        bound = getattr(port, name)
        if bound is not None and port.type not in (int, float):
            raise InputError(
                f"{where}: {name}: got {shown(bound)}, expected none for a port of type {port.type.__name__}"
            )
        if bound is not None and (isinstance(bound, bool) or not isinstance(bound, int | float) or bound != bound):
            raise InputError(f"{where}: {name}: got {shown(bound)}, expected a number")
    if port.default is not REQUIRED and port.default is not None and not port.takes(port.default):
        raise InputError(f"{where}: default: got {shown(port.default)}, expected {port.expected}")
