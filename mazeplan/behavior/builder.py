"""Nodes from the elements of a behaviour tree's XML, with errors at the line.

Both forms of a node are taken: `<Track speed="1"/>` and `<Action ID="Track" speed="1"/>`. An attribute is a port, or
`name`; `{key}` refers to the blackboard, `{=}` to the key that is called as the port; or a pre- or postcondition
(`conditions`), as `_skipIf="legs &lt; 2"`.
"""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from mazeplan.behavior.blackboard import Blackboard
from mazeplan.behavior.builtin_leaves import BUILTIN_LEAVES
from mazeplan.behavior.conditions import CONDITIONS, Conditions
from mazeplan.behavior.controls import CONTROLS
from mazeplan.behavior.decorators import DECORATORS, SubTree
from mazeplan.behavior.leaf import Context
from mazeplan.behavior.node import Node, Place, TreeNode
from mazeplan.behavior.ports import REQUIRED, Key, Port, shown
from mazeplan.behavior.script import Scope, Script, ScriptError, parse_script
from mazeplan.behavior.tree import BehaviorTree
from mazeplan.core.errors import InputError, MazeplanError, TreeError
from mazeplan.core.file_format import advice
from mazeplan.core.user_modules import reason

MAX_DEPTH = 60  # nodes on one path, subtrees included
MAX_NODES = 5_000  # after subtrees are put in their places
MAX_NAME = 100  # characters of a node's name
EXPLICIT = ("Action", "Condition", "Control", "Decorator")
FORMAT = "4"  # BehaviorTree.CPP's own number
ROOT_ATTRIBUTES = ("BTCPP_format", "main_tree_to_execute", "project_name")
NOTES = ("_description", "_fullpath", "_uid")  # written into files by editors and loggers, without a meaning here
KEY = re.compile(r"\{(@?[A-Za-z_][A-Za-z0-9_.]*)\}")
BRACED = re.compile(r"\{.*\}", re.DOTALL)
WHOLE = re.compile(r"-?[0-9]{1,18}")
REAL = re.compile(r"-?[0-9]+(\.[0-9]*)?([eE][+-]?[0-9]+)?")
FORBIDDEN = frozenset(" \t\n\r<>&\"'/\\:*?|.")  # in names of trees and nodes, for the tools that read the files
BUILTIN: dict[str, type[TreeNode]] = {**CONTROLS, **DECORATORS, **BUILTIN_LEAVES}
SCRIPTS = {"Script": ("code",), "ScriptCondition": ("code",), "Precondition": ("if",)}  # ports that are scripts

ELSEWHERE = {
    **dict.fromkeys(("SequenceStar", "PopFromQueue", "ConsumeQueue", "SubTreePlus"), "BehaviorTree.CPP"),
    **dict.fromkeys(
        ("PipelineSequence", "RecoveryNode", "RoundRobin", "RateController", "DistanceController", "SpeedController",
         "GoalUpdater", "PathLongerOnApproach", "SingleTrigger", "GoalUpdated", "ComputePathToPose", "FollowPath",
         "ComputePathThroughPoses", "ClearEntireCostmap", "Spin", "BackUp", "Wait", "DriveOnHeading", "NavigateToPose"),
        "Nav2",
    ),
}  # fmt: skip

AUTOREMAP = Port(bool, False, "whether keys of the same name are those outside")

Element = Any  # lxml's element class is not public


@dataclass(frozen=True)
class Part:
    """The root element of one file."""

    root: Element
    file: Path


def bad_name(name: str) -> str | None:
    """What is wrong with the name of a tree or of a kind of node; None: nothing."""
    if name in ("Root", "root"):
        return "which is reserved; expected another name"
    wrong = next((c for c in name if c in FORBIDDEN or not c.isprintable()), None)
    return None if wrong is None else f"expected a name without {wrong!r}"


def _format_problem(given: str | None) -> str:
    """Why a tree with this BTCPP_format cannot be read."""
    problem = f"got {shown(given)}, expected '{FORMAT}'"
    if given is None or not WHOLE.fullmatch(given) or int(given) <= int(FORMAT):
        return problem
    return problem + advice(None)


def one_line(text: str, most: int = 600) -> str:
    """Text for an error: one line, nothing that a terminal would obey, not endless."""
    clean = "".join(c if c.isprintable() else ascii(c)[1:-1] for c in text[: most + 1])
    return clean if len(clean) <= most else f"{clean[: most - 3]}..."


