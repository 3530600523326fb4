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

`:=` makes an entry or sets it, `=` sets an entry that exists. An entry keeps its kind: a text takes no number, a whole
number takes no fraction. A script is parsed into functions when a file is read. Python never executes its text, and it
has neither calls, attributes nor indices. Numbers compare with the tolerance of a 32-bit float (1.2e-7).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, NoReturn

from mazeplan.btree.blackboard import Blackboard
from mazeplan.btree.script_values import (
    COMPARISONS,
    TOKEN,
    TRUTHS,
    WHOLE,
    Evaluate,
    ScriptError,
    Value,
    assigned,
    chosen,
    combined,
    compared,
    signed,
    truth,
    value_of,
)

MAX_LENGTH = 10_000  # characters; a longer script should be a leaf
MAX_DEPTH = 50  # maximum depth of nested parentheses, signs and choices
ASSIGNMENTS = (":=", "=", "+=", "-=", "*=", "/=")
POWERS = {  # precedence of the operators; assignments and ?: are handled separately
    "||": 6, "&&": 8, "==": 10, "!=": 10, "<": 10, "<=": 10, ">": 10, ">=": 10,
    "|": 12, "^": 12, "&": 14, "+": 16, "-": 16, "..": 16, "*": 18, "/": 18,
}  # fmt: skip
QUOTES = ("'", '"')
PREFIXES = ("-", "!", "~")
ALLOWED = f"numbers, 'text', true, false, names on the blackboard, ( ) ? : ; ~ ! {' '.join((*POWERS, *ASSIGNMENTS))}"


@dataclass(frozen=True)
class Script:
    """A script, ready to run."""

    text: str  # as it was written
    evaluate: Evaluate  # runs the script and returns the value of its last statement
    reads: frozenset[str] = frozenset()  # names on the blackboard that it reads
    writes: frozenset[str] = frozenset()  # names that it assigns to by `:=`, which makes entries
    needs: frozenset[str] = frozenset()  # names that it always reads before it makes them

    def holds(self, board: Blackboard) -> bool:
        """Whether its value is true. Raises ScriptError."""
        return truth(self.evaluate(board))

    def run(self, board: Blackboard) -> None:
        """Run it for what it assigns. Raises ScriptError."""
        self.evaluate(board)


@dataclass(frozen=True)
class _Token:
    kind: str
    text: str
    column: int  # from 1


@lru_cache(maxsize=1000)
def parse_script(text: str) -> Script:
    """Parse a script, once. Raises ScriptError with the column and what is allowed there."""
    if len(text) > MAX_LENGTH:
        raise ScriptError(f"got {len(text)} characters, expected at most {MAX_LENGTH}")
    parser = _Parser(text)
    evaluate = parser.whole()
    return Script(text, evaluate, frozenset(parser.reads), frozenset(parser.writes), frozenset(parser.needs))


class _Parser:
    """Parses one script by precedence climbing. Each method returns a function that evaluates what it has read."""

    def __init__(self, text: str) -> None:
        self._tokens, self._at, self._depth = _tokens(text), 0, 0
        self.reads: set[str] = set()
        self.writes: set[str] = set()
        self.needs: set[str] = set()
        self._made: set[str] = set()  # names that := has made until now
        self._branches = 0  # number of ?: around the present place

    def whole(self) -> Evaluate:
        if self._now.kind == "end":
            self._unexpected("a script")
        statements = []
        while self._now.kind != "end":
            statements.append(self._expression(0))
            while self._take(";"):
                pass
        if len(statements) == 1:
            return statements[0]

        def run(board: Blackboard) -> Any:
            return [statement(board) for statement in statements][-1]

        return run

    @property
    def _now(self) -> _Token:
        return self._tokens[self._at]

    def _take(self, *signs: str) -> str | None:
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
        """Parse an expression of operators whose precedence is at least `least`."""
        if self._depth >= MAX_DEPTH:
            self._unexpected(f"at most {MAX_DEPTH} expressions in each other")
        self._depth += 1
        name = self._now.text if self._now.kind == "name" and self._now.text not in TRUTHS else None
        first = self._at
        left = self._prefix()
        if name is None or self._at != first + 1:
            name = None  # the left side is more than a name
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
        if sign == ":=":  # it needs no entry; undo the read that `_prefix` noted for the name
            self.reads.discard(name)
            self.writes.add(name)
        value = self._expression(0)
        if sign == ":=":
            self._made.add(name)
        return lambda board: assigned(board, name, sign, value)

    def _choice(self, condition: Evaluate) -> Evaluate:
        self._at += 1
        self._branches += 1
        then = self._expression(0)
        if not self._take(":"):
            self._unexpected("an operator or :")
        other = self._expression(4)
        self._branches -= 1
        return lambda board: (then if chosen(condition(board), board) else other)(board)

    def _comparison(self, left: Evaluate) -> Evaluate:
        parts, signs = [left], []
        while (sign := self._take(*COMPARISONS)) is not None:
            signs.append(sign)
            parts.append(self._expression(11))

        def evaluate(board: Blackboard) -> Any:
            value = parts[0](board)
            for sign, part in zip(signs, parts[1:], strict=True):
                other = part(board)
                if not compared(sign, value, other, board):
                    return 0.0
                value = other
            return 1.0

        return evaluate

    def _binary(self, left: Evaluate) -> Evaluate:
        sign = self._now.text
        self._at += 1
        right = self._expression(POWERS[sign] + 1)
        return lambda board: combined(sign, left(board), right(board))

    def _prefix(self) -> Evaluate:
        sign = self._take(*PREFIXES)
        if sign:
            part = self._expression(20)
            return lambda board: signed(sign, part(board))
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
            if self._now.text != ":=" and not self._branches and token.text not in self._made:
                self.needs.add(token.text)
            return lambda board: value_of(token.text, board)
        value = TRUTHS[token.text] if token.kind == "name" else _literal(token)
        return lambda board: value


def _tokens(text: str) -> list[_Token]:
    found, at = list[_Token](), 0
    while at < len(text):
        match = TOKEN.match(text, at)
        if match is None:
            if text[at] in QUOTES:
                raise ScriptError(
                    f"column {at + 1}: the text that begins here has no end, expected {text[at]} after it"
                )
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
