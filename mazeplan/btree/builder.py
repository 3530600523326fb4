"""Makes nodes from the elements of a behaviour tree's XML. Errors name the line.

A node may have either form: `<Track speed="1"/>` or `<Action ID="Track" speed="1"/>`. An attribute is one of these:
- `name`,
- a port; `{key}` refers to the blackboard, and `{=}` to the key with the name of the port,
- a pre- or postcondition (`conditions`), such as `_skipIf="legs &lt; 2"`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from mazeplan.btree.blackboard import Blackboard
from mazeplan.btree.blame import raised
from mazeplan.btree.builtin_leaves import BUILTIN_LEAVES
from mazeplan.btree.conditions import CONDITIONS, Conditions
from mazeplan.btree.controls import CONTROLS
from mazeplan.btree.decorators import DECORATORS, SubTree
from mazeplan.btree.leaf import Context
from mazeplan.btree.mistakes import Mistakes, Unbuilt
from mazeplan.btree.node import Node, Place, TreeNode
from mazeplan.btree.ports import REQUIRED, Key, Port, shown
from mazeplan.btree.script import Script, parse_script
from mazeplan.btree.script_values import Scope, ScriptError
from mazeplan.btree.tree import BehaviorTree
from mazeplan.btree.tree_parts import ATTRIBUTES, ELSEWHERE, EXPLICIT, Element, Part, TreeParts, literal
from mazeplan.core.errors import InputError, MazeplanError, TreeError
from mazeplan.core.name_hints import nearest

MAX_DEPTH = 60  # nodes on one path, subtrees included
MAX_NODES = 5_000  # nodes of a tree, subtrees included
MAX_NAME = 100  # characters of a node's name
BUILTIN: dict[str, type[TreeNode]] = {**CONTROLS, **DECORATORS, **BUILTIN_LEAVES}
SCRIPTS = {"Script": ("code",), "ScriptCondition": ("code",), "Precondition": ("if",)}  # ports that are scripts

OPTION = "--behavior-module"  # adds the user's nodes

AUTOREMAP = Port(bool, False, "whether keys of the same name are those outside")


@dataclass(frozen=True)
class _Use:
    """One use of a tree.

    trees: IDs of the trees around it, from the outermost, and its own ID last
    path: names of the SubTrees that lead to it
    """

    trees: tuple[str, ...]
    path: str = ""


class Builder:
    """Builds nodes from the elements of a file and of the files that it includes.

    mistakes: keeps or raises mistakes; by default they are raised as TreeError"""

    def __init__(
        self,
        parts: Sequence[Part],
        registry: Mapping[str, type[TreeNode]],
        context: Context,
        mistakes: Mistakes | None = None,
    ) -> None:
        self._registry, self._context, self._mistakes = registry, context, mistakes or Mistakes()
        self._enums = getattr(registry, "enums", None)
        self.files = TreeParts(parts, lambda name: name in BUILTIN or name in registry, self._mistakes)
        self._cycles = set[frozenset[str]]()
        self._begin()

    def _begin(self) -> None:
        self._count = 0
        self._subtrees: dict[str, Element | None] = {"": None}  # by path; the path of the main tree is empty
        self._calls: dict[int, tuple[Element, str]] = {}  # the SubTree of a scope, and its path; by id of the scope
        self._given_wrong: dict[tuple[int, str], TreeError] = {}  # errors by scope and port

    def build(self, main: str | None) -> BehaviorTree:
        """Build the tree `main`; None: the file's main tree, or its only tree."""
        name = self.files.main(main)
        self.build_other_trees(name)
        board = Blackboard(enums=self._enums)
        content = self._content(name, board, name, _Use((name,)))
        return BehaviorTree(content, board, name, getattr(self._context, "again", None))

    def build_other_trees(self, main: str | None) -> None:
        """Build all trees except `main`, so that trees that are not used are checked, too."""
        for other in self.files.trees:
            if other != main:
                self._begin()
                self._content(other, Blackboard(enums=self._enums), other, _Use((other,)))
        self._begin()

    def _content(self, tree: str, board: Blackboard, path: str, use: _Use) -> TreeNode:
        element = self.files.trees[tree]
        with self._mistakes:
            if len(element) != 1:
                raise self.files.error(element, path, f"a tree has exactly one root node, got {len(element)}")
        nodes = [self._node(child, board, path, use) for child in element]
        return nodes[0] if nodes else self._unbuilt(element, board, path, nodes)

    def _unbuilt(self, element: Element, board: Blackboard, path: str, children: Sequence[TreeNode]) -> Unbuilt:
        node = Unbuilt(str(element.tag), children, self._context.clock, board, {})
        node.place = Place(self.files.file_of(element), element.sourceline, path)
        return node.of({str(name): str(text) for name, text in element.items()})

    def _node(self, element: Element, board: Blackboard, above: str, use: _Use) -> TreeNode:
        """A node with all nodes below it; an Unbuilt if the node has mistakes that were kept."""
        with self._mistakes:
            return self._made(element, board, above, use)
        path = f"{above}/{element.get('name') or element.tag}"
        return self._unbuilt(element, board, path, [self._node(child, board, path, use) for child in element])

    def _made(self, element: Element, board: Blackboard, above: str, use: _Use) -> TreeNode:
        kind, attributes = self._kind(element, above)
        name = attributes.pop("name", "") or (attributes.get("ID", "") if kind == "SubTree" else kind)
        if len(name) > MAX_NAME or not name.isprintable():
            expected = f"expected at most {MAX_NAME} printing characters"
            raise self.files.error(element, above, f"name: got {shown(name)}, {expected}")
        path = f"{above}/{name}"
        self._count += 1
        if path.count("/") > MAX_DEPTH or self._count > MAX_NODES:
            beyond = f"{MAX_NODES} nodes" if self._count > MAX_NODES else f"{MAX_DEPTH} levels of nesting"
            raise self._mistakes.last(self.files.error(element, above, f"more than {beyond}"))
        before = self._mistakes.noted
        conditions = self._conditions(element, path, attributes, board)
        if kind == "SubTree":
            node: TreeNode = self._subtree(element, name, attributes, board, path, use)
        else:
            node_class = self._class(element, path, kind, above)
            values = self._values(element, path, kind, node_class.ports, attributes, board)
            with self._mistakes:
                self._check_children(element, path, node_class, values)
            whole = self._mistakes.noted == before
            children = [self._node(child, board, path, use) for child in element]
            made = None
            if whole:
                with self._mistakes:
                    made = self._instance(element, path, node_class, name, children, board, values)
            node = made or self._unbuilt(element, board, path, children)
        node.place, node.conditions = Place(self.files.file_of(element), element.sourceline, path), conditions
        return node

    def _instance(
        self,
        element: Element,
        path: str,
        kind: Any,
        name: str,
        children: Sequence[TreeNode],
        board: Blackboard,
        values: Mapping[str, Any],
    ) -> TreeNode:
        inner = issubclass(kind, Node)
        try:
            node = kind(name, *((children, self._context.clock) if inner else (self._context,)), board, values)
        except MazeplanError:
            raise
        except (Exception, SystemExit) as problem:  # a user's own `__init__` may raise anything
            raise self.files.error(element, path, f"{kind.__name__} could not be made: {raised(problem)}") from problem
        if "_board" not in vars(node):
            call = f"super().__init__(name, {'children, clock' if inner else 'context'}, board, values)"
            problem = f"{kind.__name__} could not be made: its __init__ does not call {call}"
            raise self.files.error(element, path, problem)
        return node

    def _class(self, element: Element, path: str, kind: str, above: str) -> type[TreeNode]:
        """The class of a node. Raises TreeError for an unknown name."""
        if kind in BUILTIN:
            return BUILTIN[kind]
        try:
            if kind in self._registry:
                return self._registry[kind]
        except InputError as problem:  # from an installed package that is broken
            raise self.files.error(element, path, problem.problem) from None
        raise self.files.error(element, above, f"unknown node {shown(kind)}{self._suggest(kind)}")

    def _kind(self, element: Element, above: str) -> tuple[str, dict[str, str]]:
        """(kind of node, its attributes). Leaves out the ID of the explicit form, and attributes of editors."""
        given = {str(key): str(value) for key, value in element.attrib.items()}
        attributes = {key: value for key, value in given.items() if key[0] != "_" or key in ATTRIBUTES}
        if element.tag not in EXPLICIT:
            return str(element.tag), attributes
        kind = attributes.pop("ID", "")
        if not kind:
            raise self.files.error(element, above, f"<{element.tag}> without ID")
        known = BUILTIN.get(kind) or (self._class(element, above, kind, above) if kind in self._registry else None)
        if known is not None:
            real = known.category
            if element.tag != real and {element.tag, real} != {"Action", "Condition"}:
                raise self.files.error(
                    element, above, f'got <{element.tag} ID="{kind}">, expected <{real} ID="{kind}">'
                )
        return kind, attributes

    def _conditions(
        self, element: Element, path: str, attributes: dict[str, str], board: Blackboard
    ) -> Conditions | None:
        """The pre- and postconditions of a node; None without any. Removes them from `attributes`."""
        given = {}
        for name in CONDITIONS:
            if name in attributes:
                with self._mistakes:
                    given[name] = self._script(element, path, name, attributes.pop(name))
        return Conditions(given, Scope(board)) if given else None

    def _script(self, element: Element, path: str, name: str, text: str) -> Script:
        try:
            return parse_script(text)
        except ScriptError as problem:
            raise self.files.error(element, path, f"{name}: {problem}") from None

    def _suggest(self, kind: str) -> str:
        if kind in ELSEWHERE:
            return f": a node of {ELSEWHERE[kind]} that is missing here; a leaf of your own can take its place"
        known = ["SubTree", *BUILTIN, *self._registry]
        near = nearest(kind, known)
        if near is not None:
            return f"; did you mean {near}? One of your own needs {OPTION}"
        return f"; one of your own needs {OPTION}; expected one of {', '.join(known)}"

    def _check_children(self, element: Element, path: str, node: type[TreeNode], values: Mapping[str, Any]) -> None:
        n = len(element)
        if not issubclass(node, Node):
            if n:
                raise self.files.error(element, path, f"{node.__name__} is a leaf and has no children")
            return
        if n < node.least or (node.most is not None and n > node.most):
            expected = f"at least {node.least}" if node.most is None else f"{node.least} or {node.most}"
            expected = f"exactly {node.least}" if node.most == node.least else expected
            raise self.files.error(element, path, f"{node.__name__}: got {n} children, expected {expected}")
        problem = node.problem(values, n)
        if problem:
            raise self.files.error(element, path, problem)

    def _values(
        self,
        element: Element,
        path: str,
        kind: str,
        ports: Mapping[str, Port],
        attributes: Mapping[str, str],
        board: Blackboard,
    ) -> dict[str, Any]:
        """{port: literal or Key}, checked. A Key is checked only if a SubTree gives its value as a literal."""
        values: dict[str, Any] = {}
        own = ("name", *ports, *(("ID",) if element.tag in EXPLICIT else ()))
        with self._mistakes:
            self.files.known(element, path, (*own, *CONDITIONS))
        for attribute, text in attributes.items():
            if attribute in ports:  # else it belongs to another namespace
                with self._mistakes:
                    values[attribute] = self._value(element, path, attribute, text, ports[attribute], board)
                    if attribute in SCRIPTS.get(kind, ()) and not isinstance(values[attribute], Key):
                        self._script(element, path, attribute, text)
        for name, port in ports.items():
            if port.default is REQUIRED and name not in attributes:
                with self._mistakes:
                    raise self.files.error(element, path, f"{name} is missing ({port.doc})")
        return values

    def _value(self, element: Element, path: str, attribute: str, text: str, port: Port, board: Blackboard) -> Any:
        """The literal or Key that an attribute gives to a port."""
        key = self.files.key(element, path, attribute, text)
        if key is None and port.direction == "out":
            example = f"a blackboard entry such as {{{attribute}}}"
            raise self.files.error(element, path, f"{attribute}: got {shown(text)}, expected {example}")
        given: Any = text
        try:
            if key is None:
                return port.parse(text, self._context)
            board.declare(key.name).named_by(port.type)
            if port.direction != "out" and key.name in board:
                given = board.get(key.name)
                port.accept(given, self._context)
            return key
        except (ValueError, OverflowError):
            problem = f"got {shown(given)}, expected {port.expects(self._context)}"
            if key is None:
                raise self.files.error(element, path, f"{attribute}: {problem}") from None
            self._mistakes.elsewhere(self._wrong_value(element, path, key, board, problem))
            return key

    def _wrong_value(self, element: Element, path: str, key: Key, board: Blackboard, problem: str) -> TreeError:
        """The error for a value that a SubTree gives, at the SubTree's line. All nodes inside that read the value share
        one error."""
        *_, (scope, name) = board.scope_chain(key.name)
        call, above = self._calls[id(scope)]
        inside = (
            f"inside, {path.rpartition('/')[2]} reads {key} at {self.files.file_of(element).name}:{element.sourceline}"
        )
        return self._given_wrong.setdefault(
            (id(scope), name), self.files.error(call, above, f"{name}: {problem}; {inside}")
        )

    def _subtree(
        self,
        element: Element,
        name: str,
        attributes: dict[str, str],
        board: Blackboard,
        path: str,
        use: _Use,
    ) -> TreeNode:
        """A SubTree with its scope: {key} is remapped, anything else is a literal in the scope."""
        tree = attributes.pop("ID", "")
        if tree not in self.files.trees:
            got = f"got {shown(tree)}" if tree else "ID is missing"
            problem = f"SubTree: {got}, expected one of {', '.join(self.files.trees)}"
            raise self.files.error(element, path, problem)
        if tree in use.trees:
            cycle = frozenset(use.trees[use.trees.index(tree) :])
            if cycle in self._cycles:  # already reported, from another tree of the cycle
                return self._unbuilt(element, board, path, ())
            self._cycles.add(cycle)
            raise self.files.error(element, path, f"{tree} contains itself: {' > '.join((*use.trees, tree))}")
        if len(element):
            raise self.files.error(
                element, path, "a SubTree has no children: what it does stands in its <BehaviorTree>"
            )
        here = self._place_of(element, tree, path, use)
        try:
            autoremap = AUTOREMAP.parse(attributes.pop("_autoremap", "false"))
        except ValueError:
            problem = f"_autoremap: got {shown(element.get('_autoremap'))}, expected {AUTOREMAP.expected}"
            raise self.files.error(element, path, problem) from None
        given = self._given(element, path, attributes, {} if autoremap else self.files.models.get(tree, {}))
        remap = {port: value.name for port, value in given.items() if isinstance(value, Key)}
        literals = {port: value for port, value in given.items() if not isinstance(value, Key)}
        for key in remap.values():
            board.declare(key)
        scope = Blackboard(board, remap, literals, autoremap=autoremap)
        self._calls[id(scope)] = element, path
        inside = self._content(tree, scope, path, here)
        values = {**({"ID": tree} if tree != name else {}), **given}
        node = SubTree(name, [inside], self._context.clock, scope, values)
        node.by_model, node.named = frozenset(given) - frozenset(attributes), bool(element.get("name"))
        return node

    def _place_of(self, element: Element, tree: str, path: str, use: _Use) -> _Use:
        """The use of a tree by a SubTree. Its path must be unique; a SubTree without a name gets a number."""
        given = element.get("name")
        own = f"{tree}::{self._count}" if given is None else given
        here = f"{use.path}/{own}" if use.path else own
        if here in self._subtrees:
            first, expected = self._subtrees[here], "expected another name, or none"
            where = "the main tree" if first is None else f"SubTree at {self.files.file_of(first)}:{first.sourceline}"
            problem = f"name: got {shown(given)}, but {where} has the same path in the tree; {expected}"
            raise self.files.error(element, path, problem)
        self._subtrees[here] = element
        return _Use((*use.trees, tree), here)

    def _given(
        self, element: Element, path: str, attributes: Mapping[str, str], model: Mapping[str, str | None]
    ) -> dict[str, Any]:
        """The ports of a SubTree with their values: {port: Key or literal}, with the defaults of its model."""
        given: dict[str, Any] = {}
        for port, text in attributes.items():
            given[port] = self.files.key(element, path, port, text) or literal(text)
        for port, default in model.items():
            if port in given:
                continue
            if default is None:
                raise self.files.error(element, path, f"{port} is missing, which its model in TreeNodesModel asks for")
            given[port] = self.files.key(element, path, port, default) or literal(default)
        return given
