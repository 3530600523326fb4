"""Checks a tree before anything moves. Finds keys that nothing sets, ports that nothing reads, branches that no tick
reaches, and trees that nothing uses."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from mazeplan.behavior.blackboard import Blackboard
from mazeplan.behavior.builtin_leaves import ScriptCondition
from mazeplan.behavior.check_values import read_before_set, wrong_constants
from mazeplan.behavior.conditions import DECISIONS
from mazeplan.behavior.decorators import Precondition, SubTree
from mazeplan.behavior.key_uses import Home, Use, all_uses, scope_of, scripts_of
from mazeplan.behavior.leaf import Context
from mazeplan.behavior.mistakes import MOST, MOST_KEPT, Unbuilt
from mazeplan.behavior.never_ticked import never_ticked
from mazeplan.behavior.node import TreeNode
from mazeplan.behavior.ports import Key, shown
from mazeplan.behavior.tree import BehaviorTree, parts_of
from mazeplan.behavior.treefile import read_tree
from mazeplan.core.errors import TreeError
from mazeplan.core.name_hints import nearest
from mazeplan.maze.geometry import Maze

MOST_NAMES = 200  # maximum number of names in a message
OPERATORS = {word: f"the sign for {word} is {sign}" for word, sign in (("and", "&&"), ("or", "||"), ("not", "!"))}
SET_BY_THE_RUN = ("goal", "waypoints")  # keys that the run sets in the outermost scope, before the first tick


class StaticContext:
    """Context of a tree that never runs. maze: its rings and openings may be named in the tree; None: any names."""

    def __init__(self, maze: Maze | None = None) -> None:
        if maze is not None:
            self.maze = maze

    def clock(self) -> float:
        """Always 0: the time of a tree that does not run, s."""
        return 0.0

    def failed(self, failure: Any) -> None:
        """Ignore the failure."""


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


def check_file(source: str | Path, registry: Mapping[str, type[TreeNode]], context: Context) -> Findings:
    """Check a file, the packaged tree of that name, or XML text.

    Of many errors it lists the first `MOST` and the number of the others. Mistakes of the file itself come before those
    of files that it includes. Raises TreeError if the file cannot be read at all."""
    file = read_tree(source)
    draft, first = file.draft(registry, context), file.parts[0].file
    if draft.tree is None:
        return Findings(_told(draft.mistakes, first, len(draft.mistakes) >= MOST_KEPT))
    found = check_tree(draft.tree)
    warnings = _in_order((*found.warnings, *draft.remarks), first)
    nodes = None if draft.mistakes else found.nodes
    return Findings(_told((*draft.mistakes, *found.errors), first), warnings, nodes, found.names_map)


def check_tree(tree: BehaviorTree) -> Findings:
    """Check a tree that was built but not ticked."""
    for name in SET_BY_THE_RUN:
        tree.blackboard.declare(name)
    nodes = list(tree.nodes())
    reads, writes = all_uses(nodes)
    given = {(id(board), name) for board in _boards(tree) for name in board}
    given |= {(id(tree.blackboard), name) for name in SET_BY_THE_RUN}
    known = {use.home for use in writes} | given
    real = {use.home for use in writes if not isinstance(use.node, Unbuilt)} | given
    calls = {id(node.board): node for node in nodes if isinstance(node, SubTree)}
    errors = list(_unknown((use for use in reads if use.home not in known), real, calls))
    wrong, doubtful = wrong_constants(reads, writes, given)
    warnings = [*never_ticked(tree.root), *_unread(nodes, (*reads, *writes)), *_doubtful_scripts(nodes)]
    warnings += [*doubtful, *read_before_set(reads, writes, given)]
    return Findings(_once((*errors, *wrong)), _once(warnings), len(nodes), any(map(_names_map, nodes)))


def _names_map(node: TreeNode) -> bool:
    """Whether a port of the node names a ring or an opening."""
    of_map = (name for name, port in node.ports.items() if isinstance(port.choices, str))
    return any(not isinstance(node.values.get(name), Key | None) for name in of_map)


def refuse_mistakes(tree: BehaviorTree) -> None:
    """Raises TreeError for the first error that `check_tree` finds; the error holds the others."""
    errors = _told(check_tree(tree).errors, None if tree.root.place is None else tree.root.place.file)
    if errors:
        errors[0].others = errors[1:]
        raise errors[0]


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


def _told(found: Iterable[TreeError], first: Path | None, given_up: bool = False) -> tuple[TreeError, ...]:
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
            else OPERATORS.get(key) or f"set are {', '.join(there[:MOST_NAMES]) or 'none'}"
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


def _doubtful_scripts(nodes: Iterable[TreeNode]) -> Iterator[TreeError]:
    """Remarks on doubtful scripts: a script sets a key that it cannot read, because an enum has the same name; a
    condition sets a key; a statement has no effect."""
    for node in nodes:
        enums = node.board.enums
        for attribute, script in scripts_of(node):
            for name in sorted(script.sets & set(enums)):
                yield node.wrong(f"{attribute}: sets {name}, but scripts read the enum of that name, {enums[name]}")
            asks = attribute in DECISIONS or isinstance(node, ScriptCondition | Precondition)
            if script.assigned and asks:
                name, sign = script.assigned
                yield node.wrong(f"{attribute}: {sign} sets {name}; did you mean ==?")
            if script.idle:
                yield node.wrong(f"{attribute}: nothing uses the value of {shown(script.idle)}; is && or := missing?")
            elif not (asks or script.sets):
                yield node.wrong(f"{attribute}: sets nothing; did you mean :=?")
