"""Random trees, and random damage to files: material for tests/test_fuzzing.py and tools/fuzz_files.py.

A random tree is drawn from the grammar of the format: every node, ports as literals and keys, subtrees, preconditions.
Its leaves do what a die says and note what happens to them. Damage is done to bytes, lines, numbers, and to elements
and attributes of XML.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from random import Random
from typing import Any, ClassVar
from xml.sax.saxutils import quoteattr

from lxml import etree  # pyright: ignore[reportAttributeAccessIssue]  # compiled, without stubs

from mazeplan.behavior.trees import load_tree
from mazeplan.btree.leaf import Leaf
from mazeplan.btree.ports import Port
from mazeplan.btree.status import FAILURE, RUNNING, SKIPPED, SUCCESS, Status
from mazeplan.btree.tree import BehaviorTree
from mazeplan.core.errors import TreeError

TICK = 1.0 / 30.0  # s of rig time
KEYS = {"n": 2, "x": 0.5, "flag": True, "word": "red", "text": "3"}  # on the blackboard of every random tree
WRITTEN: tuple[object, ...] = (*(0, 1, 2, "0", "1") * 10, 2.5, "red", None)  # the last ones fit few expressions
OUTCOMES = (RUNNING, SUCCESS, FAILURE)
MANY = (
    "Sequence", "SequenceWithMemory", "Fallback", "ReactiveSequence", "ReactiveFallback", "Parallel", "AsyncSequence",
    "AsyncFallback", "ParallelAll", "IfThenElse", "WhileDoElse", "Switch2", "Switch4", "TryCatch",
)  # fmt: skip
COUNTS = {"IfThenElse": (2, 4), "WhileDoElse": (2, 4), "Switch2": (3, 4), "Switch4": (5, 6), "TryCatch": (2, 5)}
ONE = (
    "RetryUntilSuccessful", "Repeat", "Timeout", "Delay", "Inverter", "ForceSuccess", "ForceFailure",
    "KeepRunningUntilFailure", "RunOnce", "Precondition", "LoopInt", "LoopString", "SkipUnlessUpdated",
    "WaitValueUpdate",
)  # fmt: skip
OWN = ("AlwaysSuccess", "AlwaysFailure", "Sleep", "Script", "ScriptCondition", "SetBlackboard", "WasEntryUpdated")
SCRIPTS = ("n := 1", "n += 1", "x = 0.5; n := n * 2", "flag := !flag", "text := 'a' .. n", "n = n > 3 ? 0 : n + 1")
ENDINGS = ("_onSuccess", "_onFailure", "_onHalted", "_post")
CONDITIONS = ("_failureIf", "_successIf", "_skipIf", "_while")
ATOMS = ("n", "x", "flag", "text", "0", "1", "2.5", "-3", "true", "false") * 10 + ("unset",)
WORDS = ("word", "'red'", "'blue'", "''")


Element = Any  # the class of lxml is not public

# -- random trees --------------------------------------------------------------------------------------------------


@dataclass
class DiceRun:
    """What the leaves of a random tree share: a die, a clock in s, and what became of those that were started."""

    rng: Random
    now: float = 0.0
    started: int = 0
    open: list[Dice] = field(default_factory=list)  # started, neither finished nor halted
    wrong: list[str] = field(default_factory=list)

    def clock(self) -> float:
        return self.now

    def failed(self, failure: object) -> None:
        """Nothing is kept."""


class Dice(Leaf):
    """Ends as the die says."""

    context: DiceRun
    ports: ClassVar[dict[str, Port]] = {
        "often": Port(int, 1, "a number", least=0),
        "to": Port(str, None, "where a random value goes", "out"),
    }

    def start(self) -> None:
        if any(leaf is self for leaf in self.context.open):
            self.context.wrong.append(f"{self.name} was started twice")
        self.context.started += 1
        self.context.open.append(self)

    def step(self) -> Status:
        self.get("often")
        self.set("to", self.context.rng.choice(WRITTEN))
        status = self.context.rng.choice(OUTCOMES)
        if status is not RUNNING:
            self._leave("finished")
        return status

    def halt(self) -> None:
        self._leave("halted")

    def _leave(self, how: str) -> None:
        if all(leaf is not self for leaf in self.context.open):
            self.context.wrong.append(f"{self.name} was {how}, but did not run")
        self.context.open = [leaf for leaf in self.context.open if leaf is not self]


class Ask(Dice):
    """Answers at once."""

    category: ClassVar[str] = "Condition"

    def step(self) -> Status:
        self._leave("finished")
        return self.context.rng.choice((SUCCESS, FAILURE))


LEAVES: dict[str, type[Leaf]] = {"Dice": Dice, "Ask": Ask}
OWN_PORTS: dict[str, list[tuple[str, str]]] = {
    "Sleep": [("msec", "50")], "ScriptCondition": [("code", "n > 1")], "WasEntryUpdated": [("entry", "{n}")],
    "SetBlackboard": [("value", "2"), ("output_key", "text")],
}  # fmt: skip


def random_expression(rng: Random, depth: int = 3) -> str:
    """An expression that can be read; not each has a value."""
    kind = rng.randrange(8) if depth > 0 else 0
    if kind == 0:
        return rng.choice(ATOMS)
    if kind == 1:
        return f"{rng.choice(WORDS)} {rng.choice(('==', '!=', '<', '>='))} {rng.choice(WORDS)}"
    if kind == 2:
        return f"!({random_expression(rng, depth - 1)})"
    if kind == 3:
        return f"({random_expression(rng, depth - 1)}) / {rng.choice(('2', '0.5', 'n'))} >= 1"
    left, right = random_expression(rng, depth - 1), random_expression(rng, depth - 1)
    sign = rng.choice(("==", "!=", "<", "<=", ">", ">=", "&&", "||", "&&", "||", "+", "-", "*"))
    return f"({left}) {sign} ({right})"


def random_tree(rng: Random, most: int = 30) -> str:
    """A file with a main tree and up to three that it may use, of at most so many nodes each."""
    names = ["Main", *[f"T{i}" for i in range(rng.randrange(4))]]
    trees = []
    for i, name in enumerate(names):
        budget = [rng.randrange(1, most)]
        trees.append(f'<BehaviorTree ID="{name}">\n{_node(rng, budget, 5, names[i + 1 :])}</BehaviorTree>\n')
    return f'<root BTCPP_format="4" main_tree_to_execute="Main">\n{"".join(trees)}</root>\n'


def _node(rng: Random, budget: list[int], depth: int, below: list[str]) -> str:
    """One node with what is below it; budget: nodes that are left; below: trees that it may use."""
    budget[0] -= 1
    given = _conditions(rng)
    kinds = ["leaf"] if budget[0] <= 0 or depth == 0 else ["leaf", "one", "many", "many"]
    match rng.choice(kinds + ["tree"] * bool(below)):
        case "tree":
            given += [("_autoremap", "true")] if rng.random() < 0.8 else [("n", "{n}"), ("text", "1"), ("x", "0")]
            return _written("SubTree", [("ID", rng.choice(below)), *given])
        case "leaf":
            given += [("often", rng.choice(("2", "{n}")))] if rng.random() < 0.3 else []
            given += [("to", "{" + rng.choice(("n", "x", "flag", "text")) + "}")] if rng.random() < 0.3 else []
            kind = rng.choice(("Dice", "Dice", "Ask") * 4 + OWN)
            if kind in OWN:
                ports = [("code", rng.choice(SCRIPTS))] if kind == "Script" else OWN_PORTS.get(kind, [])
                return _written(kind, ports + [pair for pair in given if pair[0].startswith("_")])
            return _written(kind, given)
        case "one":
            kind = rng.choice(ONE)
            return _written(kind, _ports(rng, kind, 1) + given, _node(rng, budget, depth - 1, below))
        case _:
            kind = rng.choice(MANY)
            n = rng.randrange(*COUNTS.get(kind, (1, 5)))
            inside = "".join(_node(rng, budget, depth - 1, below) for _ in range(n))
            return _written(kind, _ports(rng, kind, n) + given, inside)


def _written(kind: str, attributes: list[tuple[str, str]], inside: str = "") -> str:
    given = "".join(f" {name}={quoteattr(value)}" for name, value in attributes)
    return f"<{kind}{given}>\n{inside}</{kind}>\n" if inside else f"<{kind}{given}/>\n"


def _conditions(rng: Random) -> list[tuple[str, str]]:
    if rng.random() < 0.7:
        return []
    after = [(name, rng.choice(SCRIPTS)) for name in ENDINGS if rng.random() < 0.2]
    return [(name, random_expression(rng)) for name in CONDITIONS if rng.random() < 0.4] + after


FIXED = {
    "Precondition": [("if", "n > 0"), ("else", "SKIPPED")],
    "LoopInt": [("queue", "1;2;3"), ("value", "{n}")],
    "LoopString": [("queue", "a;b"), ("value", "{word}"), ("if_empty", "FAILURE")],
    "SkipUnlessUpdated": [("entry", "{n}")],
    "WaitValueUpdate": [("entry", "{x}")],
}


def _ports(rng: Random, kind: str, n: int) -> list[tuple[str, str]]:
    if kind == "Parallel":
        ports = ("success_count", "failure_count")
        return [(port, str(rng.randrange(-n, n + 1))) for port in ports if rng.random() < 0.6]
    if kind == "ParallelAll":
        return [("max_failures", str(rng.randrange(-n, n + 1)))]
    if kind.startswith("Switch"):
        return [("variable", "{n}"), *((f"case_{i}", str(i)) for i in range(1, n))]
    if kind in FIXED:
        return FIXED[kind]
    number = {"RetryUntilSuccessful": "num_attempts", "Repeat": "num_cycles"}.get(kind)
    if number:
        return [(number, rng.choice(("-1", "0", "1", "2", "3", "{n}")))]
    time = {"Timeout": "msec", "Delay": "delay_msec"}.get(kind)
    return [(time, rng.choice(("0", "40", "200")))] if time else []


def run_tree(path: Path, rng: Random, ticks: int = 200) -> tuple[str, int]:
    """Load and tick a random tree, halt it, and see that nothing runs any more. Returns how it ended: the last status,
    or "error" for an expression or key without a value; and how many leaves were started. Raises AssertionError."""
    run = DiceRun(rng)
    tree = load_tree(path, LEAVES, run)
    for key, value in KEYS.items():
        tree.blackboard.set(key, value)
    ended, problem = "", None
    try:
        for _ in range(ticks):
            if rng.random() < 0.3:  # or few of the conditions would change while a node runs
                tree.blackboard.set(rng.choice(("n", "x", "flag", "text")), rng.choice((0, 1, 2)))
            result = tree.tick()
            ended = result.name
            assert result in (*OUTCOMES, SKIPPED), f"the root ended a tick with {result}"
            if result is not RUNNING:
                _check_idle(tree, run)
            run.now += TICK
    except TreeError as error:
        ended, problem = "error", error
    assert problem is None or (problem.file == path and problem.line), f"no place in {problem}"
    for i in range(2):  # halting what is halted does nothing
        try:
            tree.halt()
        except TreeError as error:  # of a script
            placed = error.file == path and error.line
            if i or not placed:
                raise AssertionError(f"halted twice, or no place in {error}") from None
        _check_idle(tree, run)
    assert not run.wrong, run.wrong
    return ended, run.started


def _check_idle(tree: BehaviorTree, run: DiceRun) -> None:
    running = [path for path, status in tree.snapshot() if status == "RUNNING"]
    assert not running, f"still running: {running}"
    assert not run.open, f"neither finished nor halted: {[leaf.name for leaf in run.open]}"


# -- damage --------------------------------------------------------------------------------------------------------

NASTY = (
    b"\t", b"&a ", b"*a", b"!!int ", b"{", b"]", b"- ", b": ", b"\x00", b"\xff", b".nan", b"-1e308", b"1e-320", b"'",
    b'"', b"#", b"\n", b"---\n", b"<<: ", b"null", b"true", b"[[", b"9" * 30, b"%", b"|", b"<", b">", b"/>", b"</",
    b"&amp;", b"&#0;", b"&#x41;", b"<!--", b"]]>", b"<![CDATA[", b"<?x?>", b"{x}", b"{=}", b"{{", b"\xe2\x80\xae",
    b"\xf0\x9f\x8e\xb2", b"xmlns='u' ", b"<!DOCTYPE r>", b"&e;",
)  # fmt: skip
NUMBERS = (
    "nan", ".nan", "-inf", ".inf", "1e999", "-1e308", "1e-320", "0", "-1", "-0.0", "9" * 400, "0x10", "1_0", "٣", "1,5",
    "", "2147483648", "360", "1e3", "+5", "1/2", "true",
)  # fmt: skip
VALUES = (
    *NUMBERS, "{goal}", "{=}", "{", "{a b}", "{x}{y}", " ", "a\nb", "\u202e", "x" * 3000, "missed_opening;stuck",
    "ring5", "-2", "1-2@45",
)  # fmt: skip
TAGS = (*MANY, *ONE, "SubTree", "Action", "Condition", "BehaviorTree", "root", "Track", "Settle", "include", "Allign")


def damaged_bytes(data: bytes, rng: Random) -> bytes:
    """One to four edits: bytes replaced, pieces removed, doubled, moved, or something nasty put in."""
    for _ in range(rng.randrange(1, 5)):
        a, b = sorted(rng.randrange(len(data) + 1) for _ in range(2))
        b = min(b, a + 60)
        data = rng.choice(
            (
                data[:a] + rng.randbytes(1) + data[a + 1 :],
                data[:a] + data[b:],
                data[:b] + data[a:b] + data[b:],
                data[:a] + data[b:] + data[a:b],
                data[:a] + rng.choice(NASTY) + data[a:],
            )
        )
    return data


def damaged_lines(data: bytes, rng: Random) -> bytes:
    """One to three edits: lines removed, doubled, moved, nested deeper or less deep."""
    lines = data.split(b"\n")
    for _ in range(rng.randrange(1, 4)):
        i, n = rng.randrange(len(lines)), rng.randrange(1, 6)
        block, rest = lines[i : i + n], lines[:i] + lines[i + n :]
        j = rng.randrange(len(rest) + 1)
        deeper = [b"  " * rng.randrange(1, 4) + line for line in block]
        choices = (
            rest,
            lines[:i] + block + lines[i:],
            rest[:j] + block + rest[j:],
            lines[:i] + deeper + lines[i + n :],
            lines[:i] + [line.lstrip() for line in block] + lines[i + n :],
            lines[:i] + block * rng.choice((2, 50)) + lines[i:],
        )
        lines = rng.choice(choices) or [b""]
    return b"\n".join(lines)


def damaged_numbers(data: bytes, rng: Random) -> bytes:
    """One to three numbers replaced by others that no one should write."""
    text = data.decode("utf-8")
    for _ in range(rng.randrange(1, 4)):
        found = list(re.finditer(r"-?[0-9]+(?:\.[0-9]+)?", text))
        if found:
            number = rng.choice(found)
            text = text[: number.start()] + rng.choice(NUMBERS) + text[number.end() :]
    return text.encode("utf-8")


def damaged_elements(data: bytes, rng: Random) -> bytes:
    """One to four edits of XML: elements removed, doubled, nested, moved, renamed; attributes changed."""
    root = etree.fromstring(data)
    for _ in range(rng.randrange(1, 5)):
        rng.choice(EDITS)(rng.choice([e for e in root.iter() if isinstance(e.tag, str)]), root, rng)
    return etree.tostring(root, xml_declaration=True, encoding="utf-8")


def _copy(element: Element) -> Element:
    return etree.fromstring(etree.tostring(element, with_tail=False))


def _remove(element: Element, root: Element, rng: Random) -> None:
    if element is not root:
        element.getparent().remove(element)


def _double(element: Element, root: Element, rng: Random) -> None:
    copy, home = _copy(element), element if element is root else element.getparent()
    for _ in range(rng.choice((1, 1, 30))):  # copies of what it was before, or it would grow without bound
        home.append(_copy(copy))


def _nest(element: Element, root: Element, rng: Random) -> None:
    for _ in range(rng.choice((1, 1, 70))):
        inner = _copy(element)
        for child in list(element):
            element.remove(child)
        element.append(inner)


def _move(element: Element, root: Element, rng: Random) -> None:
    rng.choice(list(root.iter("*"))).append(_copy(element))


def _rename(element: Element, root: Element, rng: Random) -> None:
    element.tag = rng.choice(TAGS)


def _attribute(element: Element, root: Element, rng: Random) -> None:
    known = list(element.attrib)
    added = rng.choice((*CONDITIONS, "ID", "name", "_autoremap", "goal", "timeout_s", "{u}x", "_onSuccess"))
    name = rng.choice(known) if known and rng.random() < 0.6 else added
    if name in known and rng.random() < 0.3:
        del element.attrib[name]
        return
    value = random_expression(rng) if rng.random() < 0.3 else rng.choice(VALUES)
    element.set(name, "".join(rng.sample(value, len(value))) if rng.random() < 0.2 else value)


EDITS: tuple[Callable[[Element, Element, Random], None], ...] = (
    _remove, _double, _nest, _move, _rename, _attribute, _attribute, _attribute, _attribute,
)  # fmt: skip
DAMAGE_TO_XML = (damaged_bytes, damaged_lines, damaged_numbers, damaged_elements, damaged_elements)
DAMAGE_TO_YAML = (damaged_bytes, damaged_lines, damaged_numbers)
