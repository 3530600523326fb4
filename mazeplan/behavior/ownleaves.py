"""Leaves that users bring in modules of their own, `--behavior-module MODULE`, and those of installed packages.

A leaf is a public class of the module that derives from `leaf.Leaf` and has a `step`; its name is that of the class.
An installed package offers one by an entry point `mazeplan.leaves` of its name; it is imported when a tree names it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping

from mazeplan.behavior.builder import BUILTIN
from mazeplan.behavior.leaf import Leaf
from mazeplan.behavior.ports import CONVERSIONS, OF_THE_MAP, REQUIRED, Port, shown
from mazeplan.behavior.registry import REGISTRY
from mazeplan.core.errors import InputError
from mazeplan.core.plugins import LEAVES, Plugin, plugin, plugins
from mazeplan.core.user_modules import user_module

OPTION = "--behavior-module"
CATEGORIES = ("Action", "Condition")
DIRECTIONS = ("in", "out", "inout")
MOST_WIND_DOWN = 90  # ticks; 3 s at 30 Hz: nobody waits longer for a run to end
# tags of the format itself
RESERVED = (*CATEGORIES, *BUILTIN, "SubTree", "Control", "Decorator", "BehaviorTree", "TreeNodesModel")


class Registry(Mapping[str, type[Leaf]]):
    """Leaves by name; those of installed packages are imported when they are asked for, which raises InputError where
    one is broken. owners: whose those are that were asked for."""

    def __init__(self, known: Mapping[str, type[Leaf]]) -> None:
        self._known, self.owners = dict(known), dict[str, Plugin]()

    def __getitem__(self, name: str) -> type[Leaf]:
        if name not in self._known:
            found = plugin(LEAVES, name)
            if found is None or not_a_name(found):
                raise KeyError(name)
            self._known[name], self.owners[name] = installed_leaf(found), found
        return self._known[name]

    def __contains__(self, name: object) -> bool:
        return name in self._known or name in self.installed

    def __iter__(self) -> Iterator[str]:
        yield from self._known
        yield from (name for name in self.installed if name not in self._known)

    def __len__(self) -> int:
        return len(list(iter(self)))

    @property
    def installed(self) -> dict[str, Plugin]:
        """Entry points by the names of leaves that they offer; nothing of them is imported."""
        return {found.name: found for found in plugins(LEAVES) if not_a_name(found) is None}

    def usable(self, tell: Callable[[str], object]) -> dict[str, type[Leaf]]:
        """All of them; of an installed one that is broken `tell` is told."""
        out = {}
        for name in self:
            try:
                out[name] = self[name]
            except InputError as problem:
                tell(str(problem))
        return out


def not_a_name(found: Plugin) -> str | None:
    """Why no tree could name this leaf of a package; None: it can be."""
    if found.name in REGISTRY or found.name in RESERVED:
        return "the program has a node of this name, which comes first"
    return None if found.name.isidentifier() and not found.name.startswith("_") else "expected the name of a class"


def installed_leaf(found: Plugin) -> type[Leaf]:
    """The leaf that a package offers. Raises InputError where it is none."""
    leaf = found.load()
    if not (isinstance(leaf, type) and issubclass(leaf, Leaf) and leaf.step is not Leaf.step):
        raise found.problem(f"got {shown(leaf)}, expected a class derived from mazeplan.MazeLeaf that has a step")
    if leaf.__name__ != found.name:
        raise found.problem(f"got the class {leaf.__name__}, expected one whose name is that of the entry point")
    _check(leaf, found.label)
    return leaf


def installed_in(names: Iterable[str], modules: Iterable[str] = ()) -> tuple[Plugin, ...]:
    """Those of installed packages among the names of a tree's nodes. Raises InputError as `registry_with` does."""
    beyond = [name for name in sorted(set(names)) if name not in REGISTRY and name not in RESERVED]
    if not beyond:
        return ()
    own = {name for module in modules for name in _leaves(module)}
    found = (plugin(LEAVES, name) for name in beyond if name not in own)
    return tuple(one for one in found if one is not None)


def registry_with(modules: Iterable[str] = ()) -> Registry:
    """The leaves that a tree may name: the packaged ones, those of the modules, and of installed packages. Raises
    InputError if a module cannot be imported, has no leaf, or one whose name is taken or whose ports are not such."""
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
    return Registry(registry)


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
        _check_port(port, f"{here}[{name!r}]")


def _check_port(port: Port, where: str) -> None:
    """Raises InputError for what no literal or entry could be checked against, or a default that would be refused."""
    if port.type not in CONVERSIONS:
        known = ", ".join(kind.__name__ for kind in CONVERSIONS)
        raise InputError(f"{where}: got the type {shown(port.type)}, expected one of {known}")
    if port.choices is not None and port.choices not in OF_THE_MAP and not isinstance(port.choices, tuple | list):
        expected = f"a tuple of values, or one of {', '.join(OF_THE_MAP)}"
        raise InputError(f"{where}: choices: got {shown(port.choices)}, expected {expected}")
    if port.direction not in DIRECTIONS:
        raise InputError(f"{where}: got {shown(port.direction)}, expected one of {', '.join(DIRECTIONS)}")
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
