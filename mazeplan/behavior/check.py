"""What a look at a tree finds before anything moves: keys that nobody sets, ports that nobody reads, branches that no
tick reaches, trees that nobody uses."""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

from mazeplan.behavior.blackboard import Blackboard
from mazeplan.behavior.decorators import SubTree
from mazeplan.behavior.leaf import Context
from mazeplan.behavior.mistakes import MOST, Unbuilt
from mazeplan.behavior.never_ticked import never_ticked
from mazeplan.behavior.node import TreeNode
from mazeplan.behavior.ports import Key
from mazeplan.behavior.script import Script, parse_script
from mazeplan.behavior.script_values import ScriptError
from mazeplan.behavior.tree import BehaviorTree, parts_of
from mazeplan.behavior.treefile import read_tree
from mazeplan.core.errors import TreeError

SET_BY_THE_RUN = ("goal", "waypoints")  # on the outermost scope, before the first tick
SCRIPTS = {"Script": "code", "ScriptCondition": "code", "Precondition": "if"}  # ports that hold a script
NAMES = {"SkipUnlessUpdated": "entry", "WaitValueUpdate": "entry", "WasEntryUpdated": "entry"}  # literals that are keys

Home = tuple[int, str]  # a scope and the name of an entry there


@dataclass(frozen=True)
class Findings:
    """errors: what is refused, or fails when it is ticked; warnings: what does no harm, and nothing else either. nodes:
    how many the tree has; None where it cannot be built."""

    errors: tuple[TreeError, ...] = ()
    warnings: tuple[TreeError, ...] = ()
    nodes: int | None = None


@dataclass(frozen=True)
class _Use:
    """A node uses a key: through which attribute, by which name, and the scopes from its own one to that of the key."""

    node: TreeNode
    attribute: str
    name: str
    way: tuple[tuple[Blackboard, str], ...]

    @property
    def home(self) -> Home:
        """Where the key stands."""
        board, name = self.way[-1]
        return id(board), name


def check_file(source: str | Path, registry: Mapping[str, type[TreeNode]], context: Context) -> Findings:
    """Look at a file, the packaged tree of that name, or XML text, with the first mistakes that it has (`MOST`).

    Raises TreeError where it cannot be read at all."""
    draft = read_tree(source).draft(registry, context)
    if draft.tree is None:
        return Findings(draft.mistakes)
    found = check_tree(draft.tree)
    errors = _in_order((*draft.mistakes, *found.errors))[:MOST]
    return Findings(errors, _in_order((*found.warnings, *draft.unused)), None if draft.mistakes else found.nodes)


def check_tree(tree: BehaviorTree) -> Findings:
    """Look at a tree that was built and not ticked."""
    for name in SET_BY_THE_RUN:
        tree.blackboard.declare(name)
    nodes = list(tree.nodes())
    reads, writes = _all_uses(nodes)
    given = {(id(board), name) for board in _boards(tree) for name in board}
    known = {use.home for use in writes} | given | {(id(tree.blackboard), name) for name in SET_BY_THE_RUN}
    calls = {id(node.board): node for node in nodes if isinstance(node, SubTree)}
    missing = _first_reads([use for use in reads if use.home not in known], calls)
    errors = [_unknown(use, known, calls.get(use.home[0])) for use in missing]
    warnings = [*never_ticked(tree.root), *_unread(nodes, (*reads, *writes)), *_hidden(nodes)]
    return Findings(_once(errors), _once(warnings), len(nodes))


def refuse_mistakes(tree: BehaviorTree) -> None:
    """Raises TreeError for the first error that `check_tree` finds; the error holds the others."""
    errors = check_tree(tree).errors[:MOST]
    if errors:
        errors[0].others = errors[1:]
        raise errors[0]


def reads_key(tree: BehaviorTree, name: str) -> bool:
    """Whether a tree reads an entry of its outermost scope."""
    reads, _ = _all_uses(list(tree.nodes()))
    return any(use.home == (id(tree.blackboard), name) for use in reads)


def _all_uses(nodes: Iterable[TreeNode]) -> tuple[list[_Use], list[_Use]]:
    """What nodes read, and what they set."""
    reads, writes = list[_Use](), list[_Use]()
    for node in nodes:
        for attribute, name, written in _uses(node):
            use = _Use(node, attribute, name, tuple(_scope(node).way(name)))
            (writes if written else reads).append(use)
    return reads, writes


