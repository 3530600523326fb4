"""Checks a tree before anything moves: finds keys that nothing sets, ports that nothing reads, and trees that no
SubTree names."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

from mazeplan.btree.blackboard import Blackboard
from mazeplan.btree.builder import SCRIPTS, draft
from mazeplan.btree.decorators import SubTree
from mazeplan.btree.leaf import Context
from mazeplan.btree.node import TreeNode
from mazeplan.btree.ports import Key
from mazeplan.btree.script import Script, parse_script
from mazeplan.btree.tree import BehaviorTree
from mazeplan.btree.treefile import Mistakes, TreeFile
from mazeplan.core.errors import TreeError, nearest

MOST = 20  # maximum number of mistakes listed for one file: later ones may only follow from the first
MOST_NAMES = 200  # maximum number of names in a message
NAMES = {"SkipUnlessUpdated": "entry", "WaitValueUpdate": "entry", "WasEntryUpdated": "entry"}  # literals name keys

Home = tuple[int, str]  # id of a scope, and the name of an entry there


@dataclass(frozen=True)
class Findings:
    """Result of a check."""

    errors: tuple[TreeError, ...] = ()  # mistakes for which the tree is refused, or fails when it is ticked
    warnings: tuple[TreeError, ...] = ()  # doubtful parts, which have no effect
    nodes: int | None = None  # number of nodes of the tree; None if the tree cannot be built


@dataclass(frozen=True)
class _Use:
    """A node reads or sets a key.

    chain: (scope, name there) from the node's scope to the scope to which the key belongs"""

    node: TreeNode
    attribute: str  # through which the node uses the key
    name: str  # of the key at the node
    chain: tuple[tuple[Blackboard, str], ...]

    @property
    def home(self) -> Home:
        board, name = self.chain[-1]
        return id(board), name


def check_file(
    file: TreeFile, registry: Mapping[str, type[TreeNode]], context: Context, given: Iterable[str] = ()
) -> Findings:
    """Check the main tree of a file. given: keys of the outermost scope that have a value before the first tick.

    Keys and ports of SubTrees are checked once the tree can be built."""
    tree, mistakes = draft(file, registry, context)
    if tree is None:
        return Findings(listed(mistakes, file.files[0]))
    found = check_tree(tree, given)
    warnings = _in_order((*found.warnings, *file.unused(tree.name)), file.files[0])
    return Findings(listed(found.errors, file.files[0]), warnings, found.nodes)


def check_tree(tree: BehaviorTree, given: Iterable[str] = ()) -> Findings:
    """Check a tree that was built but not ticked. given: as of `check_file`."""
    nodes = list(tree.nodes())
    calls = {id(node.board): node for node in nodes if isinstance(node, SubTree)}
    reads, writes = _all_uses(nodes)
    boards = [tree.blackboard, *(call.board for call in calls.values())]
    known = {(id(board), name) for board in boards for name in board} | {use.home for use in writes}
    known |= {(id(tree.blackboard), name) for name in given}
    names = dict[int, list[str]]()
    for scope, name in sorted(known):
        names.setdefault(scope, []).append(name)
    errors = Mistakes()
    for use in reads:
        if use.home not in known:
            node, word, problem = _unset(use, calls, names.get(use.home[0], []))
            error = node.wrong(problem)
            errors.setdefault((str(error.file), error.line, word), error)
    warnings = Mistakes()
    for warning in _unread(calls.values(), (*reads, *writes)):
        warnings.setdefault((str(warning.file), warning.line, warning.problem), warning)
    return Findings(tuple(errors.values()), tuple(warnings.values()), len(nodes))


def reads_key(tree: BehaviorTree, name: str) -> bool:
    """Whether a tree reads an entry of its outermost scope."""
    reads, _ = _all_uses(tree.nodes())
    return any(use.home == (id(tree.blackboard), name) for use in reads)


def _in_order(found: Iterable[TreeError], first: Path | None) -> tuple[TreeError, ...]:
    return tuple(sorted(found, key=lambda e: (e.file != first, str(e.file), e.line or 0)))


