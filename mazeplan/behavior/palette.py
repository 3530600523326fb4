"""The leaves as a TreeNodesModel, which Groot2 reads as its palette."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from lxml import etree  # pyright: ignore[reportAttributeAccessIssue]  # compiled, without stubs

from mazeplan.behavior.leaf import REQUIRED, Leaf

TAGS = {"in": "input_port", "out": "output_port", "inout": "inout_port"}
TYPES = {int: "int", float: "double", bool: "bool", str: "std::string", list: "std::vector<std::string>"}  # C++ names


def write_palette(registry: Mapping[str, type[Leaf]]) -> str:
    """TreeNodesModel of all leaves: Action or Condition, with typed ports, defaults and what they are for.

    Control nodes, decorators and preconditions are left out, as BehaviorTree.CPP leaves them out: the editor has its
    own."""
    root = etree.Element("root", BTCPP_format="4")
    model = etree.SubElement(root, "TreeNodesModel")
    for name, leaf in sorted(registry.items()):
        entry = etree.SubElement(model, leaf.category, ID=name)
        for port_name, port in leaf.ports.items():
            line = etree.SubElement(entry, TAGS[port.direction], name=port_name, type=TYPES[port.type])
            if port.default is not REQUIRED and port.default is not None:
                line.set("default", _literal(port.default))
            line.text = port.doc
    return etree.tostring(root, pretty_print=True, encoding="unicode")


def _literal(value: Any) -> str:
    """A default as it would stand in a tree."""
    if isinstance(value, bool):
        return str(value).lower()
    return ";".join(value) if isinstance(value, list | tuple) else str(value)
