"""Reads behaviour trees from XML files in BehaviorTree.CPP version 4 format, with the files that they include.

lxml reads the files without DTD, entities or network, after a check of the size. Nothing in a file is ever executed.
`builder` makes the nodes. `write_palette` writes the leaves and users' nodes for Groot2.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from os.path import isfile  # Path.is_file raises OSError for a name that is too long
from pathlib import Path
from typing import Any

from lxml import etree  # pyright: ignore[reportAttributeAccessIssue]  # compiled, without stubs

from mazeplan.btree.node import CONDITIONS, TreeNode
from mazeplan.btree.ports import REQUIRED, Key, one_line, shown
from mazeplan.core.errors import TreeError, nearest, one_of

MAX_BYTES = 1 << 20
MAX_FILES = 50  # files of one tree: the file itself and all that it includes
EXPECTED = 'a behaviour tree (XML, <root BTCPP_format="4">)'
FORMAT = "4"  # number of the format in BehaviorTree.CPP
ROOT_ATTRIBUTES = ("BTCPP_format", "main_tree_to_execute", "project_name")
TREE_ATTRIBUTES = (*CONDITIONS, "_autoremap")  # attributes with _ that have a meaning; others belong to editors
FORBIDDEN = " \t\n\r<>&\"'/\\:*?|."  # in names of trees, because other tools read the files
KEY = re.compile(r"\{(@?[A-Za-z_][A-Za-z0-9_.]*)\}")
BRACED = re.compile(r"\{.*\}", re.DOTALL)
WHOLE = re.compile(r"-?[0-9]{1,18}")
REAL = re.compile(r"-?[0-9]+(\.[0-9]*)?([eE][+-]?[0-9]+)?")
TAGS = {"in": "input_port", "out": "output_port", "inout": "inout_port"}
TYPES = {int: "int", float: "double", bool: "bool", str: "std::string", list: "std::vector<std::string>"}  # C++ names

Element = Any  # lxml's element class is not public
Mistakes = dict[tuple[str, int | None, str], TreeError]  # by file, line and problem: each once


@contextmanager
def keeping(mistakes: Mistakes) -> Iterator[None]:
    """A context that keeps a mistake, so that the next ones are found, too."""
    try:
        yield
    except TreeError as problem:
        mistakes.setdefault((str(problem.file), problem.line, problem.problem), problem)


class TreeFile:
    """A file with the files that it includes, read once. Any number of trees can be built of it, even if it changes.

    files: the file itself, then those that it includes
    trees: {ID: <BehaviorTree>}
    models: {ID of a SubTree: {port: default}}; default None: the port must be given
    mistakes: outside the nodes
    """

    def __init__(self, parts: Iterable[tuple[Path, Element]]) -> None:
        """Raises TreeError if a file has another format, or there is no tree."""
        self._parts = tuple(parts)
        self.files = tuple(file for file, _ in self._parts)
        self.trees: dict[str, Element] = {}
        self.models: dict[str, dict[str, str | None]] = {}
        self.mistakes: Mistakes = {}
        for _, root in self._parts:
            self._read_part(root)
        if not self.trees and not self.mistakes:
            raise self.error(self._parts[0][1], "", "no <BehaviorTree> in it")

    def error(self, element: Element, path: str, problem: str) -> TreeError:
        """The error at an element. path: the path to it in the tree."""
        path = path if len(path) <= 200 else f"...{path[-197:]}"
        return TreeError(
            one_line(problem), file=self.file_of(element), line=element.sourceline, key=one_line(path) or None
        )

    def file_of(self, element: Element) -> Path:
        """The file of an element."""
        top = element.getroottree().getroot()
        return next(file for file, root in self._parts if root is top)

    def known(self, element: Element, path: str, allowed: Iterable[str]) -> None:
        """Raises TreeError for attributes that are not in `allowed`. Ignores those of another namespace and of editors
        (_name), unless they look like one that has a meaning."""
        for attribute in map(str, element.attrib):
            meant = attribute in TREE_ATTRIBUTES or nearest(attribute, TREE_ATTRIBUTES, 0.75)
            ignored = attribute[0] == "{" or (attribute[0] == "_" and not meant)
            if attribute not in allowed and not ignored:
                expected = one_of(allowed if attribute[0] != "_" else TREE_ATTRIBUTES, attribute)
                raise self.error(element, path, f"unknown attribute {shown(attribute)}, expected {expected}")

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
        root = self._parts[0][1]
        name = given or root.get("main_tree_to_execute")
        if name is None:
            if len(self.trees) > 1:
                raise self.error(root, "", "main_tree_to_execute is missing, and there is more than one tree")
            name = next(iter(self.trees), "")
        if name not in self.trees:
            raise self.error(root, "", f"main tree: got {shown(name)}, expected {one_of(self.trees, name)}")
        return name

    def unused(self, main: str) -> Iterator[TreeError]:
        """Trees of the first file that are neither the main tree nor used by a SubTree of any file."""
        used = {main, *(e.get("ID") for tree in self.trees.values() for e in tree.iter("SubTree"))}
        for name, element in self.trees.items():
            if self.file_of(element) == self.files[0] and name not in used:
                yield self.error(element, name, "not used: it is not the main tree, and no SubTree names it")

    def _read_part(self, root: Element) -> None:
        if root.tag != "root" or root.get("BTCPP_format") != FORMAT:
            got = f"<{root.tag}>" if root.tag != "root" else f"BTCPP_format {shown(root.get('BTCPP_format'))}"
            raise self.error(root, "", f'got {got}, expected <root BTCPP_format="{FORMAT}">')
        with keeping(self.mistakes):
            self.known(root, "", ROOT_ATTRIBUTES)
        for element in root.iter():  # text is ignored, but for that of an element that has lost its <
            inside = None if str(element.tag).endswith("_port") else element.text  # the description of a port
            for where, text in (("in", inside), ("after", element.tail)):
                with keeping(self.mistakes):
                    if text is not None and ">" in text:
                        got = shown(" ".join(text.split()))
                        raise self.error(element, "", f"got the text {got} {where} <{element.tag}>: a < is missing")
        for element in root:
            with keeping(self.mistakes):
                self._read_top(element)

    def _read_top(self, element: Element) -> None:
        if element.tag == "TreeNodesModel":
            for model in element.iterchildren("SubTree"):
                ports = model.iterchildren("input_port", "output_port", "inout_port")
                defaults = {port.get("name"): port.get("default") or None for port in ports}
                if not all(defaults):
                    raise self.error(model, "TreeNodesModel", "a port without name")
                self.models.setdefault(str(model.get("ID", "")), {}).update(defaults)
        elif element.tag == "BehaviorTree":
            self._read_tree(element)
        elif element.tag != "include":
            expected = "<BehaviorTree>, <include> or <TreeNodesModel>"
            raise self.error(element, "", f"got <{element.tag}>, expected {expected}")

    def _read_tree(self, element: Element) -> None:
        name = element.get("ID")
        if not name and len(element.getparent().findall("BehaviorTree")) > 1:
            raise self.error(element, "", "<BehaviorTree> without ID, in a file with more than one")
        name = name or "BehaviorTree"
        first = self.trees.setdefault(name, element)
        if first is not element:
            where = f"{self.file_of(first)}:{first.sourceline}"
            raise self.error(element, name, f"a second tree of this name; the first is at {where}")
        if name.lower() == "root" or not name.isprintable() or set(name) & set(FORBIDDEN):
            expected = f"a name other than Root, without spaces and {FORBIDDEN.strip()}"
            raise self.error(element, "", f"ID: got {shown(name)}, expected {expected}")
        self.known(element, name, ("ID",))


def literal(text: str) -> int | float | str:
    """The value of a SubTree's literal: a number if the text reads like one, so that scripts can count with it."""
    if WHOLE.fullmatch(text):
        return int(text)
    return float(text) if REAL.fullmatch(text) else text


