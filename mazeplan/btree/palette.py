"""Writes leaves, and users' control nodes and decorators, as a TreeNodesModel. Groot2 reads it as its palette."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from lxml import etree  # pyright: ignore[reportAttributeAccessIssue]  # compiled, without stubs

from mazeplan.btree.node import TreeNode
from mazeplan.btree.ports import REQUIRED

TAGS = {"in": "input_port", "out": "output_port", "inout": "inout_port"}
TYPES = {int: "int", float: "double", bool: "bool", str: "std::string", list: "std::vector<std::string>"}  # C++ names


def write_palette(registry: Mapping[str, type[TreeNode]]) -> str:
    """TreeNodesModel of leaves and of users' control nodes and decorators: typed ports with defaults and descriptions.

    It leaves out the nodes of BehaviorTree.CPP, because the editor has them already."""
    root = etree.Element("root", BTCPP_format="4")
    model = etree.SubElement(root, "TreeNodesModel")
    for name, node in sorted(registry.items()):
        entry = etree.SubElement(model, node.category, ID=name)
        for port_name, port in node.ports.items():
            line = etree.SubElement(entry, TAGS[port.direction], name=port_name, type=TYPES[port.type])
            if port.default is not REQUIRED and port.default is not None:
                line.set("default", _written(port.default))
            line.text = port.doc
    return etree.tostring(root, pretty_print=True, encoding="unicode")


def _written(value: Any) -> str:
    """A default as text, as in a tree's file."""
    if isinstance(value, list | tuple):
        return ";".join(map(str, value))
    return str(value).lower() if isinstance(value, bool) else str(value)
