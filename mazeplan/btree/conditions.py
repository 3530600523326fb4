"""Pre- and postconditions, which any node of a tree may have as attributes, with the semantics of BehaviorTree.CPP 4
(docs/tree-nodes.md has their table).

Preconditions are evaluated in the order of DECISIONS, in an idle node; _while in one that runs, too, which it halts.
All scripts use the blackboard scope of the node; for a SubTree, that of the tree around it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

from mazeplan.btree.blackboard import Blackboard
from mazeplan.btree.script import Script
from mazeplan.btree.script_values import ScriptError
from mazeplan.btree.status import FAILURE, RUNNING, SKIPPED, SUCCESS, Status

WHILE, POST, ON_HALTED = "_while", "_post", "_onHalted"
DECISIONS: dict[str, tuple[bool, Status]] = {  # in the order of evaluation: (decisive value of the script, result)
    "_failureIf": (True, FAILURE),
    "_successIf": (True, SUCCESS),
    "_skipIf": (True, SKIPPED),
    WHILE: (False, SKIPPED),
}
ENDINGS: dict[str, Status] = {"_onSuccess": SUCCESS, "_onFailure": FAILURE}
CONDITIONS = (*DECISIONS, *ENDINGS, ON_HALTED, POST)


@dataclass(frozen=True)
class Conditions:
    """The pre- and postconditions of one node: {attribute: script}, and the blackboard of their names."""

    given: Mapping[str, Script] = field(default_factory=dict)
    board: Blackboard = field(default_factory=Blackboard)

    def decide(self, status: Status) -> Status | None:
        """The result that the preconditions give in place of a tick; None: the node is ticked.

        status: of the node before. Raises ScriptError that names the attribute."""
        for name, (decisive, result) in DECISIONS.items():
            evaluated = status is not RUNNING or name == WHILE
            if evaluated and name in self.given and self._named(name, Script.holds) is decisive:
                return result
        return None

    def after(self, result: Status) -> None:
        """Run the scripts of a node that has ended. Raises ScriptError, which names the attribute."""
        for name in (*(name for name, ending in ENDINGS.items() if result is ending), POST):
            if name in self.given:
                self._named(name, Script.run)

    def halted(self) -> None:
        """Run the script of a node that was halted while it ran. Raises ScriptError, which names the attribute."""
        if ON_HALTED in self.given:
            self._named(ON_HALTED, Script.run)

    def _named(self, name: str, action: Callable[[Script, Blackboard], Any]) -> Any:
        try:
            return action(self.given[name], self.board)
        except ScriptError as problem:
            raise ScriptError(f"{name}: {problem}") from None
