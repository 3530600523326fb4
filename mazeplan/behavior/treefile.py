"""Behaviour trees from XML files in BehaviorTree.CPP version 4 format, with errors at the line.

Read by lxml without DTD, entities or network, after a look at the size; nothing in a file is ever executed. Both
forms of a node are taken:
`<Track speed="1"/>` and `<Action ID="Track" speed="1"/>`. An attribute is a port, or `name`; `{key}` refers to the
blackboard.
"""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from lxml import etree  # pyright: ignore[reportAttributeAccessIssue]  # compiled, without stubs

from mazeplan import resources
from mazeplan.behavior.blackboard import Blackboard
from mazeplan.behavior.leaf import REQUIRED, Context, Key, Leaf, Port
from mazeplan.behavior.nodes import CONTROLS, DECORATORS, Node, SubTree
from mazeplan.behavior.tree import BehaviorTree
from mazeplan.errors import TreeError

MAX_BYTES = 1 << 20
MAX_DEPTH = 60  # nodes on one path, subtrees included
MAX_NODES = 5_000  # after subtrees are put in their places
EXPLICIT = ("Action", "Condition", "Control", "Decorator")
KEY = re.compile(r"\{([A-Za-z_][A-Za-z0-9_.]*)\}")

Element = Any  # lxml's element class is not public


def tree_names() -> tuple[str, ...]:
    """Names of the packaged trees."""
    return tuple(sorted(path.stem for path in resources.share("behaviors").glob("*.xml")))


def load_tree(
    source: str | Path, registry: Mapping[str, type[Leaf]], context: Context, main: str | None = None
) -> BehaviorTree:
    """Read a file, or the packaged tree of that name, and build the tree `main` (default: the file's main one).

    Raises TreeError with file, line, path in the tree, and what is allowed."""
    path = resources.find("behaviors", str(source), ".xml")
    root = _parse(path)
    return _Builder(root, path, registry, context).build(main)


def _parse(path: Path) -> Element:
    try:
        if not path.is_file():
            names = ", ".join(tree_names())
            raise TreeError(f"no such file; expected an XML file or one of {names}", file=path)
        with path.open("rb") as stream:
            data = stream.read(MAX_BYTES + 1)
    except (OSError, ValueError) as problem:
        raise TreeError(f"cannot be read: {problem}", file=str(path)[:200]) from None
    if len(data) > MAX_BYTES:
        raise TreeError(f"larger than {MAX_BYTES} bytes, which no tree is", file=path)
    if not data.strip():
        raise TreeError('the file is empty, expected <root BTCPP_format="4">', file=path)
    if b"<!DOCTYPE" in data or b"<!ENTITY" in data:
        line = 1 + data[: min(i for i in (data.find(b"<!DOCTYPE"), data.find(b"<!ENTITY")) if i >= 0)].count(b"\n")
        raise TreeError("document types and entities are not allowed", file=path, line=line)
    parser = etree.XMLParser(
        resolve_entities=False, no_network=True, load_dtd=False, huge_tree=False, remove_comments=True, remove_pis=True
    )
    try:
        return etree.fromstring(data, parser)
    except etree.XMLSyntaxError as problem:
        message = re.sub(r", line \d+, column \d+.*", "", str(problem.msg))
        raise TreeError(f"not XML: {message}", file=path, line=problem.lineno) from None


