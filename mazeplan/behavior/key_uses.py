"""Which nodes of a tree read and set which keys, and where those keys stand."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import lru_cache

from mazeplan.behavior.blackboard import Blackboard
from mazeplan.behavior.decorators import SubTree
from mazeplan.behavior.mistakes import Unbuilt
from mazeplan.behavior.node import TreeNode
from mazeplan.behavior.ports import Key
from mazeplan.behavior.script import Script, parse_script
from mazeplan.behavior.script_values import ScriptError

SCRIPTS = {"Script": "code", "ScriptCondition": "code", "Precondition": "if"}  # ports that hold a script
NAMES = {"SkipUnlessUpdated": "entry", "WaitValueUpdate": "entry", "WasEntryUpdated": "entry"}  # literals that are keys

Home = tuple[int, str]  # a scope and the name of an entry there


@dataclass(frozen=True)
class Use:
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

    @property
    def at(self) -> str:
        """Where the node stands, for an error elsewhere."""
        place = self.node.place
        return "" if place is None else f" at {place.file.name}:{place.line}"

    def given_by(self, calls: Mapping[int, SubTree]) -> tuple[SubTree, str] | None:
        """The outermost SubTree on the way to the key that has a port for it, and the port; calls: by their scopes."""
        for board, name in reversed(self.way[:-1]):
            call = calls.get(id(board))
            if call is not None and isinstance(call.values.get(name), Key):
                return call, name
        return None


def all_uses(nodes: Iterable[TreeNode]) -> tuple[list[Use], list[Use]]:
    """What nodes read, and what they set."""
    reads, writes = list[Use](), list[Use]()
    for node in nodes:
        for attribute, name, written in _uses(node):
            use = Use(node, attribute, name, tuple(scope_of(node).way(name)))
            (writes if written else reads).append(use)
    return reads, writes


def scope_of(node: TreeNode) -> Blackboard:
    """The blackboard on which the attributes of a node stand: for a SubTree that around it."""
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
    for attribute, script in scripts_of(node):
        yield from ((attribute, name, True) for name in sorted(script.writes))
        read = (script.reads - script.writes) | script.needs
        yield from ((attribute, name, False) for name in sorted(read - set(node.board.enums)))
