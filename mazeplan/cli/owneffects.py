"""Effects that users bring: `--effects MODULE:NAME`, and entry points `mazeplan.effects` of installed packages."""

from __future__ import annotations

from collections.abc import Container, Iterable
from dataclasses import dataclass
from typing import Any

from mazeplan.errors import InputError
from mazeplan.physics.effect import Effect
from mazeplan.physics.registry import offered, own_effects, problem_of, register
from mazeplan.plugins import EFFECTS, Plugin, plugins
from mazeplan.usermodule import reason


@dataclass(frozen=True)
class Installed:
    """What packages offer: effects, whose each is, and what is wrong with those that cannot be used."""

    effects: tuple[Effect, ...]
    owners: dict[str, Plugin]
    problems: dict[str, InputError]

    def check_declared(self, texts: Iterable[str], known: Container[str]) -> None:
        """Raises InputError where `--declare` names the effect of an entry point that is broken."""
        for text in texts:
            name = text.partition("=")[0].partition(".")[0]
            if name in self.problems and name not in known:
                raise self.problems[name]


def installed_effects(taken: Iterable[str] = ()) -> Installed:
    """The effects of installed packages, registered. taken: names that are used already."""
    names, owners = set(taken), dict[str, Plugin]()
    effects: list[Effect] = []
    problems: dict[str, InputError] = {}
    for plugin in plugins(EFFECTS):
        try:
            found: list[Any] = offered(plugin.load())
        except InputError as problem:
            told = plugin.problem(problem.problem) if plugin.label not in problem.problem else problem
            problems[plugin.name] = told
            continue
        except Exception as problem:  # whatever anybody's code does
            problems[plugin.name] = plugin.problem(f"gives no effects: {reason(problem)}")
            continue
        for effect in found:
            name = getattr(effect, "name", "")
            if name in owners:
                what = f"got the name {name!r}, which {owners[name].label} has, too; expected another"
            elif name in names:
                what = f"got the name {name!r}, which another module has, too; expected another"
            else:
                what = problem_of(effect)
            if what is not None:
                problems[plugin.name] = plugin.problem(what)
                break
            owners[name] = plugin
            effects.append(effect)
    register(effects)
    return Installed(tuple(effects), owners, problems)


__all__ = ["Installed", "installed_effects", "own_effects"]
