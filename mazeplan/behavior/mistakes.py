"""What a builder does at a mistake in a file: it raises it, or keeps it and goes on.

Then a node stands for the one that could not be built."""

from __future__ import annotations

import re
from collections.abc import Mapping
from types import TracebackType
from typing import ClassVar

from mazeplan.behavior.node import Control
from mazeplan.behavior.status import FAILURE, Result
from mazeplan.core.errors import TreeError

MOST = 20  # mistakes that are told of one file: behind them may stand what follows from the first ones
MOST_KEPT = 1000  # mistakes that are counted
WORD = re.compile(r"@?[A-Za-z_][A-Za-z0-9_.]*")


class EnoughError(TreeError):
    """No node more is to be built. Never leaves the builder."""


class Mistakes:
    """A context in which a TreeError is raised (most 0), or kept, up to so many of them. found: those that were kept,
    each once however often its line is built; noted: how many came, the same ones counted again."""

    def __init__(self, most: int = 0) -> None:
        self._most, self.noted = most, 0
        self._found: dict[tuple[str, int | None, str], TreeError] = {}

    @property
    def found(self) -> tuple[TreeError, ...]:
        """In the order in which they were found."""
        return tuple(self._found.values())

    def __enter__(self) -> Mistakes:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, problem: BaseException | None, trace: TracebackType | None
    ) -> bool:
        if not self._most or not isinstance(problem, TreeError) or isinstance(problem, EnoughError):
            return False
        self.noted += 1
        self._found.setdefault((str(problem.file), problem.line, problem.problem), problem)
        if len(self._found) >= self._most:
            raise EnoughError("enough") from None
        return True

    def elsewhere(self, problem: TreeError) -> None:
        """Raise a mistake, or keep it, of which the node at hand is none the worse."""
        with self:
            raise problem
        self.noted -= 1

    def last(self, problem: TreeError) -> TreeError:
        """What to raise for a mistake after which nothing more can be built."""
        if not self._most:
            return problem
        self._found.setdefault((str(problem.file), problem.line, problem.problem), problem)
        return EnoughError("enough")


class Unbuilt(Control):
    """Stands for a node that could not be built, with its children if it has any; it would fail. words: all names in
    its attributes: it might have set those keys."""

    least: ClassVar[int] = 0
    words: frozenset[str] = frozenset()

    def run(self) -> Result:
        """FAILURE, at once."""
        return FAILURE

    def of(self, attributes: Mapping[str, str]) -> Unbuilt:
        """The same for an element with these attributes."""
        self.words = frozenset(word for pair in attributes.items() for text in pair for word in WORD.findall(text))
        return self
