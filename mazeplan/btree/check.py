"""Checks a tree before anything moves. Finds keys that nothing sets, ports that nothing reads, branches that no tick
reaches, and scripts that fail on the literals that SubTrees give."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

from mazeplan.btree.blackboard import Blackboard
from mazeplan.btree.decorators import SubTree
from mazeplan.btree.key_uses import Home, Use, all_uses, scope_of, scripts_of
from mazeplan.btree.leaf import Context
from mazeplan.btree.mistakes import MOST, MOST_KEPT, Unbuilt
from mazeplan.btree.node import TreeNode
from mazeplan.btree.ports import Key
from mazeplan.btree.script_values import number_of
from mazeplan.btree.tree import BehaviorTree, parts_of
from mazeplan.btree.treefile import TreeFile
from mazeplan.core.errors import TreeError
from mazeplan.core.name_hints import nearest

MOST_NAMES = 200  # maximum number of names in a message


@dataclass(frozen=True)
class Findings:
    """Result of a check.

    errors: mistakes for which the tree is refused, or fails when it is ticked
    warnings: doubtful parts, which have no effect or look like slips
    nodes: number of nodes of the tree; None if the tree cannot be built
    names_map: whether a node names a ring or an opening
    """

    errors: tuple[TreeError, ...] = ()
    warnings: tuple[TreeError, ...] = ()
    nodes: int | None = None
    names_map: bool = False


def check_file(
    file: TreeFile, registry: Mapping[str, type[TreeNode]], context: Context, given: Iterable[str] = ()
) -> Findings:
    """Check the main tree of a file. given: keys of the outermost scope that have a value before the first tick.

    Of many errors it lists the first `MOST` and the number of the others. Mistakes of the file itself come before those
    of files that it includes."""
    draft, first = file.draft(registry, context), file.parts[0].file
    if draft.tree is None:
        return Findings(listed(draft.mistakes, first, len(draft.mistakes) >= MOST_KEPT))
    found = check_tree(draft.tree, given)
    warnings = _in_order((*found.warnings, *draft.remarks), first)
    nodes = None if draft.mistakes else found.nodes
    return Findings(listed((*draft.mistakes, *found.errors), first), warnings, nodes, found.names_map)


def check_tree(tree: BehaviorTree, given: Iterable[str] = ()) -> Findings:
    """Check a tree that was built but not ticked. given: as of `check_file`."""
    outermost = {(id(tree.blackboard), name) for name in given}
    for _, name in outermost:
        tree.blackboard.declare(name)
    nodes = list(tree.nodes())
    reads, writes = all_uses(nodes)
    literals = {(id(board), name) for board in _boards(tree) for name in board} | outermost
    known = {use.home for use in writes} | literals
    real = {use.home for use in writes if not isinstance(use.node, Unbuilt)} | literals
    calls = {id(node.board): node for node in nodes if isinstance(node, SubTree)}
    errors = list(_unknown((use for use in reads if use.home not in known), real, calls))
    remarks = (*_unread(nodes, (*reads, *writes)), *_texts_in_order(nodes, writes))
    return Findings(_once(errors), _once(remarks), len(nodes), any(map(_names_map, nodes)))


def _names_map(node: TreeNode) -> bool:
    """Whether a port of the node names a ring or an opening."""
    of_map = (name for name, port in node.ports.items() if isinstance(port.choices, str))
    return any(not isinstance(node.values.get(name), Key | None) for name in of_map)


def reads_key(tree: BehaviorTree, name: str) -> bool:
    """Whether a tree reads an entry of its outermost scope."""
    reads, _ = all_uses(list(tree.nodes()))
    return any(use.home == (id(tree.blackboard), name) for use in reads)


def _boards(tree: BehaviorTree) -> Iterator[Blackboard]:
    yield tree.blackboard
    yield from (part.board for node in tree.nodes() for part in parts_of(node))


def _once(found: Iterable[TreeError]) -> tuple[TreeError, ...]:
    """Each remark once for its line. A tree that is used several times would repeat its remarks."""
    kept = dict[tuple[str, int | None, str], TreeError]()
    for error in found:
        kept.setdefault((str(error.file), error.line, error.problem), error)
    return tuple(kept.values())


def _in_order(found: Iterable[TreeError], first: Path | None) -> tuple[TreeError, ...]:
    """The errors sorted by file and line; those of the file `first` come first."""
    return tuple(sorted(found, key=lambda e: (e.file != first, str(e.file), e.line or 0)))


def listed(found: Iterable[TreeError], first: Path | None, given_up: bool = False) -> tuple[TreeError, ...]:
    """The first MOST mistakes in order, and the number of the others.

    first: the file whose mistakes come first
    given_up: whether there may be still more mistakes
    """
    errors = _in_order(found, first)
    beyond = len(errors) - MOST
    if beyond <= 0:
        return errors
    more = f"and {'at least ' * given_up}{beyond} more mistake{'s' * (beyond > 1)}"
    return *errors[:MOST], TreeError(more, file=first)


def _unknown(uses: Iterable[Use], known: set[Home], calls: Mapping[int, SubTree]) -> Iterator[TreeError]:
    """Errors for keys that nothing sets. The place of an error is one of these:
    - the SubTree that does not give the port, once,
    - the SubTree that gives the port such a key, once,
    - else each node that reads the key."""
    names, reported = dict[int, list[str]](), set[object]()
    for scope, name in sorted(known):
        names.setdefault(scope, []).append(name)
    for use in uses:
        scope, key = use.home
        missing, giving = calls.get(scope), use.given_by(calls)
        mistake = use.home if missing else (id(giving[0]), giving[1]) if giving else use
        if mistake in reported:
            continue
        reported.add(mistake)
        there = names.get(scope, ())
        enums = [*use.node.board.enums] if use.attribute in dict(scripts_of(use.node)) else []
        near = nearest(key, [*there, *enums])
        hint = (
            f"did you mean {near if near in enums else Key(near)}?"
            if near
            else f"set are {', '.join(there[:MOST_NAMES]) or 'none'}"
        )
        inside = f"inside, {use.node.name} reads {Key(use.name)}{use.at}"
        if missing is not None:
            slip = f"; or was {Key(near)} meant there?" if near else ""
            yield missing.wrong(f"{key} is missing: {inside}{slip}")
        elif giving is not None:
            yield giving[0].wrong(f"{giving[1]}: nothing sets {Key(key)}; {inside}; {hint}")
        else:
            outside = "" if key == use.name else f", which is {Key(key)} outside"
            yield use.node.wrong(f"{use.attribute}: nothing sets {Key(use.name)}{outside}; {hint}")


def _unread(nodes: Iterable[TreeNode], uses: Iterable[Use]) -> Iterator[TreeError]:
    """Remarks on ports that are given to a SubTree but that nothing in it reads or sets.

    A port that the SubTree gives on to another SubTree counts as used: the other SubTree has the remark."""
    calls = [node for node in nodes if isinstance(node, SubTree)]
    used = {(id(board), name) for use in uses for board, name in use.scope_chain}
    for call in calls:
        around = scope_of(call)
        keys = [value.name for value in call.values.values() if isinstance(value, Key)]
        used |= {(id(board), name) for key in keys for board, name in around.scope_chain(key)}
    for call in calls:
        tree = call.values.get("ID", call.name)
        for port in call.values:
            if port != "ID" and port not in call.by_model and (id(call.board), port) not in used:
                yield call.wrong(f"{port}: nothing in {tree} reads it")


def _texts_in_order(nodes: Iterable[TreeNode], writes: Iterable[Use]) -> Iterator[TreeError]:
    """Remarks on <, <=, > and >= between two entries that are texts of digits: "9" is above "10" then."""
    by_home = dict[Home, list[TreeNode]]()
    for use in writes:
        by_home.setdefault(use.home, []).append(use.node)

    def digits(node: TreeNode, name: str) -> str | None:
        board, there = [*scope_of(node).scope_chain(name)][-1]
        given = [writer.values.get("value") for writer in by_home.get((id(board), there), ())]  # None: no constant
        numbers = [text for text in given if isinstance(text, str) and number_of(text, {}) is not None]
        return numbers[0] if numbers and len(numbers) == len(given) else None

    for node in nodes:
        for attribute, script in scripts_of(node):
            for left, right in sorted(script.orders):
                a, b = digits(node, left), digits(node, right)
                if a is not None and b is not None:
                    yield node.wrong(
                        f"{attribute}: {left} and {right} are texts ({a!r}, {b!r}), so they compare letter by letter; "
                        f"for numbers, set them in a Script: {left} := {a}"
                    )
