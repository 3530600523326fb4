"""What installed packages add, and whether it can be used: each is imported and looked at, which only `doctor` does."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from mazeplan.errors import InputError
from mazeplan.plugins import EFFECTS, GROUPS, LEAVES, RIGS, Plugin, plugins, unknown_groups


@dataclass(frozen=True)
class Added:
    """One entry point: what kind of thing, names that it adds, whose it is, and what is wrong with it, if anything."""

    kind: str
    name: str
    adds: tuple[str, ...]
    package: str
    version: str
    object: str
    problem: str | None


def added() -> list[Added]:
    """All entry points of installed packages for this program."""
    kinds = {RIGS: ("rig", _rig), EFFECTS: ("effect", _effects), LEAVES: ("leaf", _leaf)}
    return [_looked_at(found, *kinds[group]) for group in kinds for found in plugins(group)]


def _looked_at(found: Plugin, kind: str, adds: Callable[[Plugin], tuple[str, ...]]) -> Added:
    names, problem = (), None
    try:
        same = [one for one in plugins(found.group) if one.name == found.name]
        if len(same) > 1 and kind != "effect":
            raise InputError(f"{len(same)} packages have this name; uninstall all but one")
        names = adds(found)
    except InputError as error:
        problem = error.problem.removeprefix(f"{found.label}: ")
    return Added(kind, found.name, names, found.package, found.version, found.value, problem)


def _rig(found: Plugin) -> tuple[str, ...]:
    from mazeplan.rigs.registry import installed_rig, unusable

    _raise(unusable(found))
    installed_rig(found)
    return (found.name,)


def _leaf(found: Plugin) -> tuple[str, ...]:
    from mazeplan.behavior.ownleaves import installed_leaf, not_a_name

    _raise(not_a_name(found))
    installed_leaf(found)
    return (found.name,)


def _effects(found: Plugin) -> tuple[str, ...]:
    from mazeplan.cli.owneffects import installed_effects

    installed = installed_effects()
    if found.name in installed.problems:
        raise installed.problems[found.name]
    return tuple(name for name, of in installed.owners.items() if of == found)


def _raise(problem: str | None) -> None:
    if problem is not None:
        raise InputError(problem)


def plugin_lines(found: list[Added]) -> list[str]:
    """The same for people."""
    broken = sum(one.problem is not None for one in found)
    state = "none" if not found else f"{len(found) - broken} ready" + (f", {broken} broken" if broken else "")
    told = [f"plug-ins  {state}: rigs, effects and leaves of installed packages"]
    for one in found:
        what = f"broken: {one.problem}" if one.problem else "ready" + _other_names(one)
        told.append(f"    {one.kind} {one.name} of {one.package} {one.version} ({one.object}) {what}")
    for group, package in unknown_groups().items():
        expected = f"expected one of {', '.join(GROUPS)}"
        told.append(f"    package {package}: unknown group of entry points {group}, {expected}")
    return told


def _other_names(one: Added) -> str:
    return "" if one.adds == (one.name,) else f": {', '.join(one.adds) or 'nothing'}"
