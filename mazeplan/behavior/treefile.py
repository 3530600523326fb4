"""Behaviour trees from XML files in BehaviorTree.CPP version 4 format, with errors at the line.

Read by lxml without DTD, entities or network, after a look at the size; nothing in a file is ever executed. Both
forms of a node are taken: `<Track speed="1"/>` and `<Action ID="Track" speed="1"/>`. An attribute is a port, or `name`;
`{key}` refers to the blackboard, `{=}` to the key that is called as the port; or a precondition (`conditions`), as
`_skipIf="legs &lt; 2"`.
"""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from lxml import etree  # pyright: ignore[reportAttributeAccessIssue]  # compiled, without stubs

from mazeplan import filekinds, resources
from mazeplan.behavior.blackboard import Blackboard
from mazeplan.behavior.conditions import DECISIONS, Conditions
from mazeplan.behavior.decorators import DECORATORS, SubTree
from mazeplan.behavior.expression import ExpressionError, parse_expression
from mazeplan.behavior.leaf import REQUIRED, Context, Key, Leaf, Place, Port, TreeNode, shown
from mazeplan.behavior.nodes import CONTROLS, Node
from mazeplan.behavior.tree import BehaviorTree
from mazeplan.errors import InputError, MazeplanError, TreeError
from mazeplan.usermodule import reason

MAX_BYTES = 1 << 20
MAX_DEPTH = 60  # nodes on one path, subtrees included
MAX_NODES = 5_000  # after subtrees are put in their places
MAX_NAME = 100  # characters of a node's name
EXPLICIT = ("Action", "Condition", "Control", "Decorator")
ROOT_ATTRIBUTES = ("BTCPP_format", "main_tree_to_execute", "project_name")
NOTES = ("_description", "_fullpath", "_uid")  # written into files by editors and loggers, without a meaning here
KEY = re.compile(r"\{([A-Za-z_][A-Za-z0-9_.]*)\}")
BRACED = re.compile(r"\{.*\}", re.DOTALL)

AUTOREMAP = Port(bool, False, "whether keys of the same name are those outside")

Element = Any  # lxml's element class is not public


def tree_names() -> tuple[str, ...]:
    """Names of the packaged trees."""
    return tuple(sorted(path.stem for path in resources.share("behaviors").glob("*.xml")))


def load_tree(
    source: str | Path, registry: Mapping[str, type[Leaf]], context: Context, main: str | None = None
) -> BehaviorTree:
    """Read a file, the packaged tree of that name, or XML text (it begins with <), and build the tree `main` (default:
    the file's main one).

    Raises TreeError with file, line, path in the tree, and what is allowed."""
    return read_tree(source).build(registry, context, main)


@dataclass(frozen=True)
class TreeFile:
    """A file that was read once; trees are built of it as often as one is needed, whatever becomes of the file."""

    root: Element
    file: Path

    def build(self, registry: Mapping[str, type[Leaf]], context: Context, main: str | None = None) -> BehaviorTree:
        """A tree that has not begun. Raises as `load_tree` does."""
        return _Builder(self.root, self.file, registry, context).build(main)


def read_tree(source: str | Path) -> TreeFile:
    """A file, the packaged tree of that name, or XML text. Raises TreeError where it is no XML."""
    if isinstance(source, str) and source.lstrip().startswith("<"):
        path = Path("<text>")
        return TreeFile(_parse(path, source.lstrip().encode()), path)
    path = resources.find("behaviors", str(source), ".xml")
    return TreeFile(_parse(path, _read(path)), path)


EXPECTED = 'a behaviour tree (XML, <root BTCPP_format="4">)'


def nodes_named(source: str | Path) -> set[str]:
    """Names of all kinds of nodes in a tree's file. Raises TreeError as `read_tree` does."""
    elements = read_tree(source).root.iter()
    return {str(e.get("ID", "")) if e.tag in EXPLICIT else str(e.tag) for e in elements}


DAMAGED = ("text that is not UTF-8", "a binary file")  # what a tree may look like with a few bytes spoilt


def _read(path: Path) -> bytes:
    """What a file says, as far as it may be read. Raises TreeError."""
    try:
        if not path.is_file():
            raise TreeError(filekinds.refused(path, f"an XML file or one of {', '.join(tree_names())}"), file=path)
        with path.open("rb") as stream:
            return stream.read(MAX_BYTES + 1)
    except (OSError, ValueError):
        raise TreeError(filekinds.refused(path, EXPECTED), file=str(path)[:200]) from None


