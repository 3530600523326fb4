"""What a builder does at a mistake in a file: it raises the mistake, or keeps it and goes on.

If it goes on, an `Unbuilt` takes the place of the node that could not be built."""

from __future__ import annotations

import re
from collections.abc import Mapping
from types import TracebackType
from typing import ClassVar

from mazeplan.btree.node import Control
from mazeplan.btree.status import FAILURE, Result
from mazeplan.core.errors import TreeError

MOST = 20  # maximum number of mistakes listed for one file: later ones may only follow from the first
MOST_KEPT = 1000  # maximum number of mistakes that are counted
WORD = re.compile(r"@?[A-Za-z_][A-Za-z0-9_.]*")


class EnoughError(TreeError):
    """No more nodes can be built. This error never leaves the builder."""


class Mistakes:
    """A context that lets a TreeError through, or keeps it.

    most: maximum number of kept errors; 0: errors are raised
    noted: number of errors until now; an error counts again each time that its line is built
    """

    def __init__(self, most: int = 0) -> None:
        self._most, self.noted = most, 0
        self._found: dict[tuple[str, int | None, str], TreeError] = {}

    @property
    def found(self) -> tuple[TreeError, ...]:
        """The kept errors in the order in which they were found, each once."""
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
        """Raise or keep a mistake of another node. The present node can still be built."""
        with self:
            raise problem
        self.noted -= 1

    def last(self, problem: TreeError) -> TreeError:
        """The error to raise for a mistake after which no more nodes can be built."""
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
