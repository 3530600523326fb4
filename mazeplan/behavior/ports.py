"""Ports: the typed inputs and outputs of a node, given in a tree as a literal or as a {key} of the blackboard."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from numbers import Integral, Real
from typing import Any


class _Required:
    def __repr__(self) -> str:
        return "REQUIRED"


REQUIRED = _Required()


def _boolean(text: str) -> bool:
    if text.lower() in ("true", "1"):
        return True
    if text.lower() in ("false", "0"):
        return False
    raise ValueError(text)


def _words(text: str) -> list[str]:
    return [word.strip() for word in text.split(";") if word.strip()]


def _number(kind: type) -> Any:
    def convert(text: str) -> Any:
        if "_" in text:  # Python's own notation, which no other reader of the format knows
            raise ValueError(text)
        try:
            return kind(text)
        except ValueError:  # 3.0 is a whole number, too
            number = float(text)
            if not number.is_integer():
                raise
            return kind(number)

    return convert


CONVERSIONS: dict[type, Any] = {int: _number(int), float: _number(float), str: str, bool: _boolean, list: _words}
WORDS: dict[type, str] = {
    int: "a whole number", float: "a finite number", bool: "true or false", list: "words separated by ;", str: "text",
}  # fmt: skip
PLAIN = (str, Real, list, tuple, type, type(None), _Required)
INSTANCES: dict[type, Any] = {int: Integral, float: Real, bool: bool, list: list | tuple}  # str: any object at all


NUMBER = re.compile(r"-?[0-9]+(?:\.[0-9]*)?(?:[eE][+-]?[0-9]+)?")
OF_THE_MAP = ("openings", "rings")


@dataclass(frozen=True)
class Port:
    """A typed input or output of a node. direction: in, out, or inout; an output takes a {key} only. least, most: the
    smallest and the largest number allowed; no number may be infinite. choices: the values allowed, of a list those of
    its words, of which it needs one at least; "openings" or "rings": those of the run's map. A port of type str without
    choices also carries objects, such as a plan, by {key}."""

    type: type
    default: Any = REQUIRED
    doc: str = ""
    direction: str = "in"
    least: float | None = None
    most: float | None = None
    choices: tuple[Any, ...] | str | None = None

    @property
    def expected(self) -> str:
        """What is allowed on any map, for an error."""
        return self.expects()

    def expects(self, context: Any = None) -> str:
        """What is allowed in a run with this context, for an error."""
        allowed = self.allowed(context)
        if allowed is not None:
            several = "one or more, separated by ;, of " if self.type is list else "one of "
            return several + (", ".join(map(str, allowed)) or f"the map's {self.choices}, of which it has none")
        bounds = ((">=", self.least), ("<=", self.most))
        said = " and ".join(f"{sign} {bound:g}" for sign, bound in bounds if bound is not None)
        return f"{WORDS[self.type]} {said}".rstrip()

    def allowed(self, context: Any = None) -> tuple[Any, ...] | None:
        """The values to choose from; None: any, or nobody knows without a map."""
        if not isinstance(self.choices, str):
            return self.choices
        maze = getattr(context, "maze", None)
        if maze is None:
            return None
        return (
            tuple(o.name for o in maze.openings) if self.choices == "openings" else tuple(r.number for r in maze.rings)
        )

    def parse(self, text: str, context: Any = None) -> Any:
        """A literal from a file. Raises ValueError."""
        return self._bounded(CONVERSIONS[self.type](text), context)

    def accept(self, value: Any, context: Any = None) -> Any:
        """A value from the blackboard; text becomes what the port takes, as a literal would. Raises ValueError."""
        number = isinstance(value, int | float) and not isinstance(value, bool)
        if type(value) is self.type or (self.type is str and not number):
            return self._bounded(value, context)
        if isinstance(value, str):
            return self.parse(value, context)
        if number:  # of a script, or of a literal of a SubTree
            return self._bounded(self._converted(value), context)
        if not isinstance(value, INSTANCES[self.type]) or (isinstance(value, bool) and self.type is not bool):
            raise ValueError(value)
        return self._bounded(value, context)

    def _converted(self, value: float) -> Any:
        """A number as the port's type. Raises ValueError where something of it would be lost."""
        if self.type in (str, list):
            return CONVERSIONS[self.type](str(value))
        if self.type is not float and value != self.type(value):
            raise ValueError(value)
        return self.type(value)

    def takes(self, default: Any) -> bool:
        """Whether `get` may return this where nothing is given: it is of the type itself, as no text is read."""
        if self.type is not str and not isinstance(default, INSTANCES[self.type]):
            return False
        try:
            self.accept(default)
        except ValueError:
            return False
        return True

    def _bounded(self, value: Any, context: Any) -> Any:
        if isinstance(value, float) and not math.isfinite(value):
            raise ValueError(value)
        if (self.least is not None and value < self.least) or (self.most is not None and value > self.most):
            raise ValueError(value)
        if self.choices is not None:
            allowed = self.allowed(context)
            words: Any = value if self.type is list else (value,)
            if allowed is not None and not (words and all(word in allowed for word in words)):
                chosen = [_same_number(word, allowed) for word in words]
                if not chosen or None in chosen:
                    raise ValueError(value)
                return chosen if self.type is list else chosen[0]
        return value


def _same_number(word: Any, allowed: tuple[Any, ...]) -> Any:
    """Of the allowed values the one that is this word, or this number in another form (3, 3.0, 3.000000); None: none
    is."""
    if word in allowed or not isinstance(word, str):
        return word if word in allowed else None
    return next((one for one in allowed if NUMBER.fullmatch(word) and _number_in(str(one)) == float(word)), None)


def _number_in(text: str) -> float | None:
    return float(text) if NUMBER.fullmatch(text) else None


@dataclass(frozen=True)
class Key:
    """A reference {name} to the blackboard."""

    name: str

    def __str__(self) -> str:
        return f"{{{self.name}}}"


def shown(value: Any, most: int = 60) -> str:
    """A value for an error: its repr, cut where it is long; of an object its kind."""
    text = repr(value) if isinstance(value, PLAIN) else f"an object of the kind {type(value).__name__}"
    return text if len(text) <= most else f"{text[: most - 3]}..."


LONG = re.compile(r"[^\s/\\]{61,}")  # a word, or a part of a path


def one_line(text: str, most: int = 600) -> str:
    """Text for an error: one line, nothing that a terminal would obey, not endless; of a long word its two ends."""
    short = LONG.sub(lambda word: f"{word[0][:40]}...{word[0][-17:]}", text)
    clean = "".join(c if c.isprintable() else ascii(c)[1:-1] for c in short[: most + 1])
    return clean if len(clean) <= most else f"{clean[: most - 3]}..."