def _parse(path: Path, data: bytes) -> Element:
    if len(data) > MAX_BYTES:
        raise TreeError(f"larger than {MAX_BYTES} bytes, which no tree is", file=path)
    if not data.strip():
        raise TreeError(f"got an empty file, expected {EXPECTED}", file=path)
    if b"<!DOCTYPE" in data or b"<!ENTITY" in data:
        line = 1 + data[: min(i for i in (data.find(b"<!DOCTYPE"), data.find(b"<!ENTITY")) if i >= 0)].count(b"\n")
        raise TreeError("document types and entities are not allowed", file=path, line=line)
    parser = etree.XMLParser(
        resolve_entities=False, no_network=True, load_dtd=False, huge_tree=False, remove_comments=True, remove_pis=True
    )
    try:
        root = etree.fromstring(data, parser)
    except etree.XMLSyntaxError as problem:
        kind = filekinds.got(path)
        if kind not in ("XML", "HTML", "text", "no such file"):  # of text that was handed in there is no file
            line = problem.lineno if kind in DAMAGED else None  # where a tree was spoilt; a picture has no lines
            raise TreeError(f"got {kind}, expected {EXPECTED}", file=path, line=line) from None
        message = re.sub(r", line \d+, column \d+.*", "", str(problem.msg))
        raise TreeError(f"not XML: {_one_line(message)}", file=path, line=problem.lineno) from None
    if root.getroottree().docinfo.doctype:  # one in an encoding in which it does not look like ASCII
        raise TreeError("document types and entities are not allowed", file=path)
    return root


def _one_line(text: str, most: int = 600) -> str:
    """Text for an error: one line, nothing that a terminal would obey, not endless."""
    clean = "".join(c if c.isprintable() else ascii(c)[1:-1] for c in text[: most + 1])
    return clean if len(clean) <= most else f"{clean[: most - 3]}..."


