"""Makes nodes from the elements of a behaviour tree's XML. Errors name the line.

A node may have either form: `<Track speed="1"/>` or `<Action ID="Track" speed="1"/>`. An attribute is one of these:
- `name`,
- a port; `{key}` refers to the blackboard, and `{=}` to the key with the name of the port,
- a pre- or postcondition (`node.Conditions`), such as `_skipIf="legs &lt; 2"`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from mazeplan.btree.blackboard import Blackboard
from mazeplan.btree.controls import CONTROLS
from mazeplan.btree.decorators import DECORATORS, SubTree
from mazeplan.btree.leaf import BUILTIN_LEAVES, Context
from mazeplan.btree.node import CONDITIONS, Conditions, Node, Place, TreeNode
from mazeplan.btree.ports import REQUIRED, Key, Port, shown
from mazeplan.btree.script import Script, parse_script
from mazeplan.btree.script_values import ScriptError
from mazeplan.btree.tree import BehaviorTree
from mazeplan.btree.treefile import TREE_ATTRIBUTES, Element, Mistakes, TreeFile, keeping, literal
from mazeplan.core.errors import InputError, MazeplanError, TreeError, nearest, one_of, reason

MAX_DEPTH = 60  # nodes on one path, subtrees included
MAX_NODES = 5_000  # nodes of a tree, subtrees included
MAX_NAME = 100  # characters of a node's name
BUILTIN: dict[str, type[TreeNode]] = {**CONTROLS, **DECORATORS, **BUILTIN_LEAVES}
EXPLICIT = ("Action", "Condition", "Control", "Decorator")
SCRIPTS = {"Script": "code", "ScriptCondition": "code", "Precondition": "if"}  # ports that are scripts
OPTION = "--behavior-module"  # adds the user's nodes
AUTOREMAP = Port(bool, False, "whether keys of the same name are those outside")

Registry = Mapping[str, type[TreeNode]]


class _TooLargeError(Exception):
    """The tree is not built any further."""


def build(file: TreeFile, registry: Registry, context: Context, main: str | None = None) -> BehaviorTree:
    """A tree that has not begun: `main`; None: the file's main tree, or its only tree.

    Raises TreeError with file, line, path in the tree, and what is allowed."""
    tree, mistakes = draft(file, registry, context, main)
    if tree is None:
        raise mistakes[0]
    return tree


def draft(
    file: TreeFile, registry: Registry, context: Context, main: str | None = None
) -> tuple[BehaviorTree | None, list[TreeError]]:
    """The tree, or None and all mistakes of the file, also in trees that are not used."""
    builder = _Builder(file, registry, context)
    try:
        tree = builder.build(main)
    except _TooLargeError:
        tree = None
    return tree, [*builder.mistakes.values()]


class _Builder:
    """Builds nodes from the elements of a file and of the files that it includes, and keeps all mistakes."""

    def __init__(self, file: TreeFile, registry: Registry, context: Context) -> None:
        self._file, self._registry, self._context = file, registry, context
        self._enums = getattr(registry, "enums", None)
        self._count = 0
        self.mistakes: Mistakes = dict(file.mistakes)

    def build(self, main: str | None) -> BehaviorTree | None:
        file, name = self._file, None
        for taken in (other for other in file.trees if other in BUILTIN or other in self._registry):
            with keeping(self.mistakes):
                raise file.error(file.trees[taken], "", f"ID: got {shown(taken)}, which is the name of a node")
        with keeping(self.mistakes):
            name = file.main(main)
        for other in file.trees:
            if other != name:
                self._root(other, Blackboard(enums=self._enums))
        board = Blackboard(enums=self._enums)
        root = None if name is None else self._root(name, board)
        if name is None or root is None or self.mistakes:
            return None
        return BehaviorTree(root, board, name, getattr(self._context, "again", None))

    def _root(self, tree: str, board: Blackboard) -> TreeNode | None:
        self._count = 0
        return self._content(tree, board, tree, (tree,))

    def _content(self, tree: str, board: Blackboard, path: str, around: tuple[str, ...]) -> TreeNode | None:
        """The root node of a tree. around: IDs of the trees around it, from the outermost, and its own ID last"""
        element = self._file.trees[tree]
        with keeping(self.mistakes):
            if len(element) != 1:
                raise self._file.error(element, path, f"a tree has exactly one root node, got {len(element)}")
        nodes = [self._node(child, board, path, around) for child in element]
        return nodes[0] if nodes else None

    def _node(self, element: Element, board: Blackboard, above: str, around: tuple[str, ...]) -> TreeNode | None:
        """A node with all nodes below it; None if they have mistakes. Of each node the first mistake is kept."""
        path, below = f"{above}/{element.get('name') or element.tag}", False
        with keeping(self.mistakes):
            kind, attributes = self._kind(element, above)
            name = attributes.pop("name", "") or (attributes.get("ID", "") if kind == "SubTree" else kind)
            path = self._path(element, above, name)
            conditions = self._conditions(element, path, attributes, board)
            if kind == "SubTree":
                node: TreeNode | None = self._subtree(element, name, attributes, board, path, around)
            else:
                node_class = self._class(element, path, kind)
                values = self._values(element, path, kind, node_class.ports, attributes, board)
                self._check_children(element, path, node_class, values)
                below = True
                children = [self._node(child, board, path, around) for child in element]
                whole = [child for child in children if child is not None]
                node = None
                if len(whole) == len(children):
                    node = self._instance(element, path, node_class, name, whole, board, values)
            if node is not None:
                node.place, node.conditions = Place(self._file.file_of(element), element.sourceline, path), conditions
            return node
        if not below:  # their mistakes are kept, too
            for child in element:
                self._node(child, board, path, around)
        return None

    def _path(self, element: Element, above: str, name: str) -> str:
        if len(name) > MAX_NAME or not name.isprintable():
            expected = f"expected at most {MAX_NAME} printing characters"
            raise self._file.error(element, above, f"name: got {shown(name)}, {expected}")
        path = f"{above}/{name}"
        self._count += 1
        if path.count("/") > MAX_DEPTH or self._count > MAX_NODES:
            beyond = f"{MAX_NODES} nodes" if self._count > MAX_NODES else f"{MAX_DEPTH} levels of nesting"
            with keeping(self.mistakes):
                raise self._file.error(element, above, f"more than {beyond}")
            raise _TooLargeError
        return path

    def _instance(
        self, element: Element, path: str, kind: Any, name: str, children: Sequence[TreeNode], board: Blackboard,
        values: Mapping[str, Any],
    ) -> TreeNode:  # fmt: skip
        inner = issubclass(kind, Node)
        try:
            node = kind(name, *((children, self._context.clock) if inner else (self._context,)), board, values)
        except MazeplanError:
            raise
        except (Exception, SystemExit) as problem:  # a user's own `__init__` may raise anything
            raise self._file.error(element, path, f"{kind.__name__} could not be made: {reason(problem)}") from problem
        if "_board" not in vars(node):
            call = f"super().__init__(name, {'children, clock' if inner else 'context'}, board, values)"
            problem = f"{kind.__name__} could not be made: its __init__ does not call {call}"
            raise self._file.error(element, path, problem)
        return node

    def _class(self, element: Element, path: str, kind: str) -> type[TreeNode]:
        if kind in BUILTIN:
            return BUILTIN[kind]
        try:
            if kind in self._registry:
                return self._registry[kind]
        except InputError as problem:  # from an installed package that is broken
            raise self._file.error(element, path, problem.problem) from None
        known = ["SubTree", *BUILTIN, *self._registry]
        near = nearest(kind, known)
        hint = f"expected {one_of(known)}" if near is None else f"did you mean {near}?"
        raise self._file.error(element, path, f"unknown node {shown(kind)}, which {OPTION} may add; {hint}")

    def _kind(self, element: Element, above: str) -> tuple[str, dict[str, str]]:
        """(kind of node, its attributes). Leaves out the ID of the explicit form, and attributes of editors."""
        given = {str(key): str(value) for key, value in element.attrib.items()}
        attributes = {key: value for key, value in given.items() if key[0] != "_" or key in TREE_ATTRIBUTES}
        if element.tag == "SubTree":
            self._file.known(element, above, attributes)
        if element.tag not in EXPLICIT:
            return str(element.tag), attributes
        kind = attributes.pop("ID", "")
        if not kind:
            raise self._file.error(element, above, f"<{element.tag}> without ID")
        if kind in BUILTIN or kind in self._registry:
            real = self._class(element, above, kind).category
            if element.tag != real and {element.tag, real} != {"Action", "Condition"}:
                expected = f'expected <{real} ID="{kind}">'
                raise self._file.error(element, above, f'got <{element.tag} ID="{kind}">, {expected}')
        return kind, attributes

    def _conditions(
        self, element: Element, path: str, attributes: dict[str, str], board: Blackboard
    ) -> Conditions | None:
        """The pre- and postconditions of a node; None without any. Removes them from `attributes`."""
        names = [name for name in CONDITIONS if name in attributes]
        given = {name: self._script(element, path, name, attributes.pop(name)) for name in names}
        return Conditions(given, board) if given else None

    def _script(self, element: Element, path: str, name: str, text: str) -> Script:
        try:
            return parse_script(text)
        except ScriptError as problem:
            raise self._file.error(element, path, f"{name}: {problem}") from None

    def _check_children(self, element: Element, path: str, node: type[TreeNode], values: Mapping[str, Any]) -> None:
        n = len(element)
        if not issubclass(node, Node):
            if n:
                raise self._file.error(element, path, f"{node.__name__} is a leaf and has no children")
            return
        if n < node.least or (node.most is not None and n > node.most):
            expected = f"at least {node.least}" if node.most is None else f"{node.least} to {node.most}"
            expected = f"exactly {node.least}" if node.most == node.least else expected
            raise self._file.error(element, path, f"{node.__name__}: got {n} children, expected {expected}")
        problem = node.problem(values, n)
        if problem:
            raise self._file.error(element, path, problem)

    def _values(
        self, element: Element, path: str, kind: str, ports: Mapping[str, Port], attributes: Mapping[str, str],
        board: Blackboard,
    ) -> dict[str, Any]:  # fmt: skip
        """{port: literal or Key}, checked. A Key is checked only if a SubTree gives its value as a literal."""
        explicit = ("ID",) if element.tag in EXPLICIT else ()
        self._file.known(element, path, ("name", *ports, *explicit, *CONDITIONS))
        given = [name for name in attributes if name in ports]  # others belong to another namespace
        values = {name: self._value(element, path, name, attributes[name], ports[name], board) for name in given}
        script = SCRIPTS.get(kind, "")
        if isinstance(values.get(script), str):
            self._script(element, path, script, values[script])
        for name, port in ports.items():
            if port.default is REQUIRED and name not in attributes:
                raise self._file.error(element, path, f"{name} is missing ({port.doc})")
        return values

    def _value(self, element: Element, path: str, attribute: str, text: str, port: Port, board: Blackboard) -> Any:
        key = self._file.key(element, path, attribute, text)
        if key is None and port.direction == "out":
            example = f"a blackboard entry such as {{{attribute}}}"
            raise self._file.error(element, path, f"{attribute}: got {shown(text)}, expected {example}")
        got = shown(text)
        try:
            if key is None:
                return port.parse(text, self._context)
            board.declare(key.name).named_by(port.type)
            if port.direction != "out" and key.name in board:
                got = f"{shown(board.get(key.name))} from {key}, which a SubTree gives"
                port.accept(board.get(key.name), self._context)
            return key
        except (ValueError, OverflowError):
            expected = port.expects(self._context)
            raise self._file.error(element, path, f"{attribute}: got {got}, expected {expected}") from None

    def _subtree(
        self, element: Element, name: str, attributes: dict[str, str], board: Blackboard, path: str,
        around: tuple[str, ...],
    ) -> TreeNode | None:  # fmt: skip
        """A SubTree with its scope: {key} is remapped, anything else is a literal in the scope."""
        file, tree = self._file, attributes.pop("ID", "")
        if tree not in file.trees:
            got = f"got {shown(tree)}" if tree else "ID is missing"
            raise file.error(element, path, f"SubTree: {got}, expected {one_of(file.trees, tree)}")
        if tree in around:
            cycle = " > ".join((*around[around.index(tree) :], tree))
            raise file.error(element, path, f"{tree} contains itself: {cycle}")
        if len(element):
            raise file.error(element, path, "a SubTree has no children: what it does stands in its <BehaviorTree>")
        try:
            autoremap = AUTOREMAP.parse(attributes.pop("_autoremap", "false"))
        except ValueError:
            problem = f"_autoremap: got {shown(element.get('_autoremap'))}, expected {AUTOREMAP.expects()}"
            raise file.error(element, path, problem) from None
        for port, default in ({} if autoremap else file.models.get(tree, {})).items():
            if port not in attributes and default is None:
                raise file.error(element, path, f"{port} is missing, which its model in TreeNodesModel asks for")
        texts = {**({} if autoremap else file.models.get(tree, {})), **attributes}
        given = {port: file.key(element, path, port, text or "") or literal(text or "") for port, text in texts.items()}
        remap = {port: value.name for port, value in given.items() if isinstance(value, Key)}
        literals = {port: value for port, value in given.items() if not isinstance(value, Key)}
        for key in remap.values():
            board.declare(key)
        scope = Blackboard(board, remap, literals, autoremap=autoremap)
        inside = self._content(tree, scope, path, (*around, tree))
        if inside is None:
            return None
        node = SubTree(name, [inside], self._context.clock, scope, {**({"ID": tree} if tree != name else {}), **given})
        node.by_model = frozenset(given) - frozenset(attributes)
        return node
