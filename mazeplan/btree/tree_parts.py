"""The elements of a tree's files by name, before nodes are made of them, and errors at their lines.

A file has <BehaviorTree>, <include> and <TreeNodesModel> at its top. `treefile` reads the file, `builder` makes the
nodes.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from mazeplan.btree.conditions import CONDITIONS
from mazeplan.btree.mistakes import EnoughError, Mistakes
from mazeplan.btree.ports import Key, one_line, shown
from mazeplan.core.errors import TreeError
from mazeplan.core.name_hints import nearest, one_of

EXPLICIT = ("Action", "Condition", "Control", "Decorator")
FORMAT = "4"  # number of the format in BehaviorTree.CPP
ROOT_ATTRIBUTES = ("BTCPP_format", "main_tree_to_execute", "project_name")
ATTRIBUTES = (*CONDITIONS, "_autoremap")  # attributes with _ that have a meaning; others belong to editors
FORBIDDEN = frozenset(" \t\n\r<>&\"'/\\:*?|.")  # in names of trees and nodes, because other tools read the files
KEY = re.compile(r"\{(@?[A-Za-z_][A-Za-z0-9_.]*)\}")
BRACED = re.compile(r"\{.*\}", re.DOTALL)
WHOLE = re.compile(r"-?[0-9]{1,18}")
REAL = re.compile(r"-?[0-9]+(\.[0-9]*)?([eE][+-]?[0-9]+)?")
TOPS = "<BehaviorTree>, <include> or <TreeNodesModel>"

ELSEWHERE = {
    **dict.fromkeys(("SequenceStar", "PopFromQueue", "ConsumeQueue", "SubTreePlus"), "BehaviorTree.CPP"),
    **dict.fromkeys(
        ("PipelineSequence", "RecoveryNode", "RoundRobin", "RateController", "DistanceController", "SpeedController",
         "GoalUpdater", "PathLongerOnApproach", "SingleTrigger", "GoalUpdated", "ComputePathToPose", "FollowPath",
         "ComputePathThroughPoses", "ClearEntireCostmap", "Spin", "BackUp", "Wait", "DriveOnHeading", "NavigateToPose"),
        "Nav2",
    ),
}  # fmt: skip

Element = Any  # lxml's element class is not public


@dataclass(frozen=True)
class Part:
    """One file of a tree: its root element. stray: (line, text) of text between its elements."""

    root: Element
    file: Path
    stray: tuple[tuple[int, str], ...] = ()


def bad_name(name: str) -> str | None:
    """What is wrong with the name of a tree or of a kind of node; None if the name is right."""
    if name in ("Root", "root"):
        return "which is reserved; expected another name"
    wrong = next((c for c in name if c in FORBIDDEN or not c.isprintable()), None)
    return None if wrong is None else f"expected a name without {wrong!r}"


def _format_problem(given: str | None) -> str:
    """Why a tree with this BTCPP_format cannot be read."""
    if given is None:
        return f"missing, expected '{FORMAT}': add it if the tree was made for BehaviorTree.CPP {FORMAT}"
    return f"got {shown(given)}, expected '{FORMAT}'"


def _root_problem(root: Element) -> str | None:
    """Why a file with this root element cannot be read; None if it can."""
    if root.tag != "root":
        return f'got <{root.tag}>, expected <root BTCPP_format="4">'
    given = root.get("BTCPP_format")
    return None if given == FORMAT else f"BTCPP_format: {_format_problem(given)}"


class TreeParts:
    """The top elements of a file and of the files that it includes. Raises TreeError, unless `mistakes` keeps it.

    trees: {ID: <BehaviorTree>}
    models: {ID of a SubTree: {port: default}}; default None: the port must be given
    taken: tells whether a name is that of a node, which no tree may have
    """

    def __init__(self, parts: Sequence[Part], taken: Callable[[str], bool], mistakes: Mistakes) -> None:
        self.first, self._taken, self._mistakes = parts[0], taken, mistakes
        self._of = {id(part.root): part.file for part in parts}
        self.trees: dict[str, Element] = {}
        self.models: dict[str, dict[str, str | None]] = {}
        self._stray = list[TreeError]()
        for part in parts:
            with mistakes:
                self._read_part(part.root)
            for line, text in part.stray:
                error = TreeError(f"got the text {shown(text)}, expected elements alone", file=part.file, line=line)
                if ">" not in text:  # BehaviorTree.CPP ignores such text
                    self._stray.append(error)
                    continue
                with mistakes:  # an element that has lost its <
                    raise error
        if _root_problem(self.first.root) is not None or (not self.trees and mistakes.noted):
            raise EnoughError("enough")  # further mistakes would only follow from those found
        if not self.trees:
            raise mistakes.last(self.error(self.first.root, "", "no <BehaviorTree> in it"))

    def error(self, element: Element, path: str, problem: str) -> TreeError:
        """The error at an element. path: the path to it in the tree."""
        path = path if len(path) <= 200 else f"...{path[-197:]}"
        return TreeError(
            one_line(problem), file=self.file_of(element), line=element.sourceline, key=one_line(path) or None
        )

    def file_of(self, element: Element) -> Path:
        """The file of an element."""
        return self._of[id(element.getroottree().getroot())]

    def known(self, element: Element, path: str, allowed: Iterable[str]) -> None:
        """Raises TreeError for attributes that are not in `allowed`. Ignores those of another namespace and of editors
        (_name)."""
        for attribute in map(str, element.attrib):
            if attribute not in allowed and not attribute.startswith(("{", "_")):
                problem = f"unknown attribute {shown(attribute)}, expected {one_of(allowed, attribute)}"
                raise self.error(element, path, problem)

    def key(self, element: Element, path: str, attribute: str, text: str) -> Key | None:
        """The key for {key} or {=}; None for a literal. Raises TreeError for other text in braces."""
        text = text.strip()
        if not BRACED.fullmatch(text):
            return None
        key = KEY.fullmatch(text)
        if not key and text != "{=}":
            allowed = "{key} of letters, digits, _ and ., or {=}"
            raise self.error(element, path, f"{attribute}: got {shown(text)}, expected {allowed}")
        return Key(key.group(1) if key else attribute)

    def main(self, given: str | None) -> str:
        """Name of the tree to execute: `given`, else the file's main tree, else its only tree."""
        root = self.first.root
        name = given or root.get("main_tree_to_execute")
        if name is None:
            if len(self.trees) > 1:
                raise self.error(root, "", "main_tree_to_execute is missing, and there is more than one tree")
            name = next(iter(self.trees))
        if name not in self.trees:
            raise self.error(root, "", f"main tree: got {shown(name)}, expected {one_of(self.trees, name)}")
        return name

    def remarks(self, main: str) -> tuple[TreeError, ...]:
        """Remarks on the files:
        - trees of the first file that are neither the main tree nor used by a SubTree of any file,
        - attributes that are ignored but look like attributes with a meaning,
        - text between elements, unless it looks like an element that lost its <."""
        used = {main, *(e.get("ID") for tree in self.trees.values() for e in tree.iter("SubTree"))}
        unused = [
            self.error(element, name, "not used: it is not the main tree, and no SubTree names it")
            for name, element in self.trees.items()
            if self.file_of(element) == self.first.file and name not in used
        ]
        return *unused, *self._slips(), *self._stray

    def _slips(self) -> Iterator[TreeError]:
        for name, tree in self.trees.items():
            for element in tree.iter():
                kept = () if element is tree else ATTRIBUTES if element.tag == "SubTree" else CONDITIONS
                for attribute in map(str, element.attrib):
                    near = attribute if attribute in ATTRIBUTES else nearest(attribute, ATTRIBUTES, 0.75)
                    if near and attribute[0] == "_" and attribute not in kept:
                        hint = "" if attribute in ATTRIBUTES else f"; did you mean {near}?"
                        yield self.error(element, name, f"{attribute} is ignored here{hint}")

    def _read_part(self, root: Element) -> None:
        problem = _root_problem(root)
        if problem is not None:
            raise self.error(root, "", problem)
        with self._mistakes:
            self.known(root, "", ROOT_ATTRIBUTES)
        for element in root:
            with self._mistakes:
                self._top(element)

    def _top(self, element: Element) -> None:
        if element.tag == "TreeNodesModel":
            for model in element.iterchildren("SubTree"):
                self._model(model)
        elif element.tag == "BehaviorTree":
            self._tree(element)
        elif element.tag != "include":
            raise self.error(element, "", f"got <{element.tag}>, expected {TOPS}")

    def _tree(self, element: Element) -> None:
        name = element.get("ID")
        if not name and len(element.getparent().findall("BehaviorTree")) > 1:
            raise self.error(element, "", "<BehaviorTree> without ID, in a file with more than one")
        name = name or "BehaviorTree"
        if name in self.trees:
            first = self.trees[name]
            if self.file_of(first) == self.first.file != self.file_of(element):  # users may not edit the included file
                where = f"{self.file_of(element)}:{element.sourceline}"
                raise self.error(first, name, f"an included file has a tree of this name, too: {where}")
            where = f"{self.file_of(first)}:{first.sourceline}"
            raise self.error(element, name, f"a second tree of this name; the first is at {where}")
        with self._mistakes:
            self._check_tree(element, name)
        self.trees[name] = element

    def _check_tree(self, element: Element, name: str) -> None:
        problem = bad_name(name) or ("which is the name of a node" if self._taken(name) else None)
        if problem is not None:
            raise self.error(element, "", f"ID: got {shown(name)}, {problem}")
        self.known(element, name, ("ID",))

    def _model(self, model: Element) -> None:
        """Read the ports of a SubTree into `models`. A port without a default must be given."""
        ports = self.models.setdefault(str(model.get("ID", "")), {})
        for port in model.iterchildren("input_port", "output_port", "inout_port"):
            name = port.get("name")
            if not name:
                raise self.error(port, "TreeNodesModel", f"<{port.tag}> without name")
            ports[name] = port.get("default") or None


def literal(text: str) -> int | float | str:
    """The value of a SubTree's literal: a number if the text reads like one, so that scripts can count with it."""
    if WHOLE.fullmatch(text):
        return int(text)
    return float(text) if REAL.fullmatch(text) else text
