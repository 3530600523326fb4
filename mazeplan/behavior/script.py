"""The scripts of a tree, such as `legs > 2 && !hurry` or `tries := tries + 1`: BehaviorTree.CPP's language.

    script     = assignment { [";"] assignment }
    assignment = name (":=" | "=" | "+=" | "-=" | "*=" | "/=") assignment | choice
    choice     = or [ "?" assignment ":" choice ]
    or, and    = "||", "&&": both sides are evaluated
    comparison = bits { ("==" | "!=" | "<" | "<=" | ">" | ">=") bits }      1 < a < 3 holds if both do
    bits       = "|" and "^", then "&", on whole numbers
    sum        = "+", "-", and ".." that joins texts and numbers; then "*", "/"
    prefix     = "-", "!", "~"
    atom       = 12, 0x1f, 1.5e3, 'text', "text", true, false, a name on the blackboard or of an enum, "(" ... ")"

`:=` makes an entry or sets it, `=` sets one that exists. An entry keeps its kind: a text takes no number, a whole
number takes no fraction. A script is parsed when a file is read, into functions; nothing is given to Python to run, and
there are neither calls, attributes nor indices. Numbers compare with the tolerance of a float (1.2e-7).
"""

from __future__ import annotations

import math
import operator
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, NoReturn

from mazeplan.behavior.blackboard import EMPTY, Blackboard, Entry

MAX_LENGTH = 10_000  # characters; what is longer belongs into a leaf
MAX_DEPTH = 50  # of parentheses, signs and choices, one in another
EPSILON = 2.0**-23  # of a 32-bit float: the tolerance of == between numbers
WHOLE = 2**63  # whole numbers are of 64 bits
ASSIGNMENTS = (":=", "=", "+=", "-=", "*=", "/=")
POWERS = {  # how tightly an operator binds; assignments and ?: are apart
    "||": 6, "&&": 8, "==": 10, "!=": 10, "<": 10, "<=": 10, ">": 10, ">=": 10,
    "|": 12, "^": 12, "&": 14, "+": 16, "-": 16, "..": 16, "*": 18, "/": 18,
}  # fmt: skip
PREFIXES = ("-", "!", "~")
ALLOWED = f"numbers, 'text', true, false, names on the blackboard, ( ) ? : ; ~ ! {' '.join((*POWERS, *ASSIGNMENTS))}"
TOKEN = re.compile(
    r"(?P<space>[ \t\r\n]+)"
    r"|(?P<number>(?:0[xX][0-9a-fA-F]+|[0-9]+(?:\.[0-9]+)?(?:[eE][+-]?[0-9]+)?)(?![A-Za-z0-9_@]|\.(?!\.)))"
    r"|(?P<name>[A-Za-z_@][A-Za-z0-9_]*)"
    r"|(?P<text>'[^']*'|\"[^\"]*\")"
    r"|(?P<sign>\.\.|:=|==|!=|<=|>=|&&|\|\||\+=|-=|\*=|/=|[<>!+\-*/()=?:;&|^~])"
)

Value = bool | int | float | str
COMPARISONS: dict[str, Callable[[Any, Any], bool]] = {
    "==": operator.eq, "!=": operator.ne, "<": operator.lt, "<=": operator.le, ">": operator.gt, ">=": operator.ge,
}  # fmt: skip
SUMS: dict[str, Callable[[float, float], float]] = {
    "+": operator.add, "-": operator.sub, "*": operator.mul,
}  # fmt: skip
BITS: dict[str, Callable[[int, int], int]] = {"&": operator.and_, "|": operator.or_, "^": operator.xor}


class ScriptError(ValueError):
    """A script that cannot be read, or run; one line, without the place of the script."""


@dataclass(frozen=True)
class Scope:
    """Where the names of a script stand: the enums of the blackboard first, then its entries."""

    board: Blackboard = field(default_factory=Blackboard)

    @property
    def enums(self) -> Mapping[str, int]:
        """{name: number}."""
        return self.board.enums


Evaluate = Callable[[Scope], Any]


