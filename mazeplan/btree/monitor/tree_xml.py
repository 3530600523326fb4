"""A running tree as the XML that Groot2 asks for: each SubTree with its path, each node with its number."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from lxml import etree  # pyright: ignore[reportAttributeAccessIssue]  # compiled, without stubs

from mazeplan.btree.blackboard import Blackboard
from mazeplan.btree.decorators import SubTree
from mazeplan.btree.leaf import Leaf
from mazeplan.btree.node import TreeNode
from mazeplan.btree.palette import add_models, written
from mazeplan.btree.tree import BehaviorTree, parts_of


@dataclass(frozen=True)
class Instance:
    """One use of a tree.

    name: ID of the tree
    path: of its SubTree; empty for the main tree
    root: its root node
    board: its blackboard"""

    name: str
    path: str
    root: TreeNode
    board: Blackboard

    @property
    def label(self) -> str:
        """The name by which Groot2 asks for the blackboard."""
        return self.path or self.name


def instances(tree: BehaviorTree) -> tuple[Instance, ...]:
    """The main tree, then each SubTree.

    A path consists of names of SubTrees, joined by `/`. A SubTree without a name appears as `ID::number`, with the ID
    of its tree and the number of the node, as in BehaviorTree.CPP. Therefore paths are unique."""
    numbers = {id(node): i for i, node in enumerate(tree.nodes(), 1)}
    return (Instance(tree.name, "", tree.root, tree.blackboard), *_below(tree.root, "", numbers))


def _below(node: TreeNode, path: str, numbers: dict[int, int]) -> Iterator[Instance]:
    """The SubTrees from a node down, in order. path: of the SubTree that contains the node."""
    if isinstance(node, SubTree):
        own = node.name if node.named else f"{_name(node)}::{numbers[id(node)]}"
        path = f"{path}/{own}" if path else own
        yield Instance(_name(node), path, node.parts[0], node.board)
    for child in parts_of(node):
        yield from _below(child, path, numbers)


def tree_xml(tree: BehaviorTree) -> str:
    """The tree with `_fullpath` and `_uid`; the number of a node is its place in `tree.nodes()`, from 1."""
    numbers = {id(node): i for i, node in enumerate(tree.nodes(), 1)}
    paths = {id(instance.root): instance.path for instance in instances(tree)}
    root = etree.Element("root", BTCPP_format="4")
    for instance in instances(tree):
        top = etree.SubElement(root, "BehaviorTree", ID=instance.name, _fullpath=instance.path)
        _add(top, instance.root, numbers, paths)
    leaves = {type(node).__name__: type(node) for node in tree.nodes() if isinstance(node, Leaf)}
    add_models(etree.SubElement(root, "TreeNodesModel"), leaves)
    return etree.tostring(root, pretty_print=True, encoding="unicode")


def _name(node: SubTree) -> str:
    return str(node.values.get("ID", node.name))


def _add(parent: Any, node: TreeNode, numbers: dict[int, int], paths: dict[int, str]) -> None:
    element = etree.SubElement(parent, type(node).__name__)
    if isinstance(node, SubTree):
        element.set("ID", _name(node))
        element.set("_fullpath", paths[id(node.parts[0])])
    element.set("name", node.name)
    element.set("_uid", str(numbers[id(node)]))
    for name, text in _attributes(node):
        element.set(name, text)
    for child in () if isinstance(node, SubTree) else parts_of(node):
        _add(element, child, numbers, paths)


def _attributes(node: TreeNode) -> Iterator[tuple[str, str]]:
    for port, value in node.values.items():
        if port != "ID":
            yield port, written(value)
    for name, script in ({} if node.conditions is None else node.conditions.given).items():
        yield name, script.text
