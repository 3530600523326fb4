"""Leaves, and control nodes and decorators of a user's own, as a TreeNodesModel: Groot2 reads it as its palette."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any

from lxml import etree  # pyright: ignore[reportAttributeAccessIssue]  # compiled, without stubs

from mazeplan.behavior.node import TreeNode
from mazeplan.behavior.ports import REQUIRED, Key

MODEL = re.compile(r"^[ \t]*<TreeNodesModel(?:/>|>.*?</TreeNodesModel>)[ \t]*\n?", re.DOTALL | re.MULTILINE)
TAGS = {"in": "input_port", "out": "output_port", "inout": "inout_port"}
TYPES = {int: "int", float: "double", bool: "bool", str: "std::string", list: "std::vector<std::string>"}  # C++ names


def write_palette(registry: Mapping[str, type[TreeNode]]) -> str:
    """TreeNodesModel of leaves and of users' own control nodes and decorators, with typed ports, defaults and what they
    are for.

    The nodes of BehaviorTree.CPP are left out, as it leaves them out: the editor has its own."""
    root = etree.Element("root", BTCPP_format="4")
    add_models(etree.SubElement(root, "TreeNodesModel"), registry)
    return etree.tostring(root, pretty_print=True, encoding="unicode")


def renewed(text: str, registry: Mapping[str, type[TreeNode]]) -> str:
    """A tree's file with the model of the leaves that it uses: its own one is replaced, or one is added at the end.
    All else stays as it is. Raises ValueError where the file has no end."""
    found = MODEL.search(text)
    kinds = {name: leaf for name, leaf in registry.items() if re.search(rf'[<"]{re.escape(name)}[\s"/>]', text)}
    if not kinds:
        return text
    model = etree.Element("TreeNodesModel")
    add_models(model, kinds)
    etree.indent(model, level=1)
    new = "  " + etree.tostring(model, encoding="unicode").rstrip() + "\n"
    if found is not None:
        return text[: found.start()] + new + text[found.end() :]
    end = text.rindex("</root>")
    return text[:end] + new + text[end:]


def without_model(text: str) -> str:
    """A tree's file without the model of leaves, which editors alone read; one with SubTrees stays, since it counts."""
    found = MODEL.search(text)
    return text if found is None or "<SubTree" in found.group() else text[: found.start()] + text[found.end() :]


def add_models(model: Any, registry: Mapping[str, type[TreeNode]]) -> None:
    """Add nodes to a TreeNodesModel element."""
    for name, leaf in sorted(registry.items()):
        entry = etree.SubElement(model, leaf.category, ID=name)
        for port_name, port in leaf.ports.items():
            line = etree.SubElement(entry, TAGS[port.direction], name=port_name, type=TYPES[port.type])
            if port.default is not REQUIRED and port.default is not None:
                line.set("default", written(port.default))
            line.text = port.doc


def written(value: Any) -> str:
    """A port's value as it stands in a tree."""
    if isinstance(value, Key):
        return f"{{{value.name}}}"
    if isinstance(value, bool):
        return str(value).lower()
    return ";".join(value) if isinstance(value, list | tuple) else str(value)
