"""Effects that users bring: `--effects MODULE:NAME`, and entry points `mazeplan.effects` of installed packages."""

from __future__ import annotations

from collections.abc import Callable, Container, Iterable
from dataclasses import dataclass
from typing import Any

from mazeplan.diagnosis.library import TERM, Candidate, Spec
from mazeplan.errors import InputError
from mazeplan.plugins import EFFECTS, Plugin, plugins
from mazeplan.usermodule import user_module


def own_effects(spec: str | None, taken: Container[str]) -> list[Candidate]:
    """The candidates that a function of a module returns; of the working folder, too. taken: names that the library
    has. Raises InputError for anything else."""
    if spec is None:
        return []
    module, _, name = spec.partition(":")
    if not module or not name:
        raise InputError(f"--effects: got {spec!r}, expected MODULE:FUNCTION")
    try:
        found = list(getattr(user_module(module, "--effects"), name)())
    except (AttributeError, TypeError) as problem:
        raise InputError(f"--effects: {spec!r} gives no effects: {problem}") from None
    for c in found:
        problem = _problem(c, taken)
        if problem is not None:
            raise InputError(f"--effects: {problem}")
    return found


def _problem(c: Any, taken: Container[str]) -> str | None:
    """Why it is no effect that could be looked for."""
    if not isinstance(c, Candidate) or c.acts != TERM or not hasattr(c.term, "get_compile_result"):
        what = c.name if isinstance(c, Candidate) else repr(c)
        return f"got {what}, expected a Candidate with a term compiled by numba.njit"
    if c.name in taken:
        return f"got the name {c.name!r}, which the library has; expected another"
    if not (isinstance(c.parameters, dict) and all(isinstance(spec, Spec) for spec in c.parameters.values())):
        return f"got parameters {c.parameters!r} of {c.name}, expected a dictionary of Spec"
    return None


@dataclass(frozen=True)
class Installed:
    """What packages offer: candidates, whose each is, and what is wrong with those that cannot be used."""

    candidates: tuple[Candidate, ...]
    owners: dict[str, Plugin]
    problems: dict[str, InputError]

    def check_declared(self, texts: Iterable[str], known: Container[str]) -> None:
        """Raises InputError where `--declare` names the effect of an entry point that is broken."""
        for text in texts:
            name = text.partition("=")[0].partition(".")[0]
            if name in self.problems and name not in known:
                raise self.problems[name]


def installed_effects(taken: Iterable[str]) -> Installed:
    """The effects of installed packages. taken: names that the library has."""
    names, owners = set(taken), {}
    candidates: list[Candidate] = []
    problems: dict[str, InputError] = {}
    for plugin in plugins(EFFECTS):
        try:
            offered = _offered(plugin)
        except InputError as problem:
            problems[plugin.name] = problem
            continue
        for c in offered:
            what = _problem(c, names)
            if what is not None:
                problems[plugin.name] = plugin.problem(what)
                break
            names.add(c.name)
            owners[c.name] = plugin
            candidates.append(c)
    return Installed(tuple(candidates), owners, problems)


def _offered(plugin: Plugin) -> list[Any]:
    """One Candidate, several, or a function that returns them; compiled, so that what cannot be is known now."""
    found: Any = plugin.load()
    try:
        found = found if isinstance(found, Candidate) or not callable(found) else found()
        offered: list[Any] = [found] if isinstance(found, Candidate) else list(found)  # pyright: ignore
        for c in offered:
            _compile(getattr(c, "term", None))
    except Exception as problem:  # whatever anybody's code does
        raise plugin.problem(f"gives no effects: {type(problem).__name__}: {' '.join(str(problem).split())}") from None
    return offered


def _compile(term: Callable[..., float] | None) -> None:
    from mazeplan.diagnosis.kalman import TERM as SIGNATURE
    from mazeplan.maths.compiled import address_of

    if term is not None:
        address_of(term, SIGNATURE)
