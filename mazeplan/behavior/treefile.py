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

from mazeplan.behavior.builder import MAX_DEPTH, Builder
from mazeplan.behavior.draft import Draft, draft
from mazeplan.behavior.leaf import Context
from mazeplan.behavior.node import TreeNode
from mazeplan.behavior.ports import one_line
from mazeplan.behavior.tree import BehaviorTree
from mazeplan.behavior.tree_parts import EXPLICIT, Part
from mazeplan.core import file_kinds, resources
from mazeplan.core.errors import TreeError
from mazeplan.core.name_hints import one_of

MAX_BYTES = 1 << 20
MAX_FILES = 50  # files of one tree: the file itself and all that it includes


def tree_names() -> tuple[str, ...]:
    """Names of the packaged trees."""
    return tuple(sorted(path.stem for path in resources.share("behaviors").glob("*.xml")))


def load_tree(
    source: str | Path, registry: Mapping[str, type[TreeNode]], context: Context, main: str | None = None
) -> BehaviorTree:
    """Read a file, the packaged tree of that name, or XML text (it begins with <), and build the tree `main`.

    main: None: the file's main tree, or its only tree

    Raises TreeError with file, line, path in the tree, and what is allowed."""
    return read_tree(source).build(registry, context, main)


@dataclass(frozen=True)
class TreeFile:
    """A file with the files that it includes, read once. It can build any number of trees, even if the file changes.

    parts: the file itself first"""

    parts: tuple[Part, ...]

    def build(self, registry: Mapping[str, type[TreeNode]], context: Context, main: str | None = None) -> BehaviorTree:
        """A tree that has not begun. Raises as `load_tree` does."""
        return Builder(self.parts, registry, context).build(main)

    def draft(self, registry: Mapping[str, type[TreeNode]], context: Context, main: str | None = None) -> Draft:
        """As `build`, but returns all mistakes and does not raise the first one."""
        return draft(self.parts, registry, context, main)


def read_tree(source: str | Path) -> TreeFile:
    """Read a file, the packaged tree of that name, or XML text. Raises TreeError if it is no XML."""
    if isinstance(source, str) and source.lstrip().startswith("<"):
        path = Path("<text>")
        return TreeFile(tuple(_with_includes(_parse(path, source.lstrip().encode()), Path.cwd(), set())))
    path = resources.find("behaviors", source, ".xml")
    first = _parse(path, _read(path))
    return TreeFile(tuple(_with_includes(first, path.parent, {path.resolve()})))


def _with_includes(part: Part, folder: Path, known: set[Path]) -> Iterator[Part]:
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
        if not isfile(path) and Path(given).name == given:  # a packaged tree, from any folder
            path = resources.share("behaviors") / given
        if path.resolve() in known:
            continue
        known.add(path.resolve())
        if len(known) > MAX_FILES:
            raise TreeError(f"more than {MAX_FILES} files", **where)
        if not isfile(path):
            raise TreeError(
                f"got {one_line(given, 200)!r}, expected an XML file, seen from {folder}, or a packaged one", **where
            )
        yield from _with_includes(_parse(path, _read(path)), path.parent, known)


def tree_files(source: str | Path) -> tuple[Path, ...]:
    """The files of a tree: itself, then those that it includes. Raises TreeError as `read_tree` does."""
    return tuple(part.file for part in read_tree(source).parts)


def nodes_named(source: str | Path) -> set[str]:
    """Names of all kinds of nodes in a tree's file and in the files that it includes. Raises TreeError as `read_tree`
    does."""
    elements = (element for part in read_tree(source).parts for element in part.root.iter())
    return {str(e.get("ID", "")) if e.tag in EXPLICIT else str(e.tag) for e in elements}


WRITTEN = (("EntityRef", "&", "&amp;"), ("Unescaped '<'", "<", "&lt;"))  # (words of the parser's message, sign, XML)
CURLY = re.compile("=\\s*([“”„«»‘’‚])")  # quotes as a word processor writes them
EXPECTED = 'a behaviour tree (XML, <root BTCPP_format="4">)'


SPOILT = ("text that is not UTF-8", "a binary file", "YAML", "JSON", "a table (CSV)")  # may be damaged trees


def _read(path: Path) -> bytes:
    """The bytes of a file, at most one more than MAX_BYTES. Raises TreeError."""
    try:
        if not path.is_file():
            raise TreeError(file_kinds.refused(path, f"an XML file or {one_of(tree_names(), path.name)}"), file=path)
        with path.open("rb") as stream:
            return stream.read(MAX_BYTES + 1)
    except (OSError, ValueError):
        raise TreeError(file_kinds.refused(path, EXPECTED), file=str(path)[:200]) from None


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
        kind = file_kinds.got(path)
        if kind not in ("XML", "HTML", "text", "no such file"):  # "no such file": XML text that was passed in
            line = problem.lineno if kind in SPOILT else None  # where a tree is damaged; a picture has no lines
            raise TreeError(f"got {kind}, expected {EXPECTED}", file=path, line=line) from None
        if "Excessive depth" in str(problem.msg):  # the parser's own limit is far deeper
            raise TreeError(f"more than {MAX_DEPTH} levels of nesting", file=path, line=problem.lineno) from None
        row = data.splitlines()[problem.lineno - 1 : problem.lineno] if problem.lineno else []
        if "AttValue" in str(problem.msg) and row and (curly := CURLY.search(row[0].decode("utf-8", "replace"))):
            raise TreeError(f"got {curly[1]}, expected a straight quote", file=path, line=problem.lineno) from None
        message = re.sub(r", line \d+, column \d+.*", "", str(problem.msg))
        hint = next((f"; in XML {sign} is written {word}" for start, sign, word in WRITTEN if start in message), "")
        raise TreeError(f"not XML: {one_line(message)}{hint}", file=path, line=problem.lineno) from None
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
