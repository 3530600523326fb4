"""The expressions of preconditions, such as `legs > 2 && !hurry`: part of BehaviorTree.CPP's scripting language.

    or        = and { "||" and }                 what is right of || and && is looked at only if it matters
    and       = relation { "&&" relation }
    relation  = sum [ ("==" | "!=" | "<" | "<=" | ">" | ">=") sum ]
    sum       = product { ("+" | "-") product }  + joins two texts
    product   = unary { ("*" | "/") unary }
    unary     = ("!" | "-" | "+") unary | atom
    atom      = number | 'text' | "text" | true | false | name on the blackboard | "(" or ")"

It is parsed when a file is read, by descent, into functions of a look-up; nothing is ever given to Python to run, and
there are neither calls, attributes, indices nor assignments. A number is a float, true is 1, false 0; text of which a
number or truth is wanted becomes one if it reads like one, since a literal given to a SubTree is text.
"""

from __future__ import annotations

import math
import operator
import re
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NoReturn

MAX_LENGTH = 500  # characters; what is longer belongs into a leaf
MAX_DEPTH = 20  # of parentheses and signs, one in another
OPERATORS = "== != < <= > >= && || ! + - * /"
ALLOWED = f"numbers, 'text', true, false, names on the blackboard, ( ) and {OPERATORS}"
TOKEN = re.compile(
    r"(?P<space>[ \t\r\n]+)"
    r"|(?P<number>(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?(?![A-Za-z0-9_.]))"
    r"|(?P<name>[A-Za-z_][A-Za-z0-9_.]*)"
    r"|(?P<text>'[^']*'|\"[^\"]*\")"
    r"|(?P<sign>==|!=|<=|>=|&&|\|\||[<>!+\-*/()])"
)

Value = bool | float | str
Evaluate = Callable[[Callable[[str], Any]], Value]


class ExpressionError(ValueError):
    """An expression that cannot be read, or evaluated; one line, without the place of the expression."""


@dataclass(frozen=True)
class _Token:
    kind: str
    text: str
    column: int  # from 1


@dataclass(frozen=True)
class Expression:
    """An expression as it was written, ready to be evaluated."""

    text: str
    evaluate: Evaluate

    def holds(self, look_up: Callable[[str], Any]) -> bool:
        """Whether it is true. `look_up`: value of a name, KeyError if there is none. Raises ExpressionError."""
        return _truth(self.evaluate(look_up))


def parse_expression(text: str) -> Expression:
    """Raises ExpressionError with column and what is allowed there."""
    if len(text) > MAX_LENGTH:
        raise ExpressionError(f"got {len(text)} characters, expected at most {MAX_LENGTH}")
    return Expression(text, _Parser(text).whole())


class _Parser:
    """One expression; each method reads what its name says, from the token at hand, and returns its function."""

    def __init__(self, text: str) -> None:
        self._tokens, self._at, self._depth = _tokens(text), 0, 0

    def whole(self) -> Evaluate:
        found = self._any()
        if self._now.kind != "end":
            self._unexpected("an operator or the end")
        return found

    @property
    def _now(self) -> _Token:
        return self._tokens[self._at]

    def _take(self, *signs: str) -> str | None:
        """The sign at hand if it is one of these; then the next one is at hand."""
        token = self._now
        if token.kind != "sign" or token.text not in signs:
            return None
        self._at += 1
        return token.text

    def _unexpected(self, expected: str) -> NoReturn:
        token = self._now
        got = "the end" if token.kind == "end" else repr(token.text)
        raise ExpressionError(f"column {token.column}: got {got}, expected {expected}")

    def _any(self) -> Evaluate:
        parts = [self._all()]
        while self._take("||"):
            parts.append(self._all())
        return parts[0] if len(parts) == 1 else lambda look_up: any(_truth(part(look_up)) for part in parts)

    def _all(self) -> Evaluate:
        parts = [self._relation()]
        while self._take("&&"):
            parts.append(self._relation())
        return parts[0] if len(parts) == 1 else lambda look_up: all(_truth(part(look_up)) for part in parts)

    def _relation(self) -> Evaluate:
        left = self._sum()
        sign = self._take(*COMPARISONS)
        if sign is None:
            return left
        right = self._sum()
        if self._now.text in COMPARISONS and self._now.kind == "sign":
            self._unexpected("&& or || between two comparisons")
        return lambda look_up: _compared(sign, left(look_up), right(look_up))

    def _sum(self) -> Evaluate:
        return self._row(self._product, "+", "-")

    def _product(self) -> Evaluate:
        return self._row(self._unary, "*", "/")

    def _row(self, operand: Callable[[], Evaluate], *signs: str) -> Evaluate:
        """Operands with signs of one rank between them, from left to right."""
        first, rest = operand(), list[tuple[str, Evaluate]]()
        while (sign := self._take(*signs)) is not None:
            rest.append((sign, operand()))
        if not rest:
            return first

        def evaluate(look_up: Callable[[str], Any]) -> Value:
            value = first(look_up)
            for sign, part in rest:
                value = _reckoned(sign, value, part(look_up))
            return value

        return evaluate

    def _unary(self) -> Evaluate:
        if self._depth >= MAX_DEPTH:
            self._unexpected(f"at most {MAX_DEPTH} parentheses and signs in each other")
        self._depth += 1
        sign = self._take("!", "-", "+")
        found = self._signed(sign, self._unary()) if sign else self._atom()
        self._depth -= 1
        return found

    def _signed(self, sign: str, part: Evaluate) -> Evaluate:
        if sign == "!":
            return lambda look_up: not _truth(part(look_up))
        return lambda look_up: _number(part(look_up), sign) * (-1.0 if sign == "-" else 1.0)

    def _atom(self) -> Evaluate:
        if self._take("("):
            found = self._any()
            if not self._take(")"):
                self._unexpected("an operator or )")
            return found
        token = self._now
        if token.kind not in ATOMS:
            self._unexpected("a number, 'text', true, false, a name, ( or !")
        self._at += 1
        if token.kind == "name" and token.text not in TRUTHS:
            return lambda look_up: _known(token.text, look_up)
        value = ATOMS[token.kind](token.text)
        if isinstance(value, float) and not math.isfinite(value):
            raise ExpressionError(f"column {token.column}: got {token.text}, expected a number below 1.8e308")
        return lambda look_up: value


