"""Compiled code of effects: generated once, kept on disk, found again without looking at a formula.

A set of effects becomes a small module of Numba functions, written into a folder for such files. Its name holds a hash
of what it was made from, so that no changed formula ever meets old code. Whoever calls it does so through addresses
(`maths.compiled`): a planner or a filter is compiled once for every set of effects, a user's own included.
"""

from __future__ import annotations

import hashlib
import importlib.util
import os
import re
import sys
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from types import ModuleType
from typing import Any

import numba

from mazeplan.maths.compiled import POINTER, REAL, address_of, caller
from mazeplan.physics.effect import DRAG, DRY, FORCE, OPENING, WALL, Effect
from mazeplan.physics.functions import vectorised
from mazeplan.physics.symbols import INPUTS

VOID = numba.types.void
SIGNATURES = {
    "plate": VOID(REAL, POINTER, POINTER, POINTER),  # t, w, p, c
    "value": REAL(REAL, REAL, REAL, REAL, POINTER, POINTER),  # theta, theta_dot, sin, cos, c, p
    "partials": VOID(REAL, REAL, REAL, REAL, POINTER, POINTER, POINTER),  # the same, out
    "plane": VOID(
        REAL, REAL, REAL, REAL, REAL, POINTER, POINTER, POINTER
    ),  # angle, rate, speed, direction, t, w, p, out
    "term": REAL(REAL, REAL, REAL, POINTER, POINTER),  # theta, theta_dot, t, w, p
}
SIGNATURES["plate_partials"] = SIGNATURES["plate"]
SIGNATURES["loss"] = SIGNATURES["angle"] = SIGNATURES["hold"] = SIGNATURES["base"] = SIGNATURES["term"]
call_plate, call_value, call_partials, call_plane, call_term = (
    caller(SIGNATURES[name]) for name in ("plate", "value", "partials", "plane", "term")
)
HEAD = '''"""Generated from formulas by mazeplan.physics; not to be edited."""

from math import cos, exp, sin, sqrt

from numba import njit

from mazeplan.physics.functions import between, clip, cosine, rest, sign, sine, size, tanh, wrap
'''
MARK = '@njit(cache=True, error_model="numpy", no_cpython_wrapper=True)'
HERE = Path(__file__).parent


@dataclass(frozen=True)
class Functions:
    """Compiled functions of a set of effects. address: by name; counts: what the module counts (coefficients);
    plain: source for arrays and tensors; module: keeps the code alive."""

    address: dict[str, int]
    counts: dict[str, int]
    plain: str
    module: ModuleType
    kept: dict[str, dict[str, Any]] = field(default_factory=dict)

    def vectorised(self, library: ModuleType) -> dict[str, Callable[..., Any]]:
        """The functions for arrays of NumPy or tensors of torch."""
        if library.__name__ not in self.kept:
            space: dict[str, Any] = vectorised(library)
            exec(self.plain, space)  # our own text, made from formulas
            self.kept[library.__name__] = space
        return self.kept[library.__name__]


def ring_functions(effects: Sequence[Effect]) -> Functions:
    """plate, value, plate_partials, partials and plane of a set of effects on the ball in a ring."""
    return _functions("ring", tuple(e for e in effects if e.acts != OPENING))


def plane_functions(effects: Sequence[Effect]) -> Functions:
    """plane alone, which is made in a fifth of the time."""
    return _functions("plane", tuple(effects))


def term_functions(effect: Effect, inputs: tuple[str, ...] = INPUTS) -> Functions:
    """Of one effect: term (rad/s^2), hold (its size against the motion) or angle and loss, by where it acts; inputs:
    names of what its formula finds in w. Raises ValueError for a formula with other symbols."""
    return _functions("term", (effect,), inputs)


def base_functions(effects: Sequence[Effect]) -> Functions:
    """Of effects of gravity: plate, and base, a term that reads the plate's coefficients behind the inputs."""
    return _functions("base", tuple(effects))


