"""Effects that users bring: `--effects MODULE:NAME`, and entry points `mazeplan.effects` of installed packages."""

from __future__ import annotations

import math
from collections.abc import Callable, Container, Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np

from mazeplan.diagnosis.library import TERM, Candidate, Spec
from mazeplan.errors import InputError
from mazeplan.plugins import EFFECTS, Plugin, plugins
from mazeplan.usermodule import reason, user_module

TRIED = ((0.3, 0.7, 1.0), (-2.5, -3.0, 20.0), (1.4, 0.0, 0.0))  # x, v, t at which terms are tried
TILT = (0.02, 0.1, -1.0, -0.03, -0.2, 2.0)  # w there: beta and its rates, gamma and its


def own_effects(spec: str | None, taken: Container[str]) -> list[Candidate]:
    """The candidates that a function of a module returns; of the working folder, too. taken: names that the library
    has. Raises InputError for anything else."""
    if spec is None:
        return []
    module, _, name = spec.partition(":")
    if not module or not name:
        raise InputError(f"--effects: got {spec!r}, expected MODULE:FUNCTION")
    code = user_module(module, "--effects")
    try:
        offered = _offered(getattr(code, name))
    except InputError as problem:
        raise InputError(f"--effects: {spec!r} {problem.problem}") from None
    except Exception as problem:  # whatever anybody's code does
        raise InputError(f"--effects: {spec!r} gives no effects: {reason(problem)}") from None
    names, found = set[str](), []
    for c in offered:
        problem = _problem(c, taken) or (f"got the name {c.name!r} twice" if c.name in names else _trial(c))
        if problem is not None:
            raise InputError(f"--effects: {problem}")
        names.add(c.name)
        found.append(c)
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
    if not c.parameters:
        return f"got no parameters of {c.name}, expected one at the least"
    for name, spec in c.parameters.items():
        if not (spec.low <= spec.default <= spec.high and spec.low < spec.high and spec.step > 0.0):
            return f"{c.name}.{name}: got {spec.low:g} to {spec.high:g}, default {spec.default:g}, step {spec.step:g}"
    return None


def _trial(c: Candidate) -> str | None:
    """What goes wrong with its term where balls are, before it is compiled and has neither bounds nor words."""
    specs, term = list(c.parameters.values()), getattr(c.term, "py_func", c.term)
    for x, v, t in TRIED:
        for p in ([s.default for s in specs], [s.default + s.step for s in specs]):
            try:
                with np.errstate(all="ignore"):
                    value = term(x, v, t, np.array(TILT), np.array(p, dtype=float))  # pyright: ignore[reportOptionalCall]
                finite = math.isfinite(value)
            except Exception as problem:  # whatever anybody's code does
                value, finite = reason(problem), False
            if not finite:
                return f"the term of {c.name} gives {value} at x {x}, v {v}, t {t}, p {p}; expected a finite number"
    try:
        _compile(c.term)
    except Exception as problem:  # numba's are many kinds, with many lines
        lines = [line.strip() for line in str(problem).splitlines() if line.strip()]
        return f"the term of {c.name} cannot be compiled: {type(problem).__name__}: {' '.join(lines[:2])[:200]}"
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
            offered = _offered(plugin.load())
        except InputError as problem:
            told = plugin.problem(problem.problem) if plugin.label not in problem.problem else problem
            problems[plugin.name] = told
            continue
        except Exception as problem:  # whatever anybody's code does
            problems[plugin.name] = plugin.problem(f"gives no effects: {reason(problem)}")
            continue
        for c in offered:
            name = getattr(c, "name", "")
            if name in owners:
                what = f"got the name {name!r}, which {owners[name].label} has, too; expected another"
            else:
                what = _problem(c, names) or _trial(c)
            if what is not None:
                problems[plugin.name] = plugin.problem(what)
                break
            names.add(c.name)
            owners[c.name] = plugin
            candidates.append(c)
    return Installed(tuple(candidates), owners, problems)


def _offered(found: Any) -> list[Any]:
    """One Candidate, several, or a function that returns them."""
    found = found if isinstance(found, Candidate) or not callable(found) else found()
    if isinstance(found, Candidate):
        return [found]
    if not isinstance(found, Iterable):
        raise InputError(f"gives no effects: got {found!r}, expected a Candidate, several, or a function")
    return list(found)


def _compile(term: Callable[..., float] | None) -> None:
    from mazeplan.diagnosis.kalman import TERM as SIGNATURE
    from mazeplan.maths.compiled import address_of

    if term is not None:
        address_of(term, SIGNATURE)
