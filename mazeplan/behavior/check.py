"""What a look at a tree finds before anything moves: keys that nobody sets, and branches that no tick reaches."""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

from mazeplan.behavior.blackboard import Blackboard
from mazeplan.behavior.controls import (
    AsyncFallback,
    AsyncSequence,
    Fallback,
    ReactiveFallback,
    ReactiveSequence,
    Sequence,
    SequenceWithMemory,
)
from mazeplan.behavior.decorators import ForceFailure, ForceSuccess, Inverter, SubTree
from mazeplan.behavior.node import TreeNode
from mazeplan.behavior.ports import Key
from mazeplan.behavior.script import Script, ScriptError, parse_script
from mazeplan.behavior.tree import BehaviorTree, parts_of
from mazeplan.core.errors import TreeError

SET_BY_THE_RUN = ("goal", "waypoints")  # on the outermost scope, before the first tick
SCRIPTS = {"Script": "code", "ScriptCondition": "code", "Precondition": "if"}  # ports that hold a script
NAMES = {"SkipUnlessUpdated": "entry", "WaitValueUpdate": "entry", "WasEntryUpdated": "entry"}  # literals that are keys
SEQUENCES = (Sequence, AsyncSequence, SequenceWithMemory, ReactiveSequence)
FALLBACKS = (Fallback, AsyncFallback, ReactiveFallback)
BOTH = frozenset({"SUCCESS", "FAILURE"})


@dataclass(frozen=True)
class Findings:
    """errors: what fails when it is ticked; warnings: what does no harm, and nothing else either."""

    errors: tuple[TreeError, ...] = ()
    warnings: tuple[TreeError, ...] = ()


@dataclass(frozen=True)
class _Use:
    """A node uses a key: through which attribute, by which name, and where that stands."""

    node: TreeNode
    attribute: str
    name: str
    home: tuple[int, str]


def check_tree(tree: BehaviorTree) -> Findings:
    """Look at a tree that was built and not ticked."""
    for name in SET_BY_THE_RUN:
        tree.blackboard.declare(name)
    reads, writes = list[_Use](), list[_Use]()
    for node in tree.nodes():
        for attribute, name, written in _uses(node):
            home, known = node.board._home(name)
            (writes if written else reads).append(_Use(node, attribute, name, (id(home), known)))
    outermost = {(id(tree.blackboard), name) for name in SET_BY_THE_RUN}
    given = {(id(board), name) for board in _boards(tree) for name in board}
    known = {use.home for use in writes} | given | outermost
    missing = [use for use in reads if use.home not in known]
    return Findings(
        tuple(use.node.wrong(_unknown(use, known)) for use in _once(missing)), tuple(_unreachable(tree.root))
    )


def _boards(tree: BehaviorTree) -> Iterator[Blackboard]:
    yield tree.blackboard
    yield from (part.board for node in tree.nodes() for part in parts_of(node))


def _once(uses: Iterable[_Use]) -> Iterator[_Use]:
    """One use of each key at each line."""
    seen = set()
    for use in uses:
        place = use.node.place
        where = (place.file, place.line, use.name) if place else (id(use.node), 0, use.name)
        if where not in seen:
            seen.add(where)
            yield use


def _unknown(use: _Use, known: set[tuple[int, str]]) -> str:
    names = sorted({name for scope, name in known if scope == use.home[0]})
    near = difflib.get_close_matches(use.home[1], names, 1)
    hint = f"did you mean {{{near[0]}}}?" if near else f"set are {', '.join(names) or 'none'}"
    inner = "" if use.home[1] == use.name else f", which is {{{use.home[1]}}} outside"
    return f"{use.attribute}: nothing sets {{{use.name}}}{inner}; {hint}"


def _uses(node: TreeNode) -> Iterator[tuple[str, str, bool]]:
    """(attribute, key, whether it is set) of what a node reads and sets."""
    kind = type(node).__name__
    if not isinstance(node, SubTree):
        for attribute, value in node.values.items():
            port = node.ports.get(attribute)
            if isinstance(value, Key) and port is not None:
                if port.direction != "out":
                    yield attribute, value.name, False
                if port.direction != "in":
                    yield attribute, value.name, True
            elif attribute == NAMES.get(kind):
                yield attribute, str(value), False
            elif attribute == SCRIPTS.get(kind):
                yield from _used_by(attribute, _parsed(str(value)), node.board.enums)
            elif kind == "SetBlackboard" and attribute == "output_key":
                yield attribute, str(value), True
    if node.conditions is not None:
        for attribute, script in node.conditions.given.items():
            yield from _used_by(attribute, script, node.board.enums)


def _parsed(text: str) -> Script | None:
    try:
        return parse_script(text)
    except ScriptError:  # refused where it stands as a literal
        return None


def _used_by(attribute: str, script: Script | None, enums: Iterable[str] = ()) -> Iterator[tuple[str, str, bool]]:
    if script is not None:
        yield from ((attribute, name, True) for name in sorted(script.writes))
        yield from ((attribute, name, False) for name in sorted(script.reads - set(enums) - script.writes))


def _ends(node: TreeNode) -> frozenset[str]:
    """How a node may end."""
    if node.conditions is not None:
        return BOTH | {"SKIPPED"}
    match type(node).__name__:
        case "AlwaysSuccess":
            return frozenset({"SUCCESS"})
        case "AlwaysFailure":
            return frozenset({"FAILURE"})
    if isinstance(node, ForceSuccess):
        return frozenset({"SUCCESS"}) | (_ends(node.parts[0]) - BOTH)
    if isinstance(node, ForceFailure):
        return frozenset({"FAILURE"}) | (_ends(node.parts[0]) - BOTH)
    if isinstance(node, Inverter):
        other = {"SUCCESS": "FAILURE", "FAILURE": "SUCCESS"}
        return frozenset(other.get(end, end) for end in _ends(node.parts[0]))
    return _ends(node.parts[0]) if isinstance(node, SubTree) else BOTH


def _unreachable(node: TreeNode) -> Iterator[TreeError]:
    """Children behind one that stops the row in any case."""
    goes_on = "SUCCESS" if isinstance(node, SEQUENCES) else "FAILURE" if isinstance(node, FALLBACKS) else None
    for i, child in enumerate(parts_of(node)):
        yield from _unreachable(child)
        more = parts_of(node)[i + 1 :]
        if goes_on and more and not _ends(child) & {goes_on, "SKIPPED"}:
            yield more[0].wrong(f"never ticked: {child.name} before it never ends with {goes_on}")
            return