def routines_of(
    kind: str, effects: Sequence[Effect], inputs: tuple[str, ...] = INPUTS
) -> tuple[list[Any], dict[str, int]]:
    """Sources of one of the kinds above."""
    from mazeplan.physics import equation, generate

    if kind == "ring":
        routines, counts = generate.ring_routines(effects)
        plane = generate.plane_routine(effects)
        looks = any(re.search(r"theta|direction", text) for text in (*plane.lines, *plane.outputs))
        return [*routines, plane], {**counts, "angled": int(looks)}
    if kind == "plane":
        return [generate.plane_routine(effects)], {}
    if kind == "base":
        return generate.base_routines(effects)
    (effect,) = effects
    if effect.acts == OPENING:
        angle, loss = equation.passing(effect)
        expressions = {"angle": generate.signed(angle), "loss": generate.signed(loss)}
    elif effect.acts in (DRY, WALL):
        expressions = {"hold": generate.signed(equation.summed([effect], effect.acts))}
    else:
        expressions = {"term": equation.pushes([effect], (FORCE, DRAG), exact=True)}
    return [generate.term_routine(name, e, [effect], inputs) for name, e in expressions.items()], {}


_made: dict[tuple[str, ...], Functions] = {}


def _functions(kind: str, effects: tuple[Effect, ...], inputs: tuple[str, ...] = INPUTS) -> Functions:
    key = (kind, "" if inputs == INPUTS else ",".join(inputs), *(_identity(e) for e in effects))
    if key not in _made:
        module = _load(kind, key, effects, inputs)
        counts = dict(module.COUNTS)
        names = [name for name in SIGNATURES if hasattr(module, name)]
        addresses = {name: address_of(getattr(module, name), SIGNATURES[name]) for name in names}
        _made[key] = Functions(addresses, counts, module.PLAIN, module)
    return _made[key]


def _identity(effect: Effect) -> str:
    """What tells an effect's formula from others. Of one of the package, its name and parameters do; of a user's own
    its text does: whatever that depends on, is in it."""
    names = ",".join(effect.parameters)
    if getattr(effect.formula, "__module__", "").startswith("mazeplan.physics"):
        return f"{effect.name}:{effect.acts}:{names}"
    from mazeplan.physics import equation

    return f"{effect.name}:{effect.acts}:{names}:{id(effect.formula)}:{equation.text(effect)}"


@cache
def _version() -> str:
    """Hash of the sources that generated code comes from."""
    from mazeplan.maths import exponential, trigonometry

    digest = hashlib.sha256(f"{numba.__version__} {sys.version_info[:2]}".encode())
    for path in [*sorted(HERE.glob("*.py")), Path(str(exponential.__file__)), Path(str(trigonometry.__file__))]:
        digest.update(path.read_bytes())
    return digest.hexdigest()


def _load(kind: str, key: tuple[str, ...], effects: tuple[Effect, ...], inputs: tuple[str, ...]) -> ModuleType:
    """The module of a set of effects; written first where it is not there."""
    own = (part.split(f":{id(e.formula)}:", 1)[-1] for part, e in zip(key[2:], effects, strict=True))
    key = (key[1], *own)
    name = f"{kind}_{hashlib.sha256(repr((_version(), kind, key)).encode()).hexdigest()[:24]}"
    path = folder() / f"{name}.py"
    if not path.exists():
        routines, counts = routines_of(kind, effects, inputs)
        plain = "\n\n\n".join(r.plain() for r in routines)
        functions = "\n".join(f"\n\n{MARK}\n{r.text()}" for r in routines)
        _write(path, f"{HEAD}{functions}\n\n\nCOUNTS = {counts!r}\nPLAIN = '''\n{plain}\n'''\n")
    full = f"mazeplan_generated_{name}"
    spec = importlib.util.spec_from_file_location(full, path)
    if spec is None or spec.loader is None:
        raise ImportError(f"{path} cannot be loaded")
    module = importlib.util.module_from_spec(spec)
    sys.modules[full] = module
    spec.loader.exec_module(module)
    return module


@cache
def folder() -> Path:
    """Where generated code is kept: where Numba keeps its own, else beside this file, else in the user's cache, else
    for this process alone."""
    given = os.environ.get("NUMBA_CACHE_DIR")
    beside, home = HERE / "__pycache__", Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    for place in ([Path(given)] if given else []) + [beside, home / "mazeplan"]:
        try:
            (place / "generated").mkdir(parents=True, exist_ok=True)
        except OSError:
            continue
        if os.access(place / "generated", os.W_OK):
            return place / "generated"
    return Path(tempfile.mkdtemp(prefix="mazeplan-generated-"))


def _write(path: Path, text: str) -> None:
    """Write a file whole or not at all: other processes may want it, too."""
    with tempfile.NamedTemporaryFile("w", dir=path.parent, suffix=".new", delete=False, encoding="utf-8") as file:
        file.write(text)
    os.replace(file.name, path)