def _scope(node: TreeNode) -> Blackboard:
    """The blackboard on which the attributes of a node stand: for a SubTree that around it."""
    outside = node.board.outside if isinstance(node, SubTree) else None
    return node.board if outside is None else outside


def _boards(tree: BehaviorTree) -> Iterator[Blackboard]:
    yield tree.blackboard
    yield from (part.board for node in tree.nodes() for part in parts_of(node))


def _once(found: Iterable[TreeError]) -> tuple[TreeError, ...]:
    """Each remark once at its line: a tree that is used again has them again."""
    kept = dict[tuple[str, int | None, str], TreeError]()
    for error in found:
        kept.setdefault((str(error.file), error.line, error.problem), error)
    return tuple(kept.values())


def _in_order(found: Iterable[TreeError]) -> tuple[TreeError, ...]:
    """By file and line."""
    return tuple(sorted(found, key=lambda e: (str(e.file), e.line or 0)))


def _first_reads(uses: Iterable[_Use], calls: Mapping[int, SubTree]) -> list[_Use]:
    """Of uses whose key a SubTree does not give the first one of each key: they have one mistake in common."""
    kept = dict[object, _Use]()
    for use in uses:
        kept.setdefault(use.home if use.home[0] in calls else id(use), use)
    return list(kept.values())


def _unknown(use: _Use, known: set[Home], call: SubTree | None) -> TreeError:
    """The error for a key that nobody sets: at the SubTree that does not give it, or at the node that reads it."""
    scope, key = use.home
    names = sorted({name for board, name in known if board == scope})
    near = difflib.get_close_matches(key, names, 1)
    if call is not None:
        where = use.node.place
        at = "" if where is None else f" at {where.file.name}:{where.line}"
        hint = f"; or was {{{near[0]}}} meant there?" if near else ""
        return call.wrong(f"{key} is missing: inside, {use.node.name} reads {{{use.name}}}{at}{hint}")
    hint = f"did you mean {{{near[0]}}}?" if near else f"set are {', '.join(names) or 'none'}"
    inner = "" if key == use.name else f", which is {{{key}}} outside"
    return use.node.wrong(f"{use.attribute}: nothing sets {{{use.name}}}{inner}; {hint}")


def _unread(nodes: Iterable[TreeNode], uses: Iterable[_Use]) -> Iterator[TreeError]:
    """Ports that are given to a SubTree, and that nothing in it reads or sets. What it gives on to another one counts
    as used: there it has a remark of its own."""
    calls = [node for node in nodes if isinstance(node, SubTree)]
    used = {(id(board), name) for use in uses for board, name in use.way}
    for call in calls:
        around = _scope(call)
        keys = [value.name for value in call.values.values() if isinstance(value, Key)]
        used |= {(id(board), name) for key in keys for board, name in around.way(key)}
    for call in calls:
        tree = call.values.get("ID", call.name)
        for port in call.values:
            if port != "ID" and port not in call.by_model and (id(call.board), port) not in used:
                yield call.wrong(f"{port}: nothing in {tree} reads it")


def _hidden(nodes: Iterable[TreeNode]) -> Iterator[TreeError]:
    """Scripts that set a key which they cannot read: it has the name of an enum."""
    for node in nodes:
        enums = node.board.enums
        for attribute, script in _scripts(node):
            for name in sorted(script.sets & set(enums)):
                yield node.wrong(f"{attribute}: sets {name}, but scripts read the enum of that name, {enums[name]}")


def _scripts(node: TreeNode) -> Iterator[tuple[str, Script]]:
    """The scripts of a node, by attribute."""
    port = SCRIPTS.get(type(node).__name__)
    text = None if port is None else node.values.get(port)
    script = _parsed(text) if isinstance(text, str) else None
    if port is not None and script is not None:
        yield port, script
    if node.conditions is not None:
        yield from node.conditions.given.items()


def _parsed(text: str) -> Script | None:
    try:
        return parse_script(text)
    except ScriptError:  # refused where it stands as a literal
        return None


def _uses(node: TreeNode) -> Iterator[tuple[str, str, bool]]:
    """(attribute, key, whether it is set) of what a node reads and sets."""
    if isinstance(node, Unbuilt):
        yield from (("", word, True) for word in sorted(node.words))
        return
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
    for attribute, script in _scripts(node):
        yield from ((attribute, name, True) for name in sorted(script.writes))
        yield from ((attribute, name, False) for name in sorted(script.reads - set(node.board.enums) - script.writes))