def read_tree(source: str | Path, library: Path | None = None) -> TreeFile:
    """Read a file, or XML text (it begins with <). Raises TreeError if it is no XML, or no tree.

    library: folder of trees that any file can include by name"""
    if isinstance(source, str) and source.lstrip().startswith("<"):
        path = Path("<text>")
        return TreeFile(_with_includes(path, _parse(path, source.lstrip().encode()), Path.cwd(), set(), library))
    path = Path(source)
    return TreeFile(_with_includes(path, _parse(path, _read(path)), path.parent, {path.resolve()}, library))


def _with_includes(
    file: Path, root: Element, folder: Path, known: set[Path], library: Path | None
) -> Iterator[tuple[Path, Element]]:
    yield file, root
    for element in root.iterchildren("include"):
        where = {"file": file, "line": element.sourceline, "key": "include"}
        given = element.get("path")
        if not given or set(element.attrib) - {"path"}:
            got = ", ".join(map(str, element.attrib)) or "no attribute"
            raise TreeError(f"got {one_line(got, 100)}, expected path alone", **where)
        path = folder / given
        if not isfile(path) and library is not None and Path(given).name == given:
            path = library / given
        if path.resolve() in known:
            continue
        known.add(path.resolve())
        if len(known) > MAX_FILES:
            raise TreeError(f"more than {MAX_FILES} files", **where)
        if not isfile(path):
            raise TreeError(f"got {one_line(given, 200)!r}, expected an XML file, seen from {folder}", **where)
        yield from _with_includes(path, _parse(path, _read(path)), path.parent, known, library)


def _read(path: Path) -> bytes:
    try:
        with path.open("rb") as stream:
            return stream.read(MAX_BYTES + 1)
    except (OSError, ValueError) as problem:
        why = getattr(problem, "strerror", None) or problem
        raise TreeError(f"cannot be read: {why}; expected {EXPECTED}", file=str(path)[:200]) from None


def _parse(path: Path, data: bytes) -> Element:
    if len(data) > MAX_BYTES:
        raise TreeError(f"larger than {MAX_BYTES} bytes, which no tree is", file=path)
    if not data.strip():
        raise TreeError(f"got an empty file, expected {EXPECTED}", file=path, line=1)
    if entity := re.search(rb"<!(DOCTYPE|ENTITY)", data):  # before anything is expanded
        line = 1 + data.count(b"\n", 0, entity.start())
        raise TreeError("document types and entities are not allowed", file=path, line=line)
    parser = etree.XMLParser(
        resolve_entities=False, no_network=True, load_dtd=False, huge_tree=False, remove_comments=True, remove_pis=True
    )
    try:
        root = etree.fromstring(data, parser)
    except etree.XMLSyntaxError as problem:
        message = re.sub(r", line \d+, column \d+.*", "", str(problem.msg))
        raise TreeError(f"not XML: {one_line(message)}; expected {EXPECTED}", file=path, line=problem.lineno) from None
    if root.getroottree().docinfo.doctype:  # a doctype in an encoding that is not like ASCII
        raise TreeError("document types and entities are not allowed", file=path)
    return root


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
