"""Ports: the typed inputs and outputs of a node. A tree gives a port a literal or a {key} of the blackboard."""

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
        if "_" in text:  # 1_000 is Python's notation, which no other reader of the format knows
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
INSTANCES: dict[type, Any] = {int: Integral, float: Real, bool: bool, list: list | tuple}  # str takes any object


NUMBER = re.compile(r"-?[0-9]+(?:\.[0-9]*)?(?:[eE][+-]?[0-9]+)?")


@dataclass(frozen=True)
class Port:
    """A typed input or output of a node.

    type: int, float, bool, str or list
    default: value if the tree gives none; REQUIRED: the tree must give one
    doc: description for users
    direction: in, out, or inout; an output takes only a {key}
    least, most: minimum and maximum of a number; infinite numbers are never allowed
    choices: the allowed values; a text: what `context.choices(text)` gives, such as the "rings" of a map

    With choices, a list needs at least one word, and each word must be one of the choices. A port of type str without
    choices also carries objects, such as a plan, by {key}."""

    type: type
    default: Any = REQUIRED
    doc: str = ""
    direction: str = "in"
    least: float | None = None
    most: float | None = None
    choices: tuple[Any, ...] | str | None = None

    def expects(self, context: Any = None) -> str:
        """The allowed values in words for a run with this context, for an error."""
        allowed = self.allowed(context)
        if allowed is not None:
            several = "one or more, separated by ;, of " if self.type is list else "one of "
            return several + (", ".join(map(str, allowed)) or f"no {self.choices}")
        bounds = ((">=", self.least), ("<=", self.most))
        said = " and ".join(f"{sign} {bound:g}" for sign, bound in bounds if bound is not None)
        return f"{WORDS[self.type]} {said}".rstrip()

    def allowed(self, context: Any = None) -> tuple[Any, ...] | None:
        """The choices; None: there are none, or the context does not know them."""
        if not isinstance(self.choices, str):
            return self.choices
        known = getattr(context, "choices", None)
        return None if known is None else known(self.choices)

    def parse(self, text: str, context: Any = None) -> Any:
        """The value of a literal from a file. Raises ValueError."""
        return self._bounded(CONVERSIONS[self.type](text), context)

    def accept(self, value: Any, context: Any = None) -> Any:
        """The value of a blackboard entry in the type of the port; text is read like a literal. Raises ValueError."""
        number = isinstance(value, int | float) and not isinstance(value, bool)
        if type(value) is self.type or (self.type is str and not number):
            return self._bounded(value, context)
        if isinstance(value, str):
            return self.parse(value, context)
        if number:  # from a script, or from a literal of a SubTree
            return self._bounded(self._converted(value), context)
        if not isinstance(value, INSTANCES[self.type]) or (isinstance(value, bool) and self.type is not bool):
            raise ValueError(value)
        return self._bounded(value, context)

    def _converted(self, value: float) -> Any:
        if self.type in (str, list):
            return CONVERSIONS[self.type](str(value))
        if self.type is not float and value != self.type(value):
            raise ValueError(value)
        return self.type(value)

    def takes(self, default: Any) -> bool:
        """Whether a value may be the default. It must already have the port's type: `get` returns it as it is."""
        try:
            self.accept(default)
        except ValueError:
            return False
        return self.type is str or isinstance(default, INSTANCES[self.type])

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
    """The allowed value that equals this word, or this number in another form (3, 3.0, 3.000000); None without one."""
    if word in allowed or not isinstance(word, str) or not NUMBER.fullmatch(word):
        return word if word in allowed else None
    numbers = [one for one in allowed if NUMBER.fullmatch(str(one))]
    return next((one for one in numbers if float(one) == float(word)), None)


@dataclass(frozen=True)
class Key:
    """A reference {name} to the blackboard."""

    name: str

    def __str__(self) -> str:
        return f"{{{self.name}}}"


def shown(value: Any, most: int = 60) -> str:
    """A value as text for an error: its repr, cut if it is long; for other objects, their type."""
    text = repr(value) if isinstance(value, PLAIN) else f"an object of the kind {type(value).__name__}"
    return text if len(text) <= most else f"{text[: most - 3]}..."


LONG = re.compile(r"[^\s/\\]{61,}")  # a word, or a part of a path


def one_line(text: str, most: int = 600) -> str:
    """Text for an error: one line of limited length, without control characters. Long words are cut to their two
    ends."""
    short = LONG.sub(lambda word: f"{word[0][:40]}...{word[0][-17:]}", text)
    clean = "".join(c if c.isprintable() else ascii(c)[1:-1] for c in short[: most + 1])
    return clean if len(clean) <= most else f"{clean[: most - 3]}..."