class _Builder:
    """Builds nodes from the elements of one file."""

    def __init__(self, root: Element, file: Path, registry: Mapping[str, type[Leaf]], context: Context) -> None:
        self._file, self._registry, self._context = file, registry, context
        self._root, self._count = root, 0
        if root.tag != "root":
            raise self.error(root, "", f'got <{root.tag}>, expected <root BTCPP_format="4">')
        if root.get("BTCPP_format") != "4":
            raise self.error(root, "", f"BTCPP_format: got {shown(root.get('BTCPP_format'))}, expected '4'")
        self._known(root, "", ROOT_ATTRIBUTES)
        self._trees: dict[str, Element] = {}
        for element in root:
            self._top(element)
        if not self._trees:
            raise self.error(root, "", "no <BehaviorTree ID=...> in it")

    def error(self, element: Element, path: str, problem: str) -> TreeError:
        """The error at an element; `path` is the way to it through the tree."""
        path = path if len(path) <= 200 else f"...{path[-197:]}"
        return TreeError(_one_line(problem), file=self._file, line=element.sourceline, key=_one_line(path) or None)

    def _known(self, element: Element, path: str, allowed: Iterable[str]) -> None:
        """Refuse other attributes than these; those of another namespace and NOTES mean nothing here."""
        for attribute in map(str, element.attrib):
            if attribute not in (*allowed, *NOTES) and not attribute.startswith("{"):
                problem = f"unknown attribute {shown(attribute)}, expected one of {', '.join(allowed)}"
                raise self.error(element, path, problem)

    def _top(self, element: Element) -> None:
        if element.tag == "TreeNodesModel":
            return
        if element.tag != "BehaviorTree":
            expected = "<BehaviorTree> or <TreeNodesModel>"
            if element.tag == "include":
                expected += "; other files are not included: put the trees into this one"
            raise self.error(element, "", f"got <{element.tag}>, expected {expected}")
        name = element.get("ID")
        if not name:
            raise self.error(element, "", "<BehaviorTree> without ID")
        if name in self._trees:
            first = self._trees[name].sourceline
            raise self.error(element, name, f"a second tree of this name; the first is at line {first}")
        self._known(element, name, ("ID",))
        self._trees[name] = element

    def build(self, main: str | None) -> BehaviorTree:
        """The tree `main`, the file's main one, or its only one."""
        name = main or self._root.get("main_tree_to_execute")
        if name is None:
            if len(self._trees) > 1:
                raise self.error(self._root, "", "main_tree_to_execute is missing, and there is more than one tree")
            name = next(iter(self._trees))
        if name not in self._trees:
            raise self.error(self._root, "", f"main tree: got {shown(name)}, expected one of {', '.join(self._trees)}")
        for other in self._trees:  # trees that are not used are checked all the same
            if other != name:
                self._content(other, Blackboard(), other, (other,))
        self._count = 0
        board = Blackboard()
        return BehaviorTree(self._content(name, board, name, (name,)), board, name)

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
        elif kind in CONTROLS or kind in DECORATORS:
            node_class = CONTROLS.get(kind) or DECORATORS[kind]
            values = self._values(element, path, node_class.ports, attributes, board)
            self._check_children(element, path, node_class, values)
            children = [self._node(child, board, path, within) for child in element]
            node = node_class(name, children, self._context.clock, board, values)
        elif kind in self._registry:
            leaf = self._leaf(element, path, kind)
            if len(element):
                raise self.error(element, path, f"{kind} is a leaf and has no children")
            values = self._values(element, path, leaf.ports, attributes, board)
            try:
                node = leaf(name, self._context, board, values)
            except MazeplanError:
                raise
            except (Exception, SystemExit) as problem:  # a user's own `__init__` may raise anything
                raise self.error(element, path, f"{kind} could not be made: {reason(problem)}") from problem
            if "_board" not in vars(node):
                call = "super().__init__(name, context, board, values)"
                raise self.error(element, path, f"{kind} could not be made: its __init__ does not call {call}")
        else:
            raise self.error(element, above, f"unknown node {shown(kind)}{self._suggest(kind)}")
        node.place, node.conditions = Place(self._file, element.sourceline, path), conditions
        return node

    def _leaf(self, element: Element, path: str, kind: str) -> type[Leaf]:
        try:
            return self._registry[kind]
        except InputError as problem:  # of an installed package that is broken
            raise self.error(element, path, problem.problem) from None

    def _kind(self, element: Element, above: str) -> tuple[str, dict[str, str]]:
        """(kind of node, its attributes but for the ID of the explicit form and what editors note)."""
        attributes = {str(key): str(value) for key, value in element.attrib.items() if key not in NOTES}
        if element.tag not in EXPLICIT:
            return str(element.tag), attributes
        kind = attributes.pop("ID", "")
        if not kind:
            raise self.error(element, above, f"<{element.tag}> without ID")
        real = "Control" if kind in CONTROLS else "Decorator" if kind in DECORATORS else "Action"
        if kind in (*CONTROLS, *DECORATORS, *self._registry):
            fits = element.tag == real or (real == "Action" and element.tag == "Condition")
            if not fits:
                raise self.error(element, above, f'got <{element.tag} ID="{kind}">, expected <{real} ID="{kind}">')
        return kind, attributes

    def _conditions(
        self, element: Element, path: str, attributes: dict[str, str], board: Blackboard
    ) -> Conditions | None:
        """The preconditions among the attributes, which are taken out; most nodes have none."""
        given = {}
        for name in DECISIONS:
            if name in attributes:
                try:
                    given[name] = parse_expression(attributes.pop(name))
                except ExpressionError as problem:
                    raise self.error(element, path, f"{name}: {problem}") from None
        return Conditions(given, board) if given else None

    def _suggest(self, kind: str) -> str:
        known = [*CONTROLS, *DECORATORS, "SubTree", *self._registry]
        near = difflib.get_close_matches(kind, known, 1)
        return f"; did you mean {near[0]}?" if near else f", expected one of {', '.join(known)}, or a leaf of yours"

    def _check_children(self, element: Element, path: str, node: type[Node], values: Mapping[str, Any]) -> None:
        n = len(element)
        if n == 0 or (node.most is not None and n > node.most):
            expected = "exactly 1" if node.most == 1 else "at least 1"
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
        ports: Mapping[str, Port],
        attributes: Mapping[str, str],
        board: Blackboard,
    ) -> dict[str, Any]:
        """{port: literal or Key}, checked; of the blackboard, only the literals given to a SubTree are known yet."""
        values: dict[str, Any] = {}
        own = ("name", *ports, *(("ID",) if element.tag in EXPLICIT else ()))
        self._known(element, path, (*own, *DECISIONS))
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
                    continue
                values[attribute] = key
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
        remap: dict[str, str] = {}
        literals: dict[str, str] = {}
        for port, text in attributes.items():
            if port.startswith("_"):
                expected = f"ID, name, _autoremap, {', '.join(DECISIONS)} or names of the tree's keys"
                problem = f"unknown attribute {shown(port)}, expected {expected}"
                raise self.error(element, path, problem)
            key = self._key(element, path, port, text)
            if key:
                remap[port] = key.name
            else:
                literals[port] = text
        scope = Blackboard(board, remap, literals, autoremap=autoremap)
        inside = self._content(tree, scope, path, (*within, tree))
        given = {port: Key(remap[port]) if port in remap else literals[port] for port in attributes}
        return SubTree(name, [inside], self._context.clock, scope, {**({"ID": tree} if tree != name else {}), **given})
