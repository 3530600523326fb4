"""Finds branches of a tree that no tick reaches: after a node that always ends its parent, or under a constant
condition."""

from __future__ import annotations

from collections.abc import Iterator

from mazeplan.btree.blackboard import Blackboard
from mazeplan.btree.builtin_leaves import (
    AlwaysFailure,
    AlwaysSuccess,
    RunScript,
    SetBlackboard,
    Sleep,
    UnsetBlackboard,
)
from mazeplan.btree.choices import IfThenElse, WhileDoElse
from mazeplan.btree.conditions import DECISIONS
from mazeplan.btree.controls import (
    AsyncFallback,
    AsyncSequence,
    Fallback,
    ReactiveFallback,
    ReactiveSequence,
    Sequence,
    SequenceWithMemory,
)
from mazeplan.btree.decorators import (
    Delay,
    ForceFailure,
    ForceSuccess,
    Inverter,
    KeepRunningUntilFailure,
    Precondition,
    Repeat,
    RetryUntilSuccessful,
    SubTree,
)
from mazeplan.btree.leaf import Leaf
from mazeplan.btree.node import TreeNode
from mazeplan.btree.ports import Key
from mazeplan.btree.script import Script, parse_script
from mazeplan.btree.script_values import Scope, ScriptError
from mazeplan.btree.tree import parts_of
from mazeplan.core.errors import TreeError

SUCCEED = (AlwaysSuccess, RunScript, SetBlackboard, Sleep, UnsetBlackboard)
SEQUENCES = (Sequence, AsyncSequence, SequenceWithMemory, ReactiveSequence)
FALLBACKS = (Fallback, AsyncFallback, ReactiveFallback)
SUCCESS, FAILURE = frozenset({"SUCCESS"}), frozenset({"FAILURE"})
BOTH = SUCCESS | FAILURE
ANY = BOTH | {"SKIPPED"}
OTHER = {"SUCCESS": "FAILURE", "FAILURE": "SUCCESS"}


def never_ticked(node: TreeNode) -> Iterator[TreeError]:
    """A remark at the first node of each branch that is never ticked, from this node down."""
    decisive, _ = _decision(node)
    if decisive is not None:
        yield node.wrong(f"never ticked: {decisive} is always {'false' if decisive == '_while' else 'true'}")
        return
    idle = dict(_idle_children(node))
    for i, child in enumerate(parts_of(node)):
        if i in idle:
            yield child.wrong(f"never ticked: {idle[i]}")
        else:
            yield from never_ticked(child)


def _idle_children(node: TreeNode) -> Iterator[tuple[int, str]]:
    """(index of a child that is never ticked, why). In a sequence or fallback only the first such child: the children
    after it are not ticked either."""
    parts = parts_of(node)
    goes_on = "SUCCESS" if isinstance(node, SEQUENCES) else "FAILURE" if isinstance(node, FALLBACKS) else None
    if goes_on is not None:
        for i, child in enumerate(parts[:-1], 1):
            if not _ends(child) & {goes_on, "SKIPPED"}:
                yield i, f"{child.name} before it never ends with {goes_on}"
                return
    elif isinstance(node, IfThenElse | WhileDoElse):
        for i, result in enumerate(("SUCCESS", "FAILURE")[: len(parts) - 1], 1):
            if result not in _ends(parts[0]):
                yield i, f"the condition {parts[0].name} never ends with {result}"
    elif isinstance(node, Repeat | RetryUntilSuccessful) and node.values.get(node.limit) == 0:
        yield 0, f"{node.limit} of the {type(node).__name__} above it is 0"
    elif isinstance(node, Precondition) and _always(node) is False:
        yield 0, "the script `if` of the Precondition above it is always false"


def _constant(script: Script | None, node: TreeNode) -> bool | None:
    """The constant truth of a script; None if it depends on the blackboard, or there is no script."""
    enums = node.board.enums
    if script is None or script.sets or script.reads - set(enums):
        return None
    try:
        return script.holds(Scope(Blackboard(enums=enums)))
    except ScriptError:  # raised again when the node is ticked
        return None


def _always(node: Precondition) -> bool | None:
    """The constant truth of a Precondition's script; None if it is not constant."""
    text = node.values.get("if")
    try:
        return _constant(parse_script(text), node) if isinstance(text, str) else None
    except ScriptError:  # the builder refuses it
        return None


def _decision(node: TreeNode) -> tuple[str | None, frozenset[str]]:
    """(the precondition by which a node is never ticked, results that its preconditions may give)."""
    ends = set[str]()
    given = {} if node.conditions is None else node.conditions.given
    for name, (wanted, result) in DECISIONS.items() if given else ():
        script = given.get(name)
        value = None if script is None else _constant(script, node)
        if script is not None and value in (None, wanted):
            ends.add(result.name)
        if value is wanted:
            return name, frozenset(ends)
    return None, frozenset(ends)


def _ends(node: TreeNode) -> frozenset[str]:
    """The results with which a node may end."""
    decisive, decided = _decision(node)
    return decided if decisive is not None else decided | _ends_itself(node)


def _ends_of_leaf(node: Leaf) -> frozenset[str]:
    """The results with which a leaf may end. A script that fails does not count: it ends the run."""
    if isinstance(node, AlwaysFailure):
        return FAILURE
    copies = isinstance(node, SetBlackboard) and isinstance(
        node.values["value"], Key
    )  # the other entry may have no value: FAILURE
    return SUCCESS if isinstance(node, SUCCEED) and not copies else BOTH


def _ends_itself(node: TreeNode) -> frozenset[str]:
    """The results with which a node may end if its preconditions let it be ticked."""
    if isinstance(node, Leaf):
        return _ends_of_leaf(node)
    inner = [_ends(child) for child in parts_of(node)]
    if isinstance(node, ForceSuccess | ForceFailure):
        return (SUCCESS if isinstance(node, ForceSuccess) else FAILURE) | (inner[0] - BOTH)
    if isinstance(node, Inverter):
        return frozenset(OTHER.get(end, end) for end in inner[0])
    if isinstance(node, SubTree | Delay):
        return inner[0]
    if isinstance(node, KeepRunningUntilFailure):
        return inner[0] & FAILURE
    if isinstance(node, Repeat | RetryUntilSuccessful):
        limit, again = node.values.get(node.limit), frozenset({node.again.name})
        if not isinstance(limit, int):
            return inner[0] | again
        return inner[0] if limit > 0 else again if limit == 0 else inner[0] - again
    if isinstance(node, (*SEQUENCES, *FALLBACKS)):
        goes_on, stops = ("SUCCESS", "FAILURE") if isinstance(node, SEQUENCES) else ("FAILURE", "SUCCESS")
        through = all(ends & {goes_on, "SKIPPED"} for ends in inner) and any(goes_on in ends for ends in inner)
        skipped = {"SKIPPED"} if all("SKIPPED" in ends for ends in inner) else set()
        reached = next((i for i, ends in enumerate(inner, 1) if not ends & {goes_on, "SKIPPED"}), len(inner))
        stopped = {stops} if any(stops in ends for ends in inner[:reached]) else set()
        return frozenset(({goes_on} if through else set()) | stopped | skipped)
    return ANY