@dataclass(frozen=True)
class Script:
    """A script as it was written, ready to run. reads, writes: the names on the blackboard that it uses; sets: those
    that it assigns to by any sign, which `:=` alone makes."""

    text: str
    evaluate: Evaluate
    reads: frozenset[str] = frozenset()
    writes: frozenset[str] = frozenset()
    sets: frozenset[str] = frozenset()

    def holds(self, scope: Scope) -> bool:
        """Whether its value is true. Raises ScriptError."""
        return truth(self.evaluate(scope))

    def run(self, scope: Scope) -> None:
        """Run it for what it assigns. Raises ScriptError."""
        self.evaluate(scope)


@dataclass(frozen=True)
class _Token:
    kind: str
    text: str
    column: int  # from 1


def parse_script(text: str) -> Script:
    """Raises ScriptError with the column and what is allowed there."""
    if len(text) > MAX_LENGTH:
        raise ScriptError(f"got {len(text)} characters, expected at most {MAX_LENGTH}")
    parser = _Parser(text)
    return Script(text, parser.whole(), *map(frozenset, (parser.reads, parser.writes, parser.sets)))


class _Parser:
    """One script, by precedence climbing; each method returns the function of what it has read."""

    def __init__(self, text: str) -> None:
        self._tokens, self._at, self._depth = _tokens(text), 0, 0
        self.reads: set[str] = set()
        self.writes: set[str] = set()
        self.sets: set[str] = set()

    def whole(self) -> Evaluate:
        """All statements; the value is that of the last one."""
        if self._now.kind == "end":
            self._unexpected("a script")
        statements = []
        while self._now.kind != "end":
            statements.append(self._expression(0))
            while self._take(";"):
                pass
        if len(statements) == 1:
            return statements[0]

        def run(scope: Scope) -> Any:
            return [statement(scope) for statement in statements][-1]

        return run

    @property
    def _now(self) -> _Token:
        return self._tokens[self._at]

    def _take(self, *signs: str) -> str | None:
        """The sign at hand if it is one of these; then the next token is at hand."""
        token = self._now
        if token.kind != "sign" or token.text not in signs:
            return None
        self._at += 1
        return token.text

    def _unexpected(self, expected: str) -> NoReturn:
        token = self._now
        got = "the end" if token.kind == "end" else repr(token.text)
        raise ScriptError(f"column {token.column}: got {got}, expected {expected}")

    def _expression(self, least: int) -> Evaluate:
        """What binds at least so tightly."""
        if self._depth >= MAX_DEPTH:
            self._unexpected(f"at most {MAX_DEPTH} expressions in each other")
        self._depth += 1
        name = self._now.text if self._now.kind == "name" and self._now.text not in TRUTHS else None
        first = self._at
        left = self._prefix()
        if name is None or self._at != first + 1:
            name = None  # more than a name stands to the left
        while self._now.kind == "sign":
            sign = self._now.text
            if sign in ASSIGNMENTS and least <= 2:
                left = self._assignment(sign, name)
                break
            if sign == "?" and least <= 4:
                left = self._choice(left)
                break
            if POWERS.get(sign, -1) < least:
                break
            left = self._comparison(left) if sign in COMPARISONS else self._binary(left)
            name = None
        self._depth -= 1
        return left

    def _assignment(self, sign: str, name: str | None) -> Evaluate:
        if name is None:
            self._unexpected("a name on the blackboard to the left of it")
        self._at += 1
        self.sets.add(name)
        if sign == ":=":  # which needs no entry; its name was read as that of a value
            self.reads.discard(name)
            self.writes.add(name)
        value = self._expression(0)
        return lambda scope: _assigned(scope, name, sign, value)

    def _choice(self, condition: Evaluate) -> Evaluate:
        self._at += 1
        then = self._expression(0)
        if not self._take(":"):
            self._unexpected("an operator or :")
        other = self._expression(4)
        return lambda scope: (then if _chosen(condition(scope), scope) else other)(scope)

    def _comparison(self, left: Evaluate) -> Evaluate:
        parts, signs = [left], []
        while (sign := self._take(*COMPARISONS)) is not None:
            signs.append(sign)
            parts.append(self._expression(11))

        def evaluate(scope: Scope) -> Any:
            value = parts[0](scope)
            for sign, part in zip(signs, parts[1:], strict=True):
                other = part(scope)
                if not _compared(sign, value, other, scope):
                    return 0.0
                value = other
            return 1.0

        return evaluate

    def _binary(self, left: Evaluate) -> Evaluate:
        sign = self._now.text
        self._at += 1
        right = self._expression(POWERS[sign] + 1)
        return lambda scope: _combined(sign, left(scope), right(scope))

    def _prefix(self) -> Evaluate:
        sign = self._take(*PREFIXES)
        if sign:
            part = self._expression(20)
            return lambda scope: _signed(sign, part(scope))
        if self._take("("):
            found = self._expression(0)
            if not self._take(")"):
                self._unexpected("an operator or )")
            return found
        token = self._now
        if token.kind not in ("number", "text", "name"):
            self._unexpected("a number, 'text', true, false, a name, (, -, ! or ~")
        self._at += 1
        if token.kind == "name" and token.text not in TRUTHS:
            self.reads.add(token.text)
            return lambda scope: _known(token.text, scope)
        value = TRUTHS[token.text] if token.kind == "name" else _literal(token)
        return lambda scope: value