class Builder:
    """Builds nodes from the elements of a file and those that it includes."""

    def __init__(self, parts: Sequence[Part], registry: Mapping[str, type[TreeNode]], context: Context) -> None:
        self._registry, self._context, self._parts, self._count = registry, context, parts, 0
        self._of = {id(part.root): part.file for part in parts}
        self._trees: dict[str, Element] = {}
        self._models: dict[str, dict[str, str | None]] = {}
        for part in parts:
            self._read_part(part.root)
        if not self._trees:
            raise self.error(parts[0].root, "", "no <BehaviorTree> in it")

    def _read_part(self, root: Element) -> None:
        if root.tag != "root":
            raise self.error(root, "", f'got <{root.tag}>, expected <root BTCPP_format="4">')
        if root.get("BTCPP_format") != FORMAT:
            raise self.error(root, "", f"BTCPP_format: {_format_problem(root.get('BTCPP_format'))}")
        self._known(root, "", ROOT_ATTRIBUTES)
        for element in root:
            self._top(element)

    def error(self, element: Element, path: str, problem: str) -> TreeError:
        """The error at an element; `path` is the way to it through the tree."""
        path = path if len(path) <= 200 else f"...{path[-197:]}"
        return TreeError(
            one_line(problem), file=self._where(element), line=element.sourceline, key=one_line(path) or None
        )

    def _where(self, element: Element) -> Path:
        """The file in which an element stands."""
        return self._of[id(element.getroottree().getroot())]

    def _known(self, element: Element, path: str, allowed: Iterable[str]) -> None:
        """Refuse other attributes than these; those of another namespace and NOTES mean nothing here."""
        for attribute in map(str, element.attrib):
            if attribute not in (*allowed, *NOTES) and not attribute.startswith("{"):
                problem = f"unknown attribute {shown(attribute)}, expected one of {', '.join(allowed)}"
                raise self.error(element, path, problem)

    def _top(self, element: Element) -> None:
        if element.tag == "TreeNodesModel":
            for model in element.iterchildren("SubTree"):
                self._model(model)
            return
        if element.tag == "include":
            return
        if element.tag != "BehaviorTree":
            raise self.error(
                element, "", f"got <{element.tag}>, expected <BehaviorTree>, <include> or <TreeNodesModel>"
            )
        name = element.get("ID")
        if not name and len(element.getparent().findall("BehaviorTree")) > 1:
            raise self.error(element, "", "<BehaviorTree> without ID, in a file with more than one")
        name = name or "BehaviorTree"
        if (problem := bad_name(name)) is not None:
            raise self.error(element, "", f"ID: got {shown(name)}, {problem}")
        if name in BUILTIN or name in self._registry:
            raise self.error(element, "", f"ID: got {shown(name)}, which is the name of a node")
        if name in self._trees:
            first = self._trees[name]
            raise self.error(
                element, name, f"a second tree of this name; the first is at {self._where(first)}:{first.sourceline}"
            )
        self._known(element, name, ("ID",))
        self._trees[name] = element

    def _model(self, model: Element) -> None:
        """The ports of a SubTree: {name: default}; one without a default has to be given."""
        ports = self._models.setdefault(str(model.get("ID", "")), {})
        for port in model.iterchildren("input_port", "output_port", "inout_port"):
            name = port.get("name")
            if not name:
                raise self.error(port, "TreeNodesModel", f"<{port.tag}> without name")
            ports[name] = port.get("default") or None

    def build(self, main: str | None) -> BehaviorTree:
        """The tree `main`, the file's main one, or its only one."""
        root = self._parts[0].root
        name = main or root.get("main_tree_to_execute")
        if name is None:
            if len(self._trees) > 1:
                raise self.error(root, "", "main_tree_to_execute is missing, and there is more than one tree")
            name = next(iter(self._trees))
        if name not in self._trees:
            raise self.error(root, "", f"main tree: got {shown(name)}, expected one of {', '.join(self._trees)}")
        enums = getattr(self._registry, "enums", None)
        for other in self._trees:  # trees that are not used are checked all the same
            if other != name:
                self._content(other, Blackboard(enums=enums), other, (other,))
        self._count = 0
        board = Blackboard(enums=enums)
        content = self._content(name, board, name, (name,))
        return BehaviorTree(content, board, name, getattr(self._context, "again", None))

    def _content(self, tree: str, board: Blackboard, path: str, within: tuple[str, ...]) -> TreeNode:
        element = self._trees[tree]
        if len(element) != 1:
            raise self.error(element, path, f"a tree has exactly one root node, got {len(element)}")
        return self._node(element[0], board, path, within)

    def _node(self, element: Element, board: Blackboard, above: str, within: tuple[str, ...]) -> TreeNode:
        kind, attributes = self._kind(element, above)
        name = attributes.pop("name", "") or (attributes.get("ID", "") if kind == "SubTree" else kind)
        if len(name) > MAX_NAME or not name.isprintable():
            raise self.error(
                element, above, f"name: got {shown(name)}, expected at most {MAX_NAME} printing characters"
            )
        path = f"{above}/{name}"
        self._count += 1
        if path.count("/") > MAX_DEPTH or self._count > MAX_NODES:
            raise self.error(element, above, f"more than {MAX_DEPTH} levels or {MAX_NODES} nodes")
        conditions = self._conditions(element, path, attributes, board)
        if kind == "SubTree":
            node: TreeNode = self._subtree(element, name, attributes, board, path, within)
        elif issubclass(node_class := self._class(element, path, kind, above), Node):
            values = self._values(element, path, kind, node_class.ports, attributes, board)
            self._check_children(element, path, node_class, values)
            children = [self._node(child, board, path, within) for child in element]
            node = node_class(name, children, self._context.clock, board, values)
        else:
            leaf: Any = node_class
            if len(element):
                raise self.error(element, path, f"{kind} is a leaf and has no children")
            values = self._values(element, path, kind, leaf.ports, attributes, board)
            try:
                node = leaf(name, self._context, board, values)
            except MazeplanError:
                raise
            except (Exception, SystemExit) as problem:  # a user's own `__init__` may raise anything
                raise self.error(element, path, f"{kind} could not be made: {reason(problem)}") from problem
            if "_board" not in vars(node):
                call = "super().__init__(name, context, board, values)"
                raise self.error(element, path, f"{kind} could not be made: its __init__ does not call {call}")
        node.place, node.conditions = Place(self._where(element), element.sourceline, path), conditions
        return node

    def _class(self, element: Element, path: str, kind: str, above: str) -> type[TreeNode]:
        """The class of a node. Raises TreeError for a name that nobody knows."""
        if kind in BUILTIN:
            return BUILTIN[kind]
        try:
            if kind in self._registry:
                return self._registry[kind]
        except InputError as problem:  # of an installed package that is broken
            raise self.error(element, path, problem.problem) from None
        raise self.error(element, above, f"unknown node {shown(kind)}{self._suggest(kind)}")

    def _kind(self, element: Element, above: str) -> tuple[str, dict[str, str]]:
        """(kind of node, its attributes but for the ID of the explicit form and what editors note)."""
        attributes = {str(key): str(value) for key, value in element.attrib.items() if key not in NOTES}
        if element.tag not in EXPLICIT:
            return str(element.tag), attributes
        kind = attributes.pop("ID", "")
        if not kind:
            raise self.error(element, above, f"<{element.tag}> without ID")
        known = BUILTIN.get(kind) or (self._class(element, above, kind, above) if kind in self._registry else None)
        if known is not None:
            real = known.category
            if element.tag != real and {element.tag, real} != {"Action", "Condition"}:
                raise self.error(element, above, f'got <{element.tag} ID="{kind}">, expected <{real} ID="{kind}">')
        return kind, attributes

    def _conditions(
        self, element: Element, path: str, attributes: dict[str, str], board: Blackboard
    ) -> Conditions | None:
        """The pre- and postconditions among the attributes, which are taken out; most nodes have none."""
        given = {}
        for name in CONDITIONS:
            if name in attributes:
                given[name] = self._script(element, path, name, attributes.pop(name))
        return Conditions(given, Scope(board)) if given else None

    def _script(self, element: Element, path: str, name: str, text: str) -> Script:
        try:
            return parse_script(text)
        except ScriptError as problem:
            raise self.error(element, path, f"{name}: {problem}") from None

    def _suggest(self, kind: str) -> str:
        if kind in ELSEWHERE:
            return f": a node of {ELSEWHERE[kind]} that mazeplan lacks; a leaf of your own can take its place"
        known = ["SubTree", *BUILTIN, *self._registry]
        near = difflib.get_close_matches(kind, known, 1)
        return f"; did you mean {near[0]}?" if near else f", expected one of {', '.join(known)}, or a leaf of yours"

    def _check_children(self, element: Element, path: str, node: type[Node], values: Mapping[str, Any]) -> None:
        n = len(element)
        if n < node.least or (node.most is not None and n > node.most):
            expected = f"at least {node.least}" if node.most is None else f"{node.least} or {node.most}"
            expected = f"exactly {node.least}" if node.most == node.least else expected
            raise self.error(element, path, f"{node.__name__}: got {n} children, expected {expected}")
        problem = node.problem(values, n)
        if problem:
            raise self.error(element, path, problem)

    def _key(self, element: Element, path: str, attribute: str, text: str) -> Key | None:
        """The key that {key} or {=} stands for; None for a literal."""
        text = text.strip()
        if not BRACED.fullmatch(text):
            return None
        key = KEY.fullmatch(text)
        if not key and text != "{=}":
            allowed = "{key} of letters, digits, _ and ., or {=}"
            raise self.error(element, path, f"{attribute}: got {shown(text)}, expected {allowed}")
        return Key(key.group(1) if key else attribute)

    def _values(
        self,
        element: Element,
        path: str,
        kind: str,
        ports: Mapping[str, Port],
        attributes: Mapping[str, str],
        board: Blackboard,
    ) -> dict[str, Any]:
        """{port: literal or Key}, checked; of the blackboard, only the literals given to a SubTree are known yet."""
        values: dict[str, Any] = {}
        own = ("name", *ports, *(("ID",) if element.tag in EXPLICIT else ()))
        self._known(element, path, (*own, *CONDITIONS))
        for attribute, text in attributes.items():
            if attribute not in ports:  # of another namespace
                continue
            port, key = ports[attribute], self._key(element, path, attribute, text)
            if key is None and port.direction == "out":
                example = f"a blackboard entry such as {{{attribute}}}"
                raise self.error(element, path, f"{attribute}: got {shown(text)}, expected {example}")
            given = text
            try:
                if key is None:
                    values[attribute] = port.parse(text, self._context)
                    if attribute in SCRIPTS.get(kind, ()):
                        self._script(element, path, attribute, text)
                    continue
                values[attribute] = key
                board.declare(key.name).named_by(port.type)
                if port.direction != "out" and key.name in board:
                    given = board.get(key.name)
                    port.accept(given, self._context)
            except (ValueError, OverflowError):
                source = f" from {{{key.name}}}" if key else ""
                problem = f"{attribute}: got {shown(given)}{source}, expected {port.expects(self._context)}"
                raise self.error(element, path, problem) from None
        for name, port in ports.items():
            if port.default is REQUIRED and name not in values:
                raise self.error(element, path, f"{name} is missing ({port.doc})")
        return values

    def _subtree(
        self,
        element: Element,
        name: str,
        attributes: dict[str, str],
        board: Blackboard,
        path: str,
        within: tuple[str, ...],
    ) -> SubTree:
        """A SubTree with its scope: {key} is remapped, anything else is a literal of the scope."""
        tree = attributes.pop("ID", "")
        if tree not in self._trees:
            raise self.error(element, path, f"SubTree: got {shown(tree)}, expected one of {', '.join(self._trees)}")
        if tree in within:
            raise self.error(element, path, f"{tree} contains itself: {' > '.join((*within, tree))}")
        if len(element):
            raise self.error(element, path, "a SubTree has no children: what it does stands in its <BehaviorTree>")
        try:
            autoremap = AUTOREMAP.parse(attributes.pop("_autoremap", "false"))
        except ValueError:
            problem = f"_autoremap: got {shown(element.get('_autoremap'))}, expected {AUTOREMAP.expected}"
            raise self.error(element, path, problem) from None
        given = self._given(element, path, attributes, {} if autoremap else self._models.get(tree, {}))
        remap = {port: value.name for port, value in given.items() if isinstance(value, Key)}
        literals = {port: value for port, value in given.items() if not isinstance(value, Key)}
        for key in remap.values():
            board.declare(key)
        scope = Blackboard(board, remap, literals, autoremap=autoremap)
        inside = self._content(tree, scope, path, (*within, tree))
        return SubTree(name, [inside], self._context.clock, scope, {**({"ID": tree} if tree != name else {}), **given})

    def _given(
        self, element: Element, path: str, attributes: Mapping[str, str], model: Mapping[str, str | None]
    ) -> dict[str, Any]:
        """What a SubTree is given: {port: Key or literal}, with the defaults of its model."""
        given: dict[str, Any] = {}
        for port, text in attributes.items():
            if port.startswith("_"):
                expected = f"ID, name, _autoremap, {', '.join(CONDITIONS)} or names of the tree's keys"
                raise self.error(element, path, f"unknown attribute {shown(port)}, expected {expected}")
            given[port] = self._key(element, path, port, text) or _literal(text)
        for port, default in model.items():
            if port in given:
                continue
            if default is None:
                raise self.error(element, path, f"{port} is missing, which its model in TreeNodesModel asks for")
            given[port] = self._key(element, path, port, default) or _literal(default)
        return given


def _literal(text: str) -> int | float | str:
    """A literal for a SubTree: a number where it reads like one, so that scripts can count with it."""
    if WHOLE.fullmatch(text):
        return int(text)
    return float(text) if REAL.fullmatch(text) else text
