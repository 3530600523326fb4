"""One case in BehaviorTree.CPP and in mazeplan, and what differs: the two sides of tools/differential_trees.py.

Both sides give the same record: whether the file loads, what happened in each tick, and the blackboard at the end;
tools/btcpp/README.md describes it.
"""

from __future__ import annotations

import json
import os
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any, ClassVar

from btcpp_cases import Case
from py_trees.common import Status

from mazeplan.behavior.trees import load_tree
from mazeplan.btree import tree as trees
from mazeplan.btree.leaf import Leaf
from mazeplan.btree.node import TreeNode
from mazeplan.btree.ports import REQUIRED, Port
from mazeplan.btree.status import FAILURE, RUNNING, SUCCESS, Result
from mazeplan.btree.tree import BehaviorTree
from mazeplan.core.errors import TreeError

LETTERS = {"S": SUCCESS, "F": FAILURE, "R": RUNNING}
Record = dict[str, Any]


class Runner:
    """BehaviorTree.CPP: the process of tools/btcpp/runner.cpp. Raises FileNotFoundError."""

    def __init__(self, path: str | None = None) -> None:
        path = path or os.environ.get("BTCPP_RUNNER", "")
        if not os.access(path, os.X_OK):
            raise FileNotFoundError(f"runner: got {path!r}, expected the program of tools/btcpp/README.md")
        self._process = subprocess.Popen([path], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)

    def ask(self, given: dict[str, Any]) -> Record:
        """The record of one case."""
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self._process.stdin.write(json.dumps(given) + "\n")
        self._process.stdin.flush()
        return json.loads(self._process.stdout.readline())

    def close(self) -> None:
        """End the process."""
        self._process.communicate()


@dataclass
class _Trace:
    """The context of the leaves and the probe of all nodes: what happened in this tick."""

    events: list[list[Any]] = field(default_factory=list)
    numbers: dict[int, int] = field(default_factory=dict)  # {id of a node: its number}

    def clock(self) -> float:
        return 0.0

    def failed(self, failure: object) -> None:
        """Nothing is kept."""

    def before(self, node: TreeNode) -> Result | None:
        """The tick takes place."""

    def after(self, node: TreeNode, result: Result) -> Result | None:
        """The result stays."""
        self.note("result", node, result.name)

    def note(self, what: str, node: object, *more: Any) -> None:
        self.events.append([what, self.numbers.get(id(node), -1), *more])


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


class Typed(Leaf):
    """Reads the ports that are given."""

    context: _Trace
    ports: ClassVar[dict[str, Port]] = {
        "i": Port(int, None), "d": Port(float, None), "b": Port(bool, None), "s": Port(str, None),
    }  # fmt: skip

    def step(self) -> Status:
        for port in self.ports:
            if port in self.values:
                value = self.get(port)
                self.context.note("read", self, port, _as_text(value) if port == "s" else value)
        return SUCCESS


LEAVES: dict[str, type[Leaf]] = {"Scripted": Scripted, "Check": Check, "Typed": Typed}


def _as_text(value: Any) -> str:
    """A number as BehaviorTree.CPP writes it where text is wanted."""
    return f"{value:.6f}" if isinstance(value, float) else str(int(value)) if isinstance(value, int) else str(value)


def ours(case: Case) -> Record:
    """The record of one case in mazeplan."""
    trace = _Trace()
    try:
        tree = load_tree(case.xml, LEAVES, trace)
    except TreeError as problem:
        return {"loads": False, "error": str(problem)}
    for i, node in enumerate(tree.nodes()):
        trace.numbers[id(node)] = i
        node.probe = trace
    for key, value in case.board.items():
        tree.blackboard.set_external(key, value)
    ticks: list[Record] = []
    record: Record = {"loads": True, "ticks": ticks}
    for i in range(case.ticks):
        trace.events = []
        entry: Record = {}
        try:
            if i in case.halt_before:
                tree.halt()
                trace.events.append(["halted tree"])
            for at, key, value in case.sets:
                if at == i:
                    tree.blackboard.set_external(key, value)
            with _rounds(case.once):
                entry["root"] = tree.tick().name
        except TreeError as problem:
            entry["error"] = str(problem)
        entry["events"] = trace.events
        ticks.append(entry)
        if "error" in entry:
            break
    record["board"] = boards(tree)
    if "error" not in ticks[-1]:
        trace.events = record["halted"] = []
        try:
            tree.halt()
        except TreeError as problem:
            record["halt_error"] = str(problem)
        record["board_halted"] = boards(tree)
    return record