TRUTHS = {"true": 1.0, "false": 0.0}


def _tokens(text: str) -> list[_Token]:
    found, at = list[_Token](), 0
    while at < len(text):
        match = TOKEN.match(text, at)
        if match is None:
            raise ScriptError(f"column {at + 1}: got {text[at : at + 10]!r}, expected {ALLOWED}")
        if match.lastgroup != "space":
            found.append(_Token(str(match.lastgroup), match.group(), at + 1))
        at = match.end()
    return [*found, _Token("end", "", len(text) + 1)]


def _literal(token: _Token) -> Value:
    if token.kind == "text":
        return token.text[1:-1]
    try:
        number: float = int(token.text, 16) if token.text[:2].lower() == "0x" else int(token.text)
    except ValueError:
        number = float(token.text)
    if (number >= WHOLE) if isinstance(number, int) else not math.isfinite(number):
        got = token.text if len(token.text) <= 30 else f"{token.text[:27]}..."
        raise ScriptError(f"column {token.column}: got {got}, expected a number of 64 bits")
    return number


def _known(name: str, scope: Scope) -> Value:
    """The value of a name, if it is of a kind that a script has."""
    if name in scope.enums:
        return float(scope.enums[name])
    try:
        value = scope.board.get(name)
    except KeyError as missing:
        raise ScriptError(str(missing.args[0])) from None
    return _plain(name, value)


def _plain(name: str, value: Any) -> Value:
    if isinstance(value, int) and abs(value) >= WHOLE:
        raise ScriptError(f"{name} is {_short(str(value)[:30])}, expected a number of 64 bits")
    if isinstance(value, bool | int | float | str):
        return value
    try:
        return float(value)  # a NumPy number
    except (TypeError, ValueError, OverflowError):
        raise ScriptError(f"{name} is a {type(value).__name__}, expected a number or text") from None


def truth(value: Value) -> bool:
    """A number is true unless it is 0; text is true or false as it reads. Raises ScriptError."""
    if isinstance(value, str):
        if value.strip() in TRUTHS:
            return bool(TRUTHS[value.strip()])
        raise ScriptError(f"got the text {_short(value)}, expected something true or false")
    return bool(value)


def _chosen(value: Value, scope: Scope) -> bool:
    """The condition of ?:, as a number; text as it reads. Raises ScriptError."""
    number = number_of(value, scope.enums) if isinstance(value, str) else value
    if number is None:
        raise ScriptError(f"got the text {_short(str(value))} before ?, expected a number")
    return bool(number)


def number_of(text: str, enums: Mapping[str, int]) -> float | None:
    """Text as a number: true, false, the name of an enum, or as a file has it; None if it is none."""
    word = text.strip()
    if word in TRUTHS:
        return TRUTHS[word]
    if word in enums:
        return float(enums[word])
    token = TOKEN.fullmatch(word.lstrip("-"))
    if token is None or token.lastgroup != "number" or word[:2].lower() == "0x":
        return None
    return float(word)