def listed(found: Iterable[TreeError], first: Path | None) -> tuple[TreeError, ...]:
    """The first MOST mistakes in order, and the number of the others. first: the file whose mistakes come first"""
    errors = _in_order(found, first)
    beyond = len(errors) - MOST
    if beyond <= 0:
        return errors
    return *errors[:MOST], TreeError(f"and {beyond} more mistake{'s' * (beyond > 1)}", file=first)


def _unset(use: _Use, calls: Mapping[int, SubTree], there: list[str]) -> tuple[TreeNode, str, str]:
    """The error for a key that nothing sets: (the node to blame, the port or key, the error).

    To blame is the SubTree that does not give the port; else the outermost SubTree that gives it such a key; else the
    node. there: keys of that scope that are set"""
    (board, key), node, enums = use.chain[-1], use.node, use.node.board.enums
    near = nearest(key, [*there, *enums])
    hint = f"set are {', '.join(there[:MOST_NAMES]) or 'none'}"
    if near is not None:
        hint = f"did you mean {near if near in enums else Key(near)}?"
    at = "" if node.place is None else f" at {node.place.file.name}:{node.place.line}"
    inside = f"inside, {node.name} reads {Key(use.name)}{at}"
    if id(board) in calls:
        return calls[id(board)], key, f"{key} is missing: {inside}"
    for scope, port in reversed(use.chain[:-1]):
        call = calls.get(id(scope))
        if call is not None and isinstance(call.values.get(port), Key):
            return call, port, f"{port}: nothing sets {Key(key)}; {inside}; {hint}"
    return node, f"{use.attribute} {key}", f"{use.attribute}: nothing sets {Key(use.name)}; {hint}"


def _unread(calls: Iterable[SubTree], uses: Iterable[_Use]) -> Iterator[TreeError]:
    """Remarks on ports that are given to a SubTree but that nothing in it reads or sets.

    A port that the SubTree gives on to another SubTree counts as used: the other SubTree has the remark."""
    used = {(id(board), name) for use in uses for board, name in use.chain}
    for call in calls:
        keys = [value.name for value in call.values.values() if isinstance(value, Key)]
        used |= {(id(board), name) for key in keys for board, name in _scope_of(call).scope_chain(key)}
    for call in calls:
        tree = call.values.get("ID", call.name)
        for port in call.values:
            if port != "ID" and port not in call.by_model and (id(call.board), port) not in used:
                yield call.wrong(f"{port}: nothing in {tree} reads it")


def _all_uses(nodes: Iterable[TreeNode]) -> tuple[list[_Use], list[_Use]]:
    reads, writes = list[_Use](), list[_Use]()
    for node in nodes:
        for attribute, name, written in _uses(node):
            use = _Use(node, attribute, name, tuple(_scope_of(node).scope_chain(name)))
            (writes if written else reads).append(use)
    return reads, writes


def _scope_of(node: TreeNode) -> Blackboard:
    """The scope of a node's attributes; for a SubTree, the scope around it."""
    outside = node.board.outside if isinstance(node, SubTree) else None
    return node.board if outside is None else outside


def _uses(node: TreeNode) -> Iterator[tuple[str, str, bool]]:
    """(attribute, key, whether the node sets the key) of all keys that a node reads or sets."""
    kind = type(node).__name__
    for attribute, value in () if isinstance(node, SubTree) else node.values.items():
        port = node.ports.get(attribute)
        if isinstance(value, Key) and port is not None:
            if port.direction != "out":
                yield attribute, value.name, False
            if port.direction != "in":
                yield attribute, value.name, True
        elif attribute == NAMES.get(kind):
            yield attribute, str(value), False
        elif kind == "SetBlackboard" and attribute == "output_key":
            yield attribute, str(value), True
    for attribute, script in _scripts_of(node):
        yield from ((attribute, name, True) for name in sorted(script.writes))
        read = (script.reads - script.writes) | script.needs
        yield from ((attribute, name, False) for name in sorted(read - set(node.board.enums)))


def _scripts_of(node: TreeNode) -> Iterator[tuple[str, Script]]:
    port = SCRIPTS.get(type(node).__name__, "")
    text = node.values.get(port)
    if isinstance(text, str):
        yield port, parse_script(text)
    if node.conditions is not None:
        yield from node.conditions.given.items()