def _tokens(text: str) -> list[_Token]:
    found, at = list[_Token](), 0
    while at < len(text):
        match = TOKEN.match(text, at)
        if match is None:
            hint = "; == compares, and nothing is assigned here" if text[at] == "=" else ""
            raise ExpressionError(f"column {at + 1}: got {text[at : at + 10]!r}, expected {ALLOWED}{hint}")
        if match.lastgroup != "space":
            found.append(_Token(str(match.lastgroup), match.group(), at + 1))
        at = match.end()
    return [*found, _Token("end", "", len(text) + 1)]


TRUTHS = {"true": True, "false": False}
ATOMS: dict[str, Callable[[str], Value]] = {
    "number": float, "text": lambda text: text[1:-1], "name": lambda name: TRUTHS[name],
}  # fmt: skip
COMPARISONS: dict[str, Callable[[Any, Any], bool]] = {
    "==": operator.eq, "!=": operator.ne, "<": operator.lt, "<=": operator.le, ">": operator.gt, ">=": operator.ge,
}  # fmt: skip


def _known(name: str, look_up: Callable[[str], Any]) -> Value:
    """A value from the blackboard, if it is of a kind that an expression has."""
    try:
        value = look_up(name)
    except KeyError as missing:
        raise ExpressionError(str(missing.args[0])) from None
    if isinstance(value, bool | str):
        return value
    try:
        return float(value)
    except (TypeError, ValueError, OverflowError):
        raise ExpressionError(f"{name} is a {type(value).__name__}, expected a number, text or true or false") from None


def _number(value: Value, sign: str) -> float:
    """A number, or text that reads like one. Raises ExpressionError."""
    if isinstance(value, str):
        try:
            return float(TRUTHS.get(value.strip(), _plain(value)))
        except ValueError:
            raise ExpressionError(f"got {_short(value)} beside {sign}, expected a number") from None
    return float(value)


def _plain(text: str) -> float | str:
    """Text as a number if it is one as a file would have it, without Python's underscores, nan and inf."""
    token = TOKEN.fullmatch(text.strip().lstrip("-"))
    return text if token is not None and token.lastgroup == "number" else "no number"


def _truth(value: Value) -> bool:
    """True and false are themselves, a number is true unless it is 0, text as it reads. Raises ExpressionError."""
    if isinstance(value, str):
        if value.strip() in TRUTHS:
            return TRUTHS[value.strip()]
        raise ExpressionError(f"got the text {_short(value)}, expected something true or false")
    return bool(value)


def _compared(sign: str, left: Value, right: Value) -> bool:
    """Two texts as texts, anything else as numbers."""
    if isinstance(left, str) and isinstance(right, str):
        return COMPARISONS[sign](left, right)
    return COMPARISONS[sign](_number(left, sign), _number(right, sign))


def _reckoned(sign: str, left: Value, right: Value) -> Value:
    """Two numbers, or two texts with + between them. Raises ExpressionError."""
    if sign == "+" and isinstance(left, str) and isinstance(right, str):
        return left + right
    a, b = _number(left, sign), _number(right, sign)
    if sign == "/" and b == 0.0:
        raise ExpressionError(f"got {a:g} / 0, expected a divisor other than 0")
    return a + b if sign == "+" else a - b if sign == "-" else a * b if sign == "*" else a / b


def _short(text: str) -> str:
    shown = repr(text)
    return shown if len(shown) <= 40 else f"{shown[:37]}..."