def _compared(sign: str, left: Value, right: Value, scope: Scope) -> bool:
    """Two texts as texts, anything else as numbers."""
    if isinstance(left, str) and isinstance(right, str):
        return COMPARISONS[sign](left, right)
    numbers = []
    for value in (left, right):
        number = number_of(value, scope.enums) if isinstance(value, str) else float(value)
        if number is None:
            raise ScriptError(f"got {_short(str(value))} beside {sign}, expected a number")
        numbers.append(number)
    if sign in ("==", "!="):
        return (abs(numbers[0] - numbers[1]) <= EPSILON) is (sign == "==")
    return COMPARISONS[sign](*numbers)


def _combined(sign: str, left: Value, right: Value) -> Value:
    """The value of an operator other than a comparison. Raises ScriptError."""
    texts = isinstance(left, str), isinstance(right, str)
    if sign == "+" and all(texts):
        return str(left) + str(right)
    if sign == ".." and any(texts):
        return text_of(left) + text_of(right)
    if any(texts) or sign == "..":
        wrong = left if texts[0] else right
        expected = "text on one side at least" if sign == ".." else "a number"
        raise ScriptError(f"got {_short(str(wrong))} beside {sign}, expected {expected}")
    if sign in BITS:
        return float(BITS[sign](_whole(left, sign), _whole(right, sign)))
    a, b = float(left), float(right)
    if sign in ("&&", "||"):
        return float((bool(a) and bool(b)) if sign == "&&" else (bool(a) or bool(b)))
    if sign == "/":
        if b == 0.0:
            raise ScriptError(f"got {a:g} / 0, expected a divisor other than 0")
        return a / b
    return SUMS[sign](a, b)


def _signed(sign: str, value: Value) -> Value:
    if isinstance(value, str):
        raise ScriptError(f"got the text {_short(value)} after {sign}, expected a number")
    if sign == "-":
        return -float(value)
    return float(not value) if sign == "!" else float(~math.trunc(value))


def _whole(value: Any, sign: str) -> int:
    if float(value) != math.floor(float(value)) or abs(float(value)) >= WHOLE:
        raise ScriptError(f"got {value:g} beside {sign}, expected a whole number")
    return int(value)


def _assigned(scope: Scope, name: str, sign: str, value: Evaluate) -> Value:
    """Set an entry. Raises ScriptError if it does not exist, or is of another kind."""
    entry = scope.board.find(name)
    if entry is None:
        if sign != ":=":
            raise ScriptError(f"the blackboard has no {name!r}; := makes it, {sign} does not")
        entry = scope.board.declare(name)
    new = value(scope)
    if sign not in (":=", "="):
        if entry.value is EMPTY:
            raise ScriptError(f"{name} has no value yet, which {sign} would change")
        old = _plain(name, entry.value)
        if isinstance(new, str) and sign != "+=":
            raise ScriptError(f"got {_short(new)} after {sign}, expected a number")
        new = _combined(sign[0], old, new)
    entry.put(_fitting(name, entry, new, scope))
    return entry.value


def _fitting(name: str, entry: Entry, value: Value, scope: Scope) -> Value:
    """A value in the kind that an entry has; any kind if it has no value yet."""
    old = entry.value
    if old is EMPTY and entry.number and isinstance(value, str):
        number = number_of(value, scope.enums)
        return value if number is None else float(number)
    if old is EMPTY or isinstance(old, str) is isinstance(value, str) is True:
        return value
    if isinstance(old, bool | int | float):
        number = number_of(value, scope.enums) if isinstance(value, str) else value
        if number is not None and (isinstance(old, float) or isinstance(value, str)):
            return float(number)
        if number is not None and abs(number) < WHOLE and number == math.floor(number):
            return int(number)
    kind = "text" if isinstance(old, str) else "a whole number" if isinstance(old, int) else type(old).__name__
    raise ScriptError(f"got {_short(text_of(value))} for {name}, which is {kind}")


def text_of(value: Value) -> str:
    """A value as text, as `..` joins it: a number that is not whole with six decimals."""
    return f"{value:.6f}" if isinstance(value, float) else str(int(value)) if not isinstance(value, str) else value


def _short(text: str) -> str:
    shown = repr(text)
    return shown if len(shown) <= 40 else f"{shown[:37]}..."