class _Builder:
    """Builds nodes from the elements of one file."""

    def __init__(self, root: Element, file: Path, registry: Mapping[str, type[Leaf]], context: Context) -> None:
        self._file, self._registry, self._context = file, registry, context
        self._root, self._count = root, 0
        if root.tag != "root":
            raise self.error(root, "", f'got <{root.tag}>, expected <root BTCPP_format="4">')
        if root.get("BTCPP_format") != "4":
            raise self.error(root, "", f"BTCPP_format: got {root.get('BTCPP_format')!r}, expected '4'")
        self._trees: dict[str, Element] = {}
        for element in root:
            self._top(element)
        if not self._trees:
            raise self.error(root, "", "no <BehaviorTree ID=...> in it")

    def error(self, element: Element, path: str, problem: str) -> TreeError:
        """The error at an element; `path` is the way to it through the tree."""
        return TreeError(problem, file=self._file, line=element.sourceline, key=path or None)

    def _top(self, element: Element) -> None:
        if element.tag == "TreeNodesModel":
            return
        if element.tag != "BehaviorTree":
            raise self.error(element, "", f"got <{element.tag}>, expected <BehaviorTree> or <TreeNodesModel>")
        name = element.get("ID")
        if not name:
            raise self.error(element, "", "<BehaviorTree> without ID")
        if name in self._trees:
            raise self.error(
                element, name, f"a second tree of this name; the first is at line {self._trees[name].sourceline}"
            )
        self._trees[name] = element

    def build(self, main: str | None) -> BehaviorTree:
        """The tree `main`, the file's main one, or its only one."""
        name = main or self._root.get("main_tree_to_execute")
        if name is None:
            if len(self._trees) > 1:
                raise self.error(self._root, "", "main_tree_to_execute is missing, and there is more than one tree")
            name = next(iter(self._trees))
        if name not in self._trees:
            raise self.error(self._root, "", f"main tree: got {name!r}, expected one of {', '.join(self._trees)}")
        for other in self._trees:  # trees that are not used are checked all the same
            if other != name:
                self._content(other, Blackboard(), other, (other,))
        self._count = 0
        board = Blackboard()
        return BehaviorTree(self._content(name, board, name, (name,)), board, name)

    def _content(self, tree: str, board: Blackboard, path: str, within: tuple[str, ...]) -> Any:
        element = self._trees[tree]
        if len(element) != 1:
            raise self.error(element, path, f"a tree has exactly one root node, got {len(element)}")
        return self._node(element[0], board, path, within)

    def _node(self, element: Element, board: Blackboard, above: str, within: tuple[str, ...]) -> Any:
        kind, attributes = self._kind(element, above)
        name = attributes.pop("name", kind)
        path = f"{above}/{name}"
        self._count += 1
        if path.count("/") > MAX_DEPTH or self._count > MAX_NODES:
            raise self.error(element, above, f"more than {MAX_DEPTH} levels or {MAX_NODES} nodes")
        if kind == "SubTree":
            return self._subtree(element, attributes, board, above, within)
        if kind in CONTROLS or kind in DECORATORS:
            node = CONTROLS.get(kind) or DECORATORS[kind]
            values = self._values(element, path, node.ports, attributes)
            self._number_of_children(element, path, node)
            children = [self._node(child, board, path, within) for child in element]
            return node(name, children, self._context.clock, board, values)
        if kind in self._registry:
            leaf = self._registry[kind]
            if len(element):
                raise self.error(element, path, f"{kind} is a leaf and has no children")
            return leaf(name, self._context, board, self._values(element, path, leaf.ports, attributes))
        raise self.error(element, above, f"unknown node {kind!r}{self._suggest(kind)}")

    def _kind(self, element: Element, above: str) -> tuple[str, dict[str, str]]:
        attributes = {str(key): str(value) for key, value in element.attrib.items()}
        if element.tag in EXPLICIT:
            kind = attributes.pop("ID", "")
            if not kind:
                raise self.error(element, above, f"<{element.tag}> without ID")
            return kind, attributes
        return str(element.tag), attributes

    def _suggest(self, kind: str) -> str:
        known = [*CONTROLS, *DECORATORS, "SubTree", *self._registry]
        near = difflib.get_close_matches(kind, known, 1)
        return f"; did you mean {near[0]}?" if near else f", expected one of {', '.join(known)}"

    def _number_of_children(self, element: Element, path: str, node: type[Node]) -> None:
        n = len(element)
        if n == 0 or (node.most is not None and n > node.most):
            expected = "exactly 1" if node.most == 1 else "at least 1"
            raise self.error(element, path, f"{node.__name__}: got {n} children, expected {expected}")

    def _values(
        self, element: Element, path: str, ports: Mapping[str, Port], attributes: Mapping[str, str]
    ) -> dict[str, Any]:
        values: dict[str, Any] = {}
        for attribute, text in attributes.items():
            if attribute not in ports:
                allowed = ", ".join(["name", *ports])
                raise self.error(element, path, f"unknown attribute {attribute!r}, expected one of {allowed}")
            port, key = ports[attribute], KEY.fullmatch(text)
            if key:
                values[attribute] = Key(key.group(1))
            elif port.direction == "out":
                raise self.error(
                    element, path, f"{attribute}: got {text!r}, expected a blackboard entry such as {{{attribute}}}"
                )
            else:
                try:
                    values[attribute] = port.parse(text)
                except (ValueError, OverflowError):
                    raise self.error(
                        element, path, f"{attribute}: got {text!r}, expected {port.type.__name__}"
                    ) from None
        for name, port in ports.items():
            if port.default is REQUIRED and name not in values:
                raise self.error(element, path, f"{name} is missing ({port.doc})")
        return values

    def _subtree(
        self, element: Element, attributes: dict[str, str], board: Blackboard, above: str, within: tuple[str, ...]
    ) -> Any:
        name = attributes.pop("ID", "")
        path = f"{above}/{name}"
        if name not in self._trees:
            raise self.error(element, above, f"SubTree: got {name!r}, expected one of {', '.join(self._trees)}")
        if name in within:
            raise self.error(element, path, f"{name} contains itself: {_chain((*within, name))}")
        autoremap = attributes.pop("_autoremap", "false").lower() in ("true", "1")
        remap: dict[str, str] = {}
        literals: dict[str, str] = {}
        for port, text in attributes.items():
            key = KEY.fullmatch(text)
            if key:
                remap[port] = key.group(1)
            else:
                literals[port] = text
        scope = Blackboard(board, remap, autoremap=autoremap)
        for port, text in literals.items():
            scope.set(port, text)
        inside = self._content(name, scope, path, (*within, name))
        return SubTree(name, [inside], self._context.clock, scope, {})


def _chain(names: Iterable[str]) -> str:
    return " > ".join(names)


def write_palette(registry: Mapping[str, type[Leaf]]) -> str:
    """TreeNodesModel of all leaves, for Groot2's palette."""
    root = etree.Element("root", BTCPP_format="4")
    model = etree.SubElement(root, "TreeNodesModel")
    for name, leaf in sorted(registry.items()):
        action = etree.SubElement(model, "Action", ID=name)
        for port_name, port in leaf.ports.items():
            tag = {"in": "input_port", "out": "output_port", "inout": "inout_port"}[port.direction]
            entry = etree.SubElement(action, tag, name=port_name, type=port.type.__name__)
            if port.default is not REQUIRED and port.default is not None:
                entry.set("default", str(port.default))
            entry.text = port.doc
    return etree.tostring(root, pretty_print=True, encoding="unicode")
