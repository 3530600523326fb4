"""Trees of cases.txt, what mazeplan does with them, and what BehaviorTree.CPP did with them (expected.txt).

A line a tick: the results of the nodes in the order in which their ticks ended, numbered from the root in the order of
the file, starts and halts of actions between them, then the result of the root; last of all the blackboards.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, ClassVar

from mazeplan.behavior.trees import load_tree
from mazeplan.btree import tree as trees
from mazeplan.btree.leaf import Leaf
from mazeplan.btree.ports import REQUIRED, Port
from mazeplan.btree.status import FAILURE, RUNNING, SUCCESS, Status
from mazeplan.core.errors import TreeError

FOLDER = Path(__file__).resolve().parent
LEAF = re.compile(r"\b([a-i])\(([SRF]+)((?: [^()]*)?)\)")
LETTERS = {"S": SUCCESS, "F": FAILURE, "R": RUNNING}


@dataclass(frozen=True)
class Case:
    """A tree, and before which ticks it is halted. once: a tick goes on as long as a node asks for it."""

    xml: str
    ticks: int
    halt_before: tuple[int, ...]
    once: bool


def cases() -> dict[str, Case]:
    """{name: case} of cases.txt."""
    out = {}
    for line in (FOLDER / "cases.txt").read_text().splitlines():
        if line and not line.startswith("#"):
            name, ticks, tree = (cell.strip() for cell in line.split("|", 2))
            count, *more = ticks.split()
            halts = tuple(int(more[i + 1]) for i, word in enumerate(more) if word == "halt")
            out[name] = Case(_file(tree), int(count), halts, "once" in more)
    return out


def expected() -> dict[str, list[str]]:
    """{name: lines} of expected.txt."""
    out: dict[str, list[str]] = {}
    name = ""
    for line in (FOLDER / "expected.txt").read_text().splitlines():
        if line.startswith("    "):
            out[name].append(line[4:])
        elif line and not line.startswith("#"):
            name = line
            out[name] = []
    return out


def _file(tree: str) -> str:
    main, *inner = tree.split(" ## ")
    named = [("Main", main), *(("Inner", content) for content in inner)]
    body = "".join(f'<BehaviorTree ID="{name}">{_leaves(content)}</BehaviorTree>' for name, content in named)
    return f'<root BTCPP_format="4" main_tree_to_execute="Main">{body}</root>'


def _leaves(tree: str) -> str:
    """Leaves in full, and no text between elements."""

    def leaf(found: re.Match[str]) -> str:
        kind = "Check" if found[1] in "cd" else "Scripted"
        return f'<{kind} name="{found[1]}" script="{found[2]}"{found[3]}/>'

    return re.sub(r">\s+<", "><", LEAF.sub(leaf, tree))


@dataclass
class _Trace:
    """Context of the leaves and probe of all nodes: the events of a tick."""

    events: list[str] = field(default_factory=list)
    numbers: dict[int, int] = field(default_factory=dict)  # {id of a node: its number}

    def clock(self) -> float:
        return 0.0

    def failed(self, failure: object) -> None:
        """Nothing is kept."""

    def before(self, node: object) -> None:
        """The tick takes place."""

    def after(self, node: object, result: Any) -> None:
        """The result stays."""
        self.events.append(f"{self.numbers.get(id(node), -1)}={result.name}")

    def note(self, what: str, node: object) -> None:
        self.events.append(f"{what} {self.numbers.get(id(node), -1)}")


class Scripted(Leaf):
    """Ends as its script says, one letter a tick."""

    context: _Trace
    ports: ClassVar[dict[str, Port]] = {
        "script": Port(str, REQUIRED, "letters S, F, R"),
        "to": Port(str, None, "number of ticks", "out"),
        "say": Port(str, None, "the letter", "out"),
    }
    ticks = 0

    def start(self) -> None:
        if self.category == "Action":
            self.context.note("start", self)

    def step(self) -> Status:
        script = self.get("script")
        letter = script[self.ticks % len(script)]
        self.ticks += 1
        self.set("to", self.ticks)
        self.set("say", letter)
        return LETTERS[letter]

    def halt(self) -> None:
        self.context.note("halt", self)


class Check(Scripted):
    """The same as a condition."""

    category: ClassVar[str] = "Condition"


def played(case: Case) -> list[str]:
    """What mazeplan does with a case, in lines. Of an error only that there is one: the words differ."""
    trace = _Trace()
    try:
        tree = load_tree(case.xml, {"Scripted": Scripted, "Check": Check}, trace)
    except TreeError:
        return ["refused"]
    for i, node in enumerate(tree.nodes()):
        trace.numbers[id(node)] = i
        node.probe = trace
    lines = []
    for i in range(case.ticks):
        trace.events = []
        try:
            if i in case.halt_before:
                tree.halt()
                trace.events.append("halted tree")
            with _rounds(case.once):
                root = tree.tick().name
        except TreeError:
            return [*lines, "error"]
        lines.append(f"[{', '.join(trace.events)}] {root}")
    boards = [(tree.name, tree.blackboard)]
    boards += [(str(n.values.get("ID", n.name)), n.board) for n in tree.nodes() if type(n).__name__ == "SubTree"]
    for name, board in boards:
        values = {key: _shown(value) for key, value in sorted(board.values().items()) if _plain(value)}
        lines.append(f"{name}: " + (", ".join(f"{key} = {value!r}" for key, value in values.items()) or "nothing"))
    return lines


@contextmanager
def _rounds(once: bool) -> Iterator[None]:
    """Tick the root again where a node asks for it only if `once` is true, as tickOnce does."""
    most = trees.MOST_ROUNDS
    trees.MOST_ROUNDS = most if once else 1
    try:
        yield
    finally:
        trees.MOST_ROUNDS = most


def _plain(value: Any) -> bool:
    """Whether both programs can show a value."""
    return isinstance(value, str | int | float)


def _shown(value: Any) -> Any:
    if isinstance(value, str):
        return value
    number = float(value)
    return round(number, 9) if abs(number) < float("inf") else str(number)
