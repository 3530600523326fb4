"""Leaves that users bring in modules of their own: `--behavior-module MODULE`.

A leaf is a public class of the module that derives from `leaf.Leaf` and has a `step`; its name is that of the class.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from mazeplan.behavior.decorators import DECORATORS
from mazeplan.behavior.leaf import CONVERSIONS, OF_THE_MAP, Leaf, Port, shown
from mazeplan.behavior.nodes import CONTROLS
from mazeplan.behavior.registry import REGISTRY
from mazeplan.errors import InputError
from mazeplan.usermodule import user_module

OPTION = "--behavior-module"
CATEGORIES = ("Action", "Condition")
DIRECTIONS = ("in", "out", "inout")
MOST_WIND_DOWN = 90  # ticks; 3 s at 30 Hz: nobody waits longer for a run to end
# tags of the format itself
RESERVED = (*CATEGORIES, *CONTROLS, *DECORATORS, "SubTree", "Control", "Decorator", "BehaviorTree", "TreeNodesModel")


def registry_with(modules: Iterable[str] = ()) -> Mapping[str, type[Leaf]]:
    """The leaves that a tree may name: the packaged ones and those of the modules. Raises InputError if a module
    cannot be imported, has no leaf, or one whose name is taken or whose ports are not such."""
    registry: dict[str, type[Leaf]] = dict(REGISTRY)
    for module in dict.fromkeys(modules):
        found = _leaves(module)
        if not found:
            expected = "expected a class derived from mazeplan.MazeLeaf that has a step"
            raise InputError(f"{OPTION}: there is no leaf in module {module!r}; {expected}")
        for name, leaf in found.items():
            if name in registry or name in RESERVED:
                raise InputError(f"{OPTION}: {module}.{name}: this name is taken; expected another")
            _check(leaf, f"{OPTION}: {module}.{name}")
            registry[name] = leaf
    return registry


def _leaves(module: str) -> dict[str, type[Leaf]]:
    """Classes that the module defines, not those that it imports to derive from."""
    members = vars(user_module(module, OPTION)).values()
    return {
        kind.__name__: kind
        for kind in members
        if isinstance(kind, type)
        and issubclass(kind, Leaf)
        and kind.step is not Leaf.step
        and kind.__module__ == module
        and not kind.__name__.startswith("_")
    }


def _check(leaf: type[Leaf], where: str) -> None:
    """Raises InputError for ports or a category that nobody could use in a file, or a wind-down without a bound."""
    if leaf.category not in CATEGORIES:
        raise InputError(f"{where}: category: got {shown(leaf.category)}, expected one of {', '.join(CATEGORIES)}")
    ticks = leaf.wind_down_ticks
    if type(ticks) is not int or not 1 <= ticks <= MOST_WIND_DOWN:
        expected = f"expected a whole number from 1 to {MOST_WIND_DOWN}"
        raise InputError(f"{where}: wind_down_ticks: got {shown(ticks)}, {expected}")
    if not isinstance(leaf.ports, Mapping):
        raise InputError(f"{where}: ports: got {shown(leaf.ports)}, expected a dictionary of ports")
    for name, port in leaf.ports.items():
        here = f"{where}: ports"
        if not isinstance(name, str) or not name.isidentifier() or name.startswith("_") or name in ("name", "ID"):
            raise InputError(f"{here}: got the name {shown(name)}, expected letters and digits, but not name or ID")
        if not isinstance(port, Port):
            raise InputError(f"{here}[{name!r}]: got {shown(port)}, expected a Port")
        if port.type not in CONVERSIONS:
            known = ", ".join(kind.__name__ for kind in CONVERSIONS)
            raise InputError(f"{here}[{name!r}]: got the type {shown(port.type)}, expected one of {known}")
        if port.choices is not None and port.choices not in OF_THE_MAP and not isinstance(port.choices, tuple | list):
            expected = f"a tuple of values, or one of {', '.join(OF_THE_MAP)}"
            raise InputError(f"{here}[{name!r}]: choices: got {shown(port.choices)}, expected {expected}")
        if port.direction not in DIRECTIONS:
            raise InputError(f"{here}[{name!r}]: got {shown(port.direction)}, expected one of {', '.join(DIRECTIONS)}")
