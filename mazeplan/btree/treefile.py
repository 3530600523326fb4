"""Reads behaviour trees from XML files in BehaviorTree.CPP version 4 format, with the files that they include.

lxml reads the files without DTD, entities or network, after a check of the size. Nothing in a file is ever executed.
`builder` makes the nodes.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from os.path import isfile  # Path.is_file raises OSError for a name that is too long
from pathlib import Path
from xml.parsers import expat

from lxml import etree  # pyright: ignore[reportAttributeAccessIssue]  # compiled, without stubs

from mazeplan.btree.builder import MAX_DEPTH, Builder
from mazeplan.btree.draft import Draft, draft
from mazeplan.btree.leaf import Context
from mazeplan.btree.node import TreeNode
from mazeplan.btree.ports import one_line
from mazeplan.btree.tree import BehaviorTree
from mazeplan.btree.tree_parts import EXPLICIT, Part
from mazeplan.core.errors import TreeError

MAX_BYTES = 1 << 20
MAX_FILES = 50  # files of one tree: the file itself and all that it includes


@dataclass(frozen=True)
class TreeFile:
    """A file with the files that it includes, read once. It can build any number of trees, even if the file changes.

    parts: the file itself first"""

    parts: tuple[Part, ...]

    def build(self, registry: Mapping[str, type[TreeNode]], context: Context, main: str | None = None) -> BehaviorTree:
        """A tree that has not begun. Raises TreeError with file, line, path in the tree, and what is allowed."""
        return Builder(self.parts, registry, context).build(main)

    @property
    def files(self) -> tuple[Path, ...]:
        """The file itself, then those that it includes."""
        return tuple(part.file for part in self.parts)

    @property
    def kinds(self) -> set[str]:
        """Names of all kinds of nodes in the files."""
        elements = (element for part in self.parts for element in part.root.iter())
        return {str(e.get("ID", "")) if e.tag in EXPLICIT else str(e.tag) for e in elements}

    def draft(self, registry: Mapping[str, type[TreeNode]], context: Context, main: str | None = None) -> Draft:
        """As `build`, but returns all mistakes and does not raise the first one."""
        return draft(self.parts, registry, context, main)


def read_tree(source: str | Path, library: Path | None = None) -> TreeFile:
    """Read a file, or XML text (it begins with <). Raises TreeError if it is no XML.

    library: folder of trees that any file can include by name"""
    if isinstance(source, str) and source.lstrip().startswith("<"):
        path = Path("<text>")
        return TreeFile(tuple(_with_includes(_parse(path, source.lstrip().encode()), Path.cwd(), set(), library)))
    path = Path(source)
    first = _parse(path, _read(path))
    return TreeFile(tuple(_with_includes(first, path.parent, {path.resolve()}, library)))


def _with_includes(part: Part, folder: Path, known: set[Path], library: Path | None) -> Iterator[Part]:
    """A file, then the files that it includes, each once. Raises TreeError at the line of an <include>."""
    yield part
    if part.root.tag != "root":
        return
    for element in part.root.iterchildren("include"):
        where = {"file": part.file, "line": element.sourceline, "key": "include"}
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
        yield from _with_includes(_parse(path, _read(path)), path.parent, known, library)


EXPECTED = 'a behaviour tree (XML, <root BTCPP_format="4">)'


def _read(path: Path) -> bytes:
    """The bytes of a file, at most one more than MAX_BYTES. Raises TreeError."""
    try:
        with path.open("rb") as stream:
            return stream.read(MAX_BYTES + 1)
    except (OSError, ValueError) as problem:
        why = getattr(problem, "strerror", None) or problem
        raise TreeError(f"cannot be read: {why}; expected {EXPECTED}", file=str(path)[:200]) from None


def _parse(path: Path, data: bytes) -> Part:
    if len(data) > MAX_BYTES:
        raise TreeError(f"larger than {MAX_BYTES} bytes, which no tree is", file=path)
    if not data.strip():
        raise TreeError(f"got an empty file, expected {EXPECTED}", file=path, line=1)
    if b"<!DOCTYPE" in data or b"<!ENTITY" in data:
        line = 1 + data[: min(i for i in (data.find(b"<!DOCTYPE"), data.find(b"<!ENTITY")) if i >= 0)].count(b"\n")
        raise TreeError("document types and entities are not allowed", file=path, line=line)
    parser = etree.XMLParser(
        resolve_entities=False, no_network=True, load_dtd=False, huge_tree=False, remove_comments=True, remove_pis=True
    )
    try:
        root = etree.fromstring(data, parser)
    except etree.XMLSyntaxError as problem:
        if "Excessive depth" in str(problem.msg):  # the parser's own limit is far deeper
            raise TreeError(f"more than {MAX_DEPTH} levels of nesting", file=path, line=problem.lineno) from None
        message = re.sub(r", line \d+, column \d+.*", "", str(problem.msg))
        raise TreeError(f"not XML: {one_line(message)}; expected {EXPECTED}", file=path, line=problem.lineno) from None
    if root.getroottree().docinfo.doctype:  # a doctype in an encoding that is not like ASCII
        raise TreeError("document types and entities are not allowed", file=path)
    return Part(root, path, tuple(_stray_text(data)))


def _stray_text(data: bytes) -> list[tuple[int, str]]:
    """(line, text) of each text between elements. Leaves out text in a TreeNodesModel, which describes ports."""
    found, above, tags = dict[int, tuple[int, str]](), list[str](), 0  # found: by the number of tags before it
    parser = expat.ParserCreate()

    def start(tag: str, _: object) -> None:
        nonlocal tags
        tags += 1
        above.append(tag)

    def end(_: str) -> None:
        nonlocal tags
        tags += 1
        above.pop()

    def text(piece: str) -> None:  # a piece has at most one line
        if piece.strip() and "TreeNodesModel" not in above:
            line, before = found.get(tags, (parser.CurrentLineNumber, ""))
            found[tags] = line, f"{before} {piece.strip()}".strip()

    parser.StartElementHandler, parser.EndElementHandler, parser.CharacterDataHandler = start, end, text
    with suppress(expat.ExpatError):  # an encoding that expat does not know
        parser.Parse(data, True)
    return list(found.values())
