"""The trees in the tests and examples of BehaviorTree.CPP: how many load here, how many there?

    python tools/btcpp_corpus.py CHECKOUT --runner PATH

Takes each XML text of the checkout: raw string literals of tests/*.cpp and examples/*.cpp, and files *.xml. Nodes that
BehaviorTree.CPP does not have are the tests' own; on both sides they become stubs with the ports that the text gives
them. A text that BehaviorTree.CPP refuses is meant to be refused, or needs other texts. Exit status 0: all that load
there load here.
"""

from __future__ import annotations

import argparse
import re
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from btcpp_cases import LEAVES, MANY, ONE
from btcpp_reference import Runner
from lxml import etree  # pyright: ignore[reportAttributeAccessIssue]  # compiled, without stubs

from mazeplan.behavior.trees import load_tree
from mazeplan.btree.controls import Control
from mazeplan.btree.decorators import Decorator
from mazeplan.btree.leaf import Leaf
from mazeplan.btree.node import TreeNode
from mazeplan.btree.ports import Port
from mazeplan.core.errors import TreeError

LITERAL = re.compile(r'R"([^()\s\\]{0,16})\((.*?)\)\1"', re.DOTALL)
BUILTIN = {*MANY, *ONE, *LEAVES} - {"Scripted", "Check", "Typed"}
EXPLICIT = ("Action", "Condition", "Control", "Decorator")
OWN = ("name", "ID")


@dataclass(frozen=True)
class Text:
    """One XML text; path: None for a literal of a source file."""

    place: str
    xml: str
    path: Path | None = None


def texts(checkout: Path) -> Iterator[Text]:
    """All XML texts of tests and examples, in order."""
    for folder in ("tests", "examples"):
        for source in sorted((checkout / folder).rglob("*.cpp")):
            code = source.read_text(encoding="utf-8", errors="replace")
            for match in LITERAL.finditer(code):
                if "<root" in match.group(2) or "<BehaviorTree" in match.group(2):
                    line = 1 + code[: match.start()].count("\n")
                    yield Text(f"{source.relative_to(checkout)}:{line}", match.group(2)[match.group(2).index("<") :])
        for path in sorted((checkout / folder).rglob("*.xml")):
            yield Text(str(path.relative_to(checkout)), path.read_text(encoding="utf-8"), path)


@dataclass
class Stub:
    """A node of the tests' own: its kind and the ports that are given to it."""

    kind: str
    ports: set[str]


def stubs(text: Text) -> dict[str, Stub]:
    """The nodes of a text, and of the files beside it, that BehaviorTree.CPP does not have."""
    beside = [p.read_text(encoding="utf-8") for p in text.path.parent.parent.rglob("*.xml")] if text.path else []
    found: dict[str, Stub] = {}
    trees: set[str] = set()
    for xml in (text.xml, *beside):
        for element in _elements(xml):
            if element.tag == "BehaviorTree":
                trees.add(element.get("ID", ""))
            else:
                _stub(element, found)
    return {name: stub for name, stub in found.items() if name not in trees}


def _elements(xml: str) -> list[Any]:
    """All elements of a text, which may have a bare & in it."""
    xml = re.sub(r"&(?!\w+;|#)", "&amp;", xml)
    root = etree.fromstring(xml.encode(), etree.XMLParser(recover=True, remove_comments=True, remove_pis=True))
    return [] if root is None else list(root.iter())


def mains(text: Text) -> list[str | None]:
    """The trees to build: all where the text does not say which is the main one; None: as the text says."""
    elements = _elements(text.xml)
    names = [e.get("ID") for e in elements if e.tag == "BehaviorTree"]
    return [None] if len(names) < 2 or not all(names) or elements[0].get("main_tree_to_execute") else names


def _stub(element: Any, found: dict[str, Stub]) -> None:
    above = [a.tag for a in element.iterancestors()]
    explicit = element.tag in EXPLICIT
    name = element.get("ID") if explicit else element.tag
    if "BehaviorTree" not in above or "TreeNodesModel" in above or name in BUILTIN or not name:
        return
    kind = element.tag if explicit else ("Action", "Decorator", "Control")[min(len(element), 2)]
    stub = found.setdefault(name, Stub(kind, set()))
    if EXPLICIT.index(kind) in (2, 3) and stub.kind != "Control":
        stub.kind = kind
    stub.ports |= {a for a in element.attrib if not a.startswith("_") and a not in OWN}


BASES: dict[str, type[TreeNode]] = {"Action": Leaf, "Condition": Leaf, "Control": Control, "Decorator": Decorator}


def class_of(stub: Stub) -> type[TreeNode]:
    """A node that takes these ports."""
    ports = {port: Port(str, None, direction="inout") for port in sorted(stub.ports)}
    return type("Stubbed", (BASES[stub.kind],), {"ports": ports})


class _Context:
    def clock(self) -> float:
        return 0.0

    def failed(self, failure: object) -> None:
        """Nothing is kept."""


def refused_here(text: Text, known: dict[str, Stub]) -> str | None:
    """What mazeplan says against a text; None: it loads."""
    nodes = {name: class_of(stub) for name, stub in known.items()}
    try:
        for main in mains(text):
            load_tree(text.path or text.xml, nodes, _Context(), main)
    except TreeError as problem:
        return str(problem)
    except Exception as problem:  # whatever it is, it is a finding
        return f"{type(problem).__name__}: {problem}"
    return None


def refused_there(text: Text, known: dict[str, Stub], runner: Runner) -> str | None:
    """What BehaviorTree.CPP says against a text; None: it loads."""
    given = [{"id": name, "kind": stub.kind, "ports": sorted(stub.ports)} for name, stub in known.items()]
    source = {"path": str(text.path)} if text.path else {"xml": text.xml}
    for main in mains(text):
        answer = runner.ask({**source, "ticks": 0, "stubs": given, **({"main": main} if main else {})})
        if not answer.get("loads"):
            return str(answer.get("error", answer.get("crash")))
    return None


def main() -> int:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("checkout", type=Path, help="folder of the sources of BehaviorTree.CPP")
    parser.add_argument("--runner", help="the program of tools/btcpp (default: $BTCPP_RUNNER)")
    parser.add_argument("--all", action="store_true", help="list those that BehaviorTree.CPP refuses, too")
    arguments = parser.parse_args()
    runner, both, neither, here, there = Runner(arguments.runner), 0, [], [], []
    for text in texts(arguments.checkout):
        known = stubs(text)
        mine, theirs = refused_here(text, known), refused_there(text, known, runner)
        if mine is None and theirs is None:
            both += 1
        elif mine is None:
            here.append(f"{text.place}: {_line(theirs)}")
        elif theirs is not None:
            neither.append(f"{text.place}: {_line(theirs)} | {_line(mine)}")
        else:
            there.append(f"{text.place}: {_line(mine)}")
    runner.close()
    print(f"load there, not here: {len(there)}", *there, sep="\n  ")
    print(f"\nload here, not there: {len(here)}", *(here if arguments.all else ()), sep="\n  ")
    print(f"\nrefused by both: {len(neither)}", *(neither if arguments.all else ()), sep="\n  ")
    print(f"\nload on both sides: {both}")
    print(f"of {both + len(there)} that load there, {both} load here")
    return 1 if there else 0


def _line(text: str | None) -> str:
    return " ".join(str(text).split())[:300]


if __name__ == "__main__":
    sys.exit(main())
