"""The values of a script: names, operators and assignments (`script` reads the text).

An entry keeps its kind: a text takes no number, a whole number takes no fraction. Numbers compare with the tolerance of
a 32-bit float (1.2e-7).
"""

from __future__ import annotations

import math
import operator
import re
from collections.abc import Callable, Mapping
from typing import Any

from mazeplan.btree.blackboard import EMPTY, Blackboard, Entry
from mazeplan.btree.ports import shown

EPSILON = 2.0**-23  # epsilon of a 32-bit float: the tolerance of == between numbers
WHOLE = 2**63  # whole numbers have 64 bits
TRUTHS = {"true": 1.0, "false": 0.0}
NEGATED = {"true": 0.0, "1": 0.0, "false": 1.0, "0": 1.0}  # texts after !
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
    """A script cannot be read or run. The message is one line, without the place of the script."""


Evaluate = Callable[[Blackboard], Any]  # looks up names first among the enums of the blackboard, then among its entries


def value_of(name: str, board: Blackboard) -> Value:
    """The value of a name. Raises ScriptError if there is none, or scripts do not have values of its type."""
    if name in board.enums:
        return float(board.enums[name])
    try:
        value = board.get(name)
    except KeyError as missing:
        raise ScriptError(str(missing.args[0])) from None
    return _plain(name, value)


def _plain(name: str, value: Any) -> Value:
    if isinstance(value, int) and abs(value) >= WHOLE:
        raise ScriptError(f"{name} is {shown(str(value)[:30])}, expected a number of 64 bits")
    if isinstance(value, bool | int | float | str):
        return value
    try:
        return float(value)  # a NumPy number
    except (TypeError, ValueError, OverflowError):
        raise ScriptError(f"{name} is a {type(value).__name__}, expected a number or text") from None


def truth(value: Value) -> bool:
    """Whether a value counts as true: a number other than 0, or the text "true". Raises ScriptError for other text than
    "true" and "false"."""
    if isinstance(value, str):
        if value.strip() in TRUTHS:
            return bool(TRUTHS[value.strip()])
        raise ScriptError(f"got the text {shown(value, 40)}, expected something true or false")
    return bool(value)


def chosen(value: Value, board: Blackboard) -> bool:
    """Whether the condition of ?: holds. Text is read as a number (`number_of`). Raises ScriptError."""
    number = number_of(value, board.enums) if isinstance(value, str) else value
    if number is None:
        raise ScriptError(f"got the text {shown(str(value), 40)} before ?, expected a number")
    return bool(number)


def number_of(text: str, enums: Mapping[str, int]) -> float | None:
    """The number that a text stands for: true, false, the name of an enum, or a number in digits; None for other
    text."""
    word = text.strip()
    if word in TRUTHS:
        return TRUTHS[word]
    if word in enums:
        return float(enums[word])
    digits = word.removeprefix("-")
    token = TOKEN.fullmatch(digits)
    if token is None or token.lastgroup != "number" or digits[:2].lower() == "0x":
        return None
    return float(word)


def compared(sign: str, left: Value, right: Value, board: Blackboard) -> bool:
    """Compare two texts as texts, anything else as numbers. Raises ScriptError."""
    if isinstance(left, str) and isinstance(right, str):
        return COMPARISONS[sign](left, right)
    numbers = []
    for value in (left, right):
        number = number_of(value, board.enums) if isinstance(value, str) else float(value)
        if number is None:
            raise ScriptError(f"got {shown(str(value), 40)} beside {sign}, expected a number")
        numbers.append(number)
    if sign in ("==", "!="):
        return (abs(numbers[0] - numbers[1]) <= EPSILON) is (sign == "==")
    return COMPARISONS[sign](*numbers)


def combined(sign: str, left: Value, right: Value) -> Value:
    """The result of an operator other than a comparison. Raises ScriptError."""
    texts = isinstance(left, str), isinstance(right, str)
    if sign == "+" and all(texts):
        return str(left) + str(right)
    if sign == ".." and any(texts):
        return text_of(left) + text_of(right)
    if any(texts) or sign == "..":
        wrong = left if texts[0] else right
        expected = "text on one side at least" if sign == ".." else "a number"
        raise ScriptError(f"got {shown(str(wrong), 40)} beside {sign}, expected {expected}")
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


def signed(sign: str, value: Value) -> Value:
    """The result of a prefix operator on a number; ! also takes the texts true, false, 1 and 0. Raises ScriptError."""
    if sign == "!" and isinstance(value, str) and value.strip() in NEGATED:
        return NEGATED[value.strip()]
    if isinstance(value, str):
        raise ScriptError(f"got the text {shown(value, 40)} after {sign}, expected a number")
    if sign == "-":
        return -float(value)
    if sign == "!":
        return float(not value)
    if not math.isfinite(value):
        raise ScriptError(f"got {value:g} after ~, expected a finite number")
    return float(~math.trunc(value))


def _whole(value: Any, sign: str) -> int:
    if not math.isfinite(value) or float(value) != math.floor(float(value)) or abs(float(value)) >= WHOLE:
        raise ScriptError(f"got {value:g} beside {sign}, expected a whole number")
    return int(value)


def assigned(board: Blackboard, name: str, sign: str, value: Evaluate) -> Value:
    """Set an entry and return its value. Raises ScriptError if the entry does not exist or has another kind."""
    entry = board.find(name)
    if entry is None:
        if sign != ":=":
            raise ScriptError(f"the blackboard has no {name!r}; := makes it, {sign} does not")
        entry = board.declare(name)
    new = value(board)
    if sign not in (":=", "="):
        if entry.value is EMPTY:
            raise ScriptError(f"{name} has no value yet, which {sign} would change")
        old = _plain(name, entry.value)
        if isinstance(new, str) and sign != "+=":
            raise ScriptError(f"got {shown(new, 40)} after {sign}, expected a number")
        new = combined(sign[0], old, new)
    entry.put(_fitting(name, entry, new, board))
    return entry.value


def _fitting(name: str, entry: Entry, value: Value, board: Blackboard) -> Value:
    """The value converted to the kind of an entry. Raises ScriptError.

    An entry without a value takes any kind. If it is for numbers, text that stands for a number becomes one."""
    old = entry.value
    if old is EMPTY and entry.number and isinstance(value, str):
        number = number_of(value, board.enums)
        return value if number is None else float(number)
    if old is EMPTY or isinstance(old, str) is isinstance(value, str) is True:
        return value
    if isinstance(old, bool | int | float):
        number = number_of(value, board.enums) if isinstance(value, str) else value
        if number is not None and (isinstance(old, float) or isinstance(value, str)):
            return float(number)
        if number is not None and abs(number) < WHOLE and number == math.floor(number):
            return int(number)
    kind = "text" if isinstance(old, str) else "a whole number" if isinstance(old, int) else type(old).__name__
    raise ScriptError(f"got {shown(text_of(value), 40)} for {name}, which is {kind}")


def text_of(value: Value) -> str:
    """A value as text, for `..`. A float has six decimals."""
    return f"{value:.6f}" if isinstance(value, float) else str(int(value)) if not isinstance(value, str) else value
