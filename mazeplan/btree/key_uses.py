"""Which nodes of a tree read and set which keys, and to which scopes the keys belong."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import lru_cache

from mazeplan.btree.blackboard import Blackboard
from mazeplan.btree.decorators import SubTree
from mazeplan.btree.mistakes import Unbuilt
from mazeplan.btree.node import TreeNode
from mazeplan.btree.ports import Key
from mazeplan.btree.script import Script, parse_script
from mazeplan.btree.script_values import ScriptError

SCRIPTS = {"Script": "code", "ScriptCondition": "code", "Precondition": "if"}  # ports that hold a script
NAMES = {"SkipUnlessUpdated": "entry", "WaitValueUpdate": "entry", "WasEntryUpdated": "entry"}  # literals name keys

Home = tuple[int, str]  # id of a scope, and the name of an entry there


@dataclass(frozen=True)
class Use:
    """A node uses a key.

    attribute: through which the node uses the key
    name: of the key at the node
    way: (scope, name there) from the node's scope to the scope to which the key belongs
    """

    node: TreeNode
    attribute: str
    name: str
    scope_chain: tuple[tuple[Blackboard, str], ...]

    @property
    def home(self) -> Home:
        """The scope to which the key belongs, and its name there."""
        board, name = self.scope_chain[-1]
        return id(board), name

    @property
    def at(self) -> str:
        """File and line of the node, for an error at another node."""
        place = self.node.place
        return "" if place is None else f" at {place.file.name}:{place.line}"

    def given_by(self, calls: Mapping[int, SubTree]) -> tuple[SubTree, str] | None:
        """The outermost SubTree on the way to the key that has a port for it, and the port. calls: SubTrees by id of
        their scope."""
        for board, name in reversed(self.scope_chain[:-1]):
            call = calls.get(id(board))
            if call is not None and isinstance(call.values.get(name), Key):
                return call, name
        return None


def all_uses(nodes: Iterable[TreeNode]) -> tuple[list[Use], list[Use]]:
    """(reads, writes): all uses of keys by the nodes."""
    reads, writes = list[Use](), list[Use]()
    for node in nodes:
        for attribute, name, written in _uses(node):
            use = Use(node, attribute, name, tuple(scope_of(node).scope_chain(name)))
            (writes if written else reads).append(use)
    return reads, writes


def scope_of(node: TreeNode) -> Blackboard:
    """The scope of a node's attributes; for a SubTree, the scope around it."""
    outside = node.board.outside if isinstance(node, SubTree) else None
    return node.board if outside is None else outside


def scripts_of(node: TreeNode) -> Iterator[tuple[str, Script]]:
    """The scripts of a node, by attribute."""
    port = SCRIPTS.get(type(node).__name__)
    text = None if port is None else node.values.get(port)
    script = _parsed(text) if isinstance(text, str) else None
    if port is not None and script is not None:
        yield port, script
    if node.conditions is not None:
        yield from node.conditions.given.items()


@lru_cache(maxsize=1000)
def _parsed(text: str) -> Script | None:
    try:
        return parse_script(text)
    except ScriptError:  # the builder refuses a literal that is no script
        return None


def _uses(node: TreeNode) -> Iterator[tuple[str, str, bool]]:
    """(attribute, key, whether the node sets the key) of all keys that a node reads or sets."""
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
    for attribute, script in scripts_of(node):
        yield from ((attribute, name, True) for name in sorted(script.writes))
        read = (script.reads - script.writes) | script.needs
        yield from ((attribute, name, False) for name in sorted(read - set(node.board.enums)))
