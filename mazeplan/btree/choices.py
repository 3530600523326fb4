"""Control nodes that choose one of their children: by a condition, by a value, or by a selection from outside.

They have the semantics of BehaviorTree.CPP 4.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, ClassVar

from mazeplan.btree.node import Control
from mazeplan.btree.ports import REQUIRED, Key, Port
from mazeplan.btree.script_values import EPSILON, number_of, text_of
from mazeplan.btree.status import FAILURE, FINISHED, RUNNING, SKIPPED, SUCCESS, Status
from mazeplan.core.errors import one_of


class _Choice(Control):
    least: ClassVar[int] = 2
    most: ClassVar[int | None] = 3


class IfThenElse(_Choice):
    """The second child if the first one succeeds, the third one if it fails; the first one is asked once."""

    def _forget(self) -> None:
        self._chosen = 0

    def run(self) -> Status:
        """The result of the child that was chosen; FAILURE where it would be the third and there is none."""
        if self._chosen == 0:
            condition = self.tick_child(0)
            if condition is RUNNING:
                return RUNNING
            if condition is SKIPPED or (condition is FAILURE and len(self.parts) == 2):
                return self.finish(condition)
            self._chosen = 1 if condition is SUCCESS else 2
        result = self.tick_child(self._chosen)
        return result if result is RUNNING else self.finish(result)


class WhileDoElse(_Choice):
    """As IfThenElse, but the first child is asked at every tick; the other branch is halted when it changes."""

    def run(self) -> Status:
        """The result of the child that is chosen now."""
        condition, three = self.tick_child(0), len(self.parts) == 3
        if condition is RUNNING:
            return RUNNING
        if condition is SUCCESS:
            if three:
                self.parts[2].reset()
            result = self.tick_child(1)
        elif condition is FAILURE and three:
            self.parts[1].reset()
            result = self.tick_child(2)
        else:
            result = condition
        return result if result is RUNNING else self.finish(result)


class _Switch(Control):
    """One child for each case, and a last one for any other value."""

    cases: ClassVar[int] = 2

    def _forget(self) -> None:
        self._running: int | None = None

    def act(self) -> Status:
        return self.run()  # it runs only while its child does

    def run(self) -> Status:
        chosen = self._match()
        if self._running not in (None, chosen):
            self.parts[self._running or 0].reset()
        result = self.tick_child(chosen)
        self._running = chosen if result is RUNNING else None
        return self.finish(result) if result in FINISHED else result

    def _match(self) -> int:
        """The number of the case that equals the variable, as text, number or enum; the last child if none does, or
        the variable was never set."""
        value = self._values["variable"]
        if isinstance(value, Key) and value.name not in self._board:
            return self.cases
        found = _text(self.get("variable"))
        for i in range(self.cases):
            case = self._values[f"case_{i + 1}"]
            if isinstance(case, Key) and case.name not in self._board:
                continue
            if _equal(found, _text(self.get(f"case_{i + 1}")), self._board.enums):
                return i
        return self.cases


def _text(value: Any) -> str:
    return text_of(value) if isinstance(value, bool | int | float) else str(value)


def _number(text: str, enums: Mapping[str, int]) -> float | None:
    """The number of a text; None for one of truth."""
    return None if text in ("true", "false") else number_of(text, enums)


def _equal(a: str, b: str, enums: Mapping[str, int]) -> bool:
    x, y = _number(a, enums), _number(b, enums)
    return a == b or (x is not None and y is not None and math.fabs(x - y) <= EPSILON)


def _switch(n: int) -> type[_Switch]:
    words = {"variable": Port(str, REQUIRED, "the value to compare, often a {key}")}
    words |= {f"case_{i}": Port(str, REQUIRED, f"value of child {i}") for i in range(1, n + 1)}
    doc = f"The child of the case among {n} that equals the variable; the last child if none does."
    return type(f"Switch{n}", (_Switch,), {"cases": n, "least": n + 1, "most": n + 1, "ports": words, "__doc__": doc})


class ManualSelector(Control):
    """The child that somebody selects: it runs until `selection` names a child, or a result."""

    ports: ClassVar[dict[str, Port]] = {
        "selection": Port(
            str, "{selection}", "name of a child, its number from 1, or SUCCESS, FAILURE, RUNNING", direction="inout"
        ),
        "repeat_last_selection": Port(bool, False, "whether the last child selected is ticked again"),
    }

    _last: int | None = None  # the child that was selected last

    def __init__(self, *arguments: Any) -> None:
        super().__init__(*arguments)
        self._values.setdefault("selection", Key("selection"))
        self._board.declare("selection")

    def _forget(self) -> None:
        self._chosen: int | None = None

    def run(self) -> Status:
        """RUNNING until something is selected; then the result of that child. A selection is used once."""
        if self._chosen is None and (self._last is None or not self.get("repeat_last_selection")):
            text = self._selected()
            if text in ("SUCCESS", "FAILURE", "RUNNING", ""):
                return Status(text) if text else RUNNING
            self._last = self._number(text)
        self._chosen = self._last
        result = self.tick_child(self._last or 0)
        return result if result is RUNNING else self.finish(result)

    def _selected(self) -> str:
        key = self._values["selection"]
        if not isinstance(key, Key):
            return str(key)
        if key.name not in self._board:
            return ""
        text = _text(self.get("selection"))
        self._board.set(key.name, "")
        return text

    def _number(self, text: str) -> int:
        names = [child.name for child in self.parts]
        if text in names:
            return names.index(text)
        number = _number(text, {})
        if number is not None and number.is_integer() and 1 <= number <= len(names):  # 2.000000 is that of a script
            return int(number) - 1
        raise self.wrong(f"selection: got {text!r}, expected {one_of(names, text)}, or 1 to {len(names)}")


SWITCHES = tuple(_switch(n) for n in range(2, 7))
