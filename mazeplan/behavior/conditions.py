"""Preconditions, which any node of a tree may have as attributes, with the semantics of BehaviorTree.CPP 4.

| attribute | if the node is idle | if it is running |
|---|---|---|
| _failureIf | true: FAILURE at once | not looked at |
| _successIf | true: SUCCESS at once | not looked at |
| _skipIf | true: SKIPPED | not looked at |
| _while | false: SKIPPED | false: the node is halted, SKIPPED |

They are looked at in this order, and the first that decides does; the names in them are those of the blackboard on
which the node stands (for a SubTree that of the tree around it). Postconditions (_onSuccess ...) are not taken.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from mazeplan.behavior.blackboard import Blackboard
from mazeplan.behavior.expression import Expression, ExpressionError
from mazeplan.behavior.status import FAILURE, SKIPPED, SUCCESS, Result

WHILE = "_while"
DECISIONS: dict[str, tuple[bool, Result]] = {  # in the order in which they are looked at: if it is this, then that
    "_failureIf": (True, FAILURE),
    "_successIf": (True, SUCCESS),
    "_skipIf": (True, SKIPPED),
    WHILE: (False, SKIPPED),
}


@dataclass(frozen=True)
class Conditions:
    """The preconditions of one node: {attribute: expression}, and where their names stand."""

    given: Mapping[str, Expression]
    blackboard: Blackboard

    def decide(self, running: bool) -> Result | None:
        """What the node ends with without being ticked; None: it is ticked. Raises ExpressionError, which names the
        attribute."""
        for name, (decisive, result) in DECISIONS.items():
            if name not in self.given or (running and name != WHILE):
                continue
            try:
                holds = self.given[name].holds(self.blackboard.get)
            except ExpressionError as problem:
                raise ExpressionError(f"{name}: {problem}") from None
            if holds is decisive:
                return result
        return None