@contextmanager
def _rounds(once: bool) -> Iterator[None]:
    """Tick the root again where a node asks for it only if `once` is true, as tickOnce does."""
    most = trees.MOST_ROUNDS
    trees.MOST_ROUNDS = most if once else 1
    try:
        yield
    finally:
        trees.MOST_ROUNDS = most


def boards(tree: BehaviorTree) -> list[Record]:
    """Values of the main tree's blackboard and of those of its subtrees, parents first."""
    scopes = [(tree.name, tree.blackboard)]
    scopes += [(str(n.values.get("ID", n.name)), n.board) for n in tree.nodes() if type(n).__name__ == "SubTree"]
    return [{"tree": name, "values": {k: _shown(v) for k, v in board.values().items()}} for name, board in scopes]


def _shown(value: Any) -> Record:
    if isinstance(value, str):
        return {"type": "text", "value": value}
    if isinstance(value, int | float):
        number = float(value)
        return {"type": "number", "value": number if abs(number) < float("inf") else str(number)}
    return {"type": type(value).__name__}


# -- what differs ----------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Difference:
    """category: load, error, halts, order, status, values, blackboard, crash; tick: in which, None: not in a tick."""

    category: str
    tick: int | None
    theirs: str
    ours: str

    def __str__(self) -> str:
        where = "" if self.tick is None else f" in tick {self.tick}"
        return f"{self.category}{where}: BehaviorTree.CPP {self.theirs}; mazeplan {self.ours}"


def difference(theirs: Record, mine: Record) -> Difference | None:
    """The first difference between two records."""
    if "crash" in theirs:
        return Difference("crash", None, theirs["crash"], str(mine.get("error", "runs")))
    if theirs["loads"] != mine["loads"]:
        return Difference("load", None, theirs.get("error", "loads"), mine.get("error", "loads"))
    if not theirs["loads"]:
        return None
    for i, (one, other) in enumerate(zip(theirs["ticks"], mine["ticks"], strict=False)):
        found = _tick(i, one, other)
        if found is not None:
            return found
    for name, kind in (("board", "blackboard"), ("halted", "halts"), ("board_halted", "blackboard")):
        one, other = theirs.get(name, []), mine.get(name, [])
        if name != "halted":
            one, other = _plain(one), _plain(other)
        if one != other:
            kind = "error" if "halt_error" in theirs or "halt_error" in mine else kind
            return Difference(kind, None, f"{one}{_last_error(theirs)}", f"{other}{_last_error(mine)}")
    return None


def _last_error(record: Record) -> str:
    """The errors at which a record ends, if it does."""
    last = record["ticks"][-1] if record["ticks"] else {}
    return "".join(f" after {r[name]}" for r, name in ((last, "error"), (record, "halt_error")) if name in r)


def _tick(i: int, theirs: Record, mine: Record) -> Difference | None:
    one = [e for e in theirs["events"] if e[-1] != "IDLE"]
    other = mine["events"]
    if ("error" in theirs) != ("error" in mine):
        return Difference("error", i, _text(theirs), _text(mine))
    for category, chosen in (
        ("order", lambda e: e[1] if e[0] == "result" else None),
        ("halts", lambda e: (e[0], e[-1]) if e[0] in ("halt", "start") else None),
        ("status", lambda e: (e[1], e[2]) if e[0] == "result" else None),
        ("values", lambda e: [*e[1:3], _number(e[3])] if e[0] == "read" else None),
        ("order", lambda e: e[:2]),
    ):
        a = [x for x in map(chosen, one) if x is not None]
        b = [x for x in map(chosen, other) if x is not None]
        if a != b:
            return Difference("error" if "error" in theirs else category, i, _text(theirs), _text(mine))
    if theirs.get("root") != mine.get("root"):
        return Difference("status", i, str(theirs.get("root")), str(mine.get("root")))
    return None


def _number(value: Any) -> Any:
    return round(float(value), 9) if isinstance(value, int | float) else value


def _plain(boards: list[Record]) -> list[tuple[str, dict[str, Any]]]:
    """Values that both sides can show; entries without a value count as absent."""
    shown = ("text", "number")
    return [
        (b["tree"], {k: _number(v["value"]) for k, v in sorted(b["values"].items()) if v["type"] in shown})
        for b in boards
    ]


def _text(tick: Record) -> str:
    """What happened in a tick."""
    events = [f"{e[1]}={e[2]}" if e[0] == "result" else " ".join(map(str, e)) for e in tick["events"]]
    return f"[{', '.join(events)}] {tick.get('error', tick.get('root'))}"
