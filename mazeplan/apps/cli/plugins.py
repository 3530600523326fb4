"""Plug-ins of installed packages: registers their effects."""

from __future__ import annotations

from collections.abc import Container, Iterable
from dataclasses import dataclass
from typing import Any

from mazeplan.apps.cli.output import say
from mazeplan.core.errors import InputError
from mazeplan.core.plugins import EFFECTS, Plugin, plugins
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
