"""Plug-ins of installed packages: registers their effects, and checks each entry point for `doctor`."""

from __future__ import annotations

from collections.abc import Callable, Container, Iterable
from dataclasses import dataclass
from typing import Any

from mazeplan.apps.cli.output import say
from mazeplan.core.errors import InputError
from mazeplan.core.plugins import EFFECTS, GROUPS, LEAVES, RIGS, Plugin, plugins, unknown_groups
from mazeplan.core.user_modules import reason
from mazeplan.physics.effect import Effect
from mazeplan.physics.registry import offered, own_effects, problem_of, register


@dataclass(frozen=True)
class AddedEffects:
    """Effects that do not come with mazeplan.

    effects: of `--effects` and of installed packages
    owners: {name of an effect: the package that has it}
    problems: {name of a broken entry point: its error}"""

    effects: tuple[Effect, ...]
    owners: dict[str, Plugin]
    problems: dict[str, InputError]

    def check_declared(self, texts: Iterable[str], known: Container[str]) -> None:
        """Raises InputError if `--declare` names an effect of a broken entry point."""
        for text in texts:
            name = text.partition("=")[0].partition(".")[0]
            if name in self.problems and name not in known:
                raise self.problems[name]


def added_effects(spec: str | None = None, *, report: bool = False) -> AddedEffects:
    """Register the effects of `--effects` (spec) and of installed packages. report: whether to print broken ones"""
    own = own_effects(spec)
    installed = _installed_effects({effect.name for effect in own})
    if report:
        for problem in installed.problems.values():
            say(f"mazeplan: effect ignored: {problem}")
    return AddedEffects((*own, *installed.effects), installed.owners, installed.problems)


def _installed_effects(taken: set[str]) -> AddedEffects:
    """Register the effects of installed packages. taken: names that other effects have already"""
    effects: list[Effect] = []
    owners: dict[str, Plugin] = {}
    problems: dict[str, InputError] = {}
    for plugin in plugins(EFFECTS):
        try:
            found: list[Any] = offered(plugin.load())
        except InputError as problem:
            named = plugin.label in problem.problem
            problems[plugin.name] = problem if named else plugin.problem(problem.problem)
            continue
        except Exception as problem:  # a user's code may raise anything
            problems[plugin.name] = plugin.problem(f"gives no effects: {reason(problem)}")
            continue
        for effect in found:
            name = getattr(effect, "name", "")
            if name in owners or name in taken:
                other = owners[name].label if name in owners else "another module"
                what = f"got the name {name!r}, which {other} has, too; expected another"
            else:
                what = problem_of(effect)
            if what is not None:
                problems[plugin.name] = plugin.problem(what)
                break
            owners[name] = plugin
            effects.append(effect)
    register(effects)
    return AddedEffects(tuple(effects), owners, problems)


@dataclass(frozen=True)
class EntryPoint:
    """One entry point of an installed package.

    kind: rig, effect or leaf
    adds: names that it adds
    object: MODULE:NAME
    problem: why it is broken; None if it is not"""

    kind: str
    name: str
    adds: tuple[str, ...]
    package: str
    version: str
    object: str
    problem: str | None


def entry_points() -> list[EntryPoint]:
    """All entry points of installed packages for mazeplan, each imported and checked."""
    kinds = {RIGS: ("rig", _rig), EFFECTS: ("effect", _effects), LEAVES: ("leaf", _leaf)}
    return [_check(found, *kinds[group]) for group in kinds for found in plugins(group)]


def _check(found: Plugin, kind: str, names_of: Callable[[Plugin], tuple[str, ...]]) -> EntryPoint:
    names, problem = (), None
    try:
        same = [other for other in plugins(found.group) if other.name == found.name]
        if len(same) > 1 and kind != "effect":
            raise InputError(f"{len(same)} packages have this name; uninstall all but one")
        names = names_of(found)
    except InputError as error:
        problem = error.problem.removeprefix(f"{found.label}: ")
    return EntryPoint(kind, found.name, names, found.package, found.version, found.value, problem)


def _rig(found: Plugin) -> tuple[str, ...]:
    from mazeplan.rigs.registry import installed_rig, unusable

    return _usable(found, unusable(found), installed_rig)


def _leaf(found: Plugin) -> tuple[str, ...]:
    from mazeplan.behavior.own_nodes import installed_leaf, not_a_name

    return _usable(found, not_a_name(found), installed_leaf)


def _usable(found: Plugin, problem: str | None, load: Callable[[Plugin], Any]) -> tuple[str, ...]:
    if problem is not None:
        raise InputError(problem)
    load(found)
    return (found.name,)


def _effects(found: Plugin) -> tuple[str, ...]:
    installed = _installed_effects(set())
    if found.name in installed.problems:
        raise installed.problems[found.name]
    return tuple(name for name, owner in installed.owners.items() if owner == found)


def plugin_lines(found: list[EntryPoint]) -> list[str]:
    """The state of the entry points, one line each."""
    broken = sum(point.problem is not None for point in found)
    state = f"{len(found) - broken} ready" + (f", {broken} broken" if broken else "") if found else "none"
    lines = [f"plug-ins  {state}: rigs, effects and leaves of installed packages"]
    for point in found:
        others = "" if point.adds == (point.name,) else f": {', '.join(point.adds) or 'nothing'}"
        what = f"broken: {point.problem}" if point.problem else f"ready{others}"
        lines.append(f"    {point.kind} {point.name} of {point.package} {point.version} ({point.object}) {what}")
    for group, package in unknown_groups().items():
        expected = f"expected one of {', '.join(GROUPS)}"
        lines.append(f"    package {package}: unknown group of entry points {group}, {expected}")
    return lines
