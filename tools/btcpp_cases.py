"""Random cases for tools/differential_trees.py: trees over all kinds of nodes of BehaviorTree.CPP 4, with
preconditions, postconditions, scripts over the whole language, and values on the blackboard.

Nothing depends on the wall clock: Timeout and Sleep come with 0 or a very long time, Delay with a very long one.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from random import Random
from typing import Any
from xml.sax.saxutils import quoteattr

NUMBERS, TEXTS = ("n", "x", "k"), ("word", "text")
KEYS = (*NUMBERS, *TEXTS)
BOARD: dict[str, Any] = {"n": 2, "x": 0.5, "k": 0, "word": "red", "text": "3"}
PRELUDE = "n:=2; x:=0.5; k:=0; word:='red'; text:='3'"
LONG = "10000000"  # ms
MANY = (
    "Sequence", "SequenceWithMemory", "AsyncSequence", "ReactiveSequence", "Fallback", "AsyncFallback",
    "ReactiveFallback", "Parallel", "ParallelAll", "IfThenElse", "WhileDoElse", "Switch2", "Switch3", "Switch4",
    "Switch5", "Switch6", "TryCatch",
)  # fmt: skip
ONE = (
    "Inverter", "ForceSuccess", "ForceFailure", "Repeat", "RetryUntilSuccessful", "KeepRunningUntilFailure", "RunOnce",
    "Precondition", "LoopInt", "LoopDouble", "LoopString", "LoopBool", "SkipUnlessUpdated", "WaitValueUpdate",
    "Timeout", "Delay", "SubTree",
)  # fmt: skip
LEAVES = (
    *("Scripted",) * 12, *("Check",) * 4, "Typed", *("Script",) * 4, "ScriptCondition", "SetBlackboard",
    "UnsetBlackboard", "AlwaysSuccess", "AlwaysFailure", "WasEntryUpdated", "Sleep",
)  # fmt: skip
BEFORE, AFTER = ("_failureIf", "_successIf", "_skipIf", "_while"), ("_onSuccess", "_onFailure", "_onHalted", "_post")
KINDS = frozenset({*MANY, *ONE, *LEAVES, *BEFORE, *AFTER})

Attributes = list[tuple[str, str]]


@dataclass(frozen=True)
class Case:
    """One tree and what happens to it. `sets`: (tick, key, value) of what is set before a tick; `once`: ticks go on as
    long as a node asks for it (tickOnce)."""

    xml: str
    ticks: int
    board: dict[str, Any] = field(default_factory=dict)
    halt_before: tuple[int, ...] = ()
    sets: tuple[tuple[int, str, int], ...] = ()
    seed: int | None = None
    once: bool = False

    def asked(self) -> dict[str, Any]:
        """What the runner takes."""
        given = {"xml": self.xml, "ticks": self.ticks, "board": self.board, "halt_before": list(self.halt_before)}
        return {**given, "sets": self.sets, "once": self.once}


def random_case(seed: int, only: frozenset[str] = KINDS, once: bool = False) -> Case:
    """The case of a seed; `only`: kinds of nodes and conditions that may come."""
    rng = Random(seed)
    written = "Script" in only and rng.random() < 0.5
    trees = _Trees(rng, only, written).file(PRELUDE if written else "")
    ticks = rng.randrange(3, 14)
    halts = tuple(i for i in range(1, ticks) if rng.random() < 0.08)
    sets = tuple((i, rng.choice(("n", "k")), rng.randrange(4)) for i in range(1, ticks) if rng.random() < 0.4)
    return Case(trees, ticks, {} if written else BOARD, halts, sets, seed, once)


class _Trees:
    """written: a script writes the values, so that their entries have no declared type."""

    def __init__(self, rng: Random, only: frozenset[str], written: bool) -> None:
        self.rng, self.only, self.written_first, self.names = rng, only, written, 0
        self.scripts = Scripts(rng, simple=rng.random() < 0.6)
        self.many, self.one = self.some(MANY, 5), self.some(ONE, 5)
        self.leaves = [kind for kind in LEAVES if kind in only]
        self.letters = rng.choice(("SSFR", "SFRR", "SRRR", "SSSR", "FFSR"))
        self.often = {what: rng.choice((0.0, 0.15, 0.4)) for what in ("before", "after", "to", "say")}

    def some(self, kinds: tuple[str, ...], most: int) -> list[str]:
        """A few kinds of nodes: in a tree of few kinds each meets each."""
        possible = [kind for kind in kinds if kind in self.only]
        return self.rng.sample(possible, min(len(possible), self.rng.randrange(1, most + 1)))

    def file(self, prelude: str) -> str:
        names = ["Main", *[f"T{i}" for i in range(self.rng.randrange(3) if "SubTree" in self.only else 0)]]
        trees = []
        for i, name in enumerate(names):
            self.left, self.below = self.rng.randrange(2, 16), names[i + 1 :]
            content = self.node(self.rng.randrange(1, 6))
            if prelude and name == "Main":
                content = f"<Sequence>\n<Script code={quoteattr(prelude)}/>\n{content}</Sequence>\n"
            trees.append(f'<BehaviorTree ID="{name}">\n{content}</BehaviorTree>\n')
        return f'<root BTCPP_format="4" main_tree_to_execute="Main">\n{"".join(trees)}</root>\n'

    def node(self, depth: int) -> str:
        self.left -= 1
        choices = ["leaf"] if depth <= 1 or self.left <= 0 else ["leaf", "one", "one", "many", "many", "many"]
        what = self.rng.choice(choices)
        if self.below and self.rng.random() < 0.15:
            return self.written("SubTree", self.subtree() + self.conditions())
        kinds = {"leaf": self.leaves, "one": self.one, "many": self.many}[what] or self.leaves
        kind = self.rng.choice(kinds)
        if kind == "SubTree" and not self.below:
            kind = self.rng.choice(self.leaves)
        conditions = self.conditions()
        if kind in MANY:
            n = self.children(kind)
            asks = kind in ("IfThenElse", "WhileDoElse") and "Check" in self.only and self.rng.random() < 0.85
            first = [self.written("Check", self.ports_of_leaf("Check"))] if asks else []
            inside = "".join([*first, *(self.node(depth - 1) for _ in range(n - len(first)))])
            return self.written(kind, self.ports_of_many(kind, n) + conditions, inside)
        if kind == "SubTree":
            return self.written(kind, self.subtree() + conditions)
        if kind in ONE:
            return self.written(kind, self.ports_of_one(kind) + conditions, self.node(depth - 1))
        return self.written(kind, self.ports_of_leaf(kind) + conditions)

    def written(self, kind: str, attributes: Attributes, inside: str = "") -> str:
        given = "".join(f" {name}={quoteattr(value)}" for name, value in attributes)
        return f"<{kind}{given}>\n{inside}</{kind}>\n" if inside else f"<{kind}{given}/>\n"

    def conditions(self) -> Attributes:
        given: Attributes = []
        if self.rng.random() < self.often["before"]:
            given += [(name, self.scripts.truth(2)) for name in BEFORE if name in self.only and self.rng.random() < 0.4]
        if self.rng.random() < self.often["after"]:
            given += [(name, self.scripts.program()) for name in AFTER if name in self.only and self.rng.random() < 0.5]
        return given

    def children(self, kind: str) -> int:
        if kind.startswith("Switch"):
            return int(kind[6:]) + 1 - (self.rng.random() < 0.02)
        if kind in ("IfThenElse", "WhileDoElse"):
            return self.rng.choice((2, 3, 3, 3)) if self.rng.random() < 0.97 else self.rng.choice((1, 4))
        if kind == "TryCatch":
            return self.rng.choice((2, 2, 3))
        return self.rng.randrange(1, 5)

    def ports_of_many(self, kind: str, n: int) -> Attributes:
        rng = self.rng
        if kind in ("Parallel", "ParallelAll"):
            names = ("success_count", "failure_count") if kind == "Parallel" else ("max_failures",)
            return [(name, str(rng.randrange(-n, n + 1))) for name in names if rng.random() < 0.6]
        if kind.startswith("Switch"):
            cases = [str(rng.choice((0, 1, 2, 3, "red", "blue", "0.5", "{word}", "1.0"))) for _ in range(int(kind[6:]))]
            variable = [
                (
                    "variable",
                    rng.choice(
                        ("{n}", "{k}", "{x}", "{word}", "2") if self.written_first else ("{word}", "{text}", "2")
                    ),
                )
            ]
            return variable + [(f"case_{i}", case) for i, case in enumerate(cases, 1)]
        if kind == "TryCatch" and rng.random() < 0.7:
            return [("catch_on_halt", rng.choice(("true", "false", "true")))]
        return []

    def ports_of_one(self, kind: str) -> Attributes:
        rng = self.rng
        if kind == "Repeat":
            return [("num_cycles", rng.choice(("-1", "0", "1", "2", "3", "3", "{n}")))]
        if kind == "RetryUntilSuccessful":
            return [("num_attempts", rng.choice(("-1", "0", "1", "2", "3", "3", "{n}")))]
        if kind == "RunOnce":
            return [("then_skip", rng.choice(("true", "false")))] if rng.random() < 0.6 else []
        if kind == "Precondition":
            otherwise = [("else", rng.choice(("SUCCESS", "FAILURE", "RUNNING", "SKIPPED")))]
            return [("if", self.scripts.truth(2)), *(otherwise if rng.random() < 0.8 else [])]
        if kind.startswith("Loop"):
            queue = {"LoopInt": "1;2;3", "LoopDouble": "0.5;2", "LoopString": "red;blue", "LoopBool": "true;false;1"}
            given = [("queue", queue[kind] if rng.random() < 0.8 else rng.choice(("", "1", "{text}")))]
            given += [("if_empty", rng.choice(("SUCCESS", "FAILURE", "SKIPPED")))] if rng.random() < 0.4 else []
            return given + ([("value", "{" + f"{kind.lower()}" + "}")] if rng.random() < 0.9 else [])
        if kind in ("SkipUnlessUpdated", "WaitValueUpdate"):
            key = rng.choice(NUMBERS if rng.random() < 0.9 else TEXTS)
            return [("entry", "{" + key + "}" if rng.random() < 0.9 else key)]
        time = {"Timeout": ("msec", rng.choice(("0", LONG))), "Delay": ("delay_msec", LONG)}
        return [time[kind]] if kind in time else []

    def ports_of_leaf(self, kind: str) -> Attributes:
        rng = self.rng
        if kind in ("Scripted", "Check"):
            self.names += 1
            letters = self.letters if kind == "Scripted" else "SSF"
            script = "".join(rng.choice(letters) for _ in range(rng.randrange(1, 5)))
            given = [("name", f"{kind[0].lower()}{self.names}"), ("script", script)]
            given += [("to", "{" + rng.choice(NUMBERS) + "}")] if rng.random() < self.often["to"] else []
            return given + ([("say", "{" + rng.choice(TEXTS) + "}")] if rng.random() < self.often["say"] / 2 else [])
        if kind == "Script":
            return [("code", self.scripts.program())]
        if kind == "ScriptCondition":
            return [("code", self.scripts.truth(3))]
        if kind == "SetBlackboard":
            value = rng.choice(("5", "blue", "0.5", *("{" + key + "}" for key in KEYS)))
            fits = ("fresh",) if value[0] != "{" else NUMBERS if value[1:-1] in NUMBERS else TEXTS
            return [("value", value), ("output_key", rng.choice(("fresh", *fits) if rng.random() < 0.9 else KEYS))]
        if kind == "UnsetBlackboard":
            return [("key", rng.choice(("fresh", "fresh", *KEYS)))]
        if kind == "WasEntryUpdated":
            return [("entry", "{" + rng.choice(NUMBERS if rng.random() < 0.9 else TEXTS) + "}")]
        if kind == "Sleep":
            return [("msec", rng.choice(("0", LONG)))]
        if kind == "Typed":
            given = {
                "i": ("3", "{n}", "{k}"),
                "d": ("2.5", "{x}"),
                "b": ("true", "0", "TRUE"),
                "s": ("a", "{word}"),
            }
            return [(port, rng.choice(values)) for port, values in given.items() if rng.random() < 0.35]
        return []

    def subtree(self) -> Attributes:
        rng = self.rng
        given = [("ID", rng.choice(self.below))]
        given += [("_autoremap", rng.choice(("true", "true", "1", "false")))] if rng.random() < 0.7 else []
        for key in KEYS:
            if rng.random() < 0.3:
                literals = ("1", "0", "2.5", "-3") if key in NUMBERS else ("blue", "a b", "7")
                value = rng.choice(("{" + key + "}", "{=}", "{" + rng.choice(KEYS) + "}", rng.choice(literals)))
                given.append((key, value))
        return given


class Scripts:
    """Random programs of the script language: mostly such as have a value, now and then one that has none, or that
    cannot be read. simple: short ones over counters, which change while a tree runs."""

    def __init__(self, rng: Random, simple: bool = False) -> None:
        self.rng, self.simple = rng, simple

    def damaged(self, text: str) -> str:
        """A text, seldom with a word less or more."""
        if self.simple or self.rng.random() > 0.03:
            return text
        words = text.split(" ")
        i = self.rng.randrange(len(words))
        more = self.rng.choice((":=", "=", "?", ":", "(", "&&", "..", "k := 1", "1.", "3rd", "'", "? 1 : k := 1"))
        return " ".join(words[:i] + ([more] if self.rng.random() < 0.6 else []) + words[i + 1 :]) or ";"

    def program(self) -> str:
        """Statements."""
        if self.simple:
            lines = (
                "k += 1",
                "k := 0",
                "n := k",
                "n += 1",
                "n := 0",
                "k := n",
                "x := x / 2",
                "word := 'blue'",
                "_own := k",
            )
            return "; ".join(self.rng.sample(lines, self.rng.choice((1, 1, 2))))
        return self.damaged(self.statements())

    def statements(self) -> str:
        """Statements of any kind."""
        lines = [self.statement() for _ in range(self.rng.choice((1, 1, 1, 2, 3)))]
        return self.rng.choice(("; ", ";", ";\n")).join(lines) + self.rng.choice(("", "", ";"))

    def statement(self) -> str:
        """An assignment, seldom an expression alone."""
        rng = self.rng
        kind = rng.randrange(10)
        if kind < 2:
            return f"{rng.choice(TEXTS)} {rng.choice((':=', '=', '+='))} {self.text(2)}"
        if kind == 2:
            return f"{rng.choice(('fresh', '@top', '_own'))} := {rng.choice((self.number, self.text))(2)}"
        if kind == 3:
            return self.truth(2)
        sign = rng.choice((":=", ":=", "=", "+=", "-=", "*=", "/="))
        return f"{rng.choice(('x', 'x', 'k', 'n'))} {sign} {self.number(3)}"

    def number(self, depth: int) -> str:
        """An expression that is a number."""
        rng = self.rng
        if depth <= 0 or rng.random() < 0.3:
            names = (*NUMBERS, *NUMBERS, *(("unset",) if rng.random() < 0.02 else ()))
            return rng.choice(("0", "1", "2", "3", "0.5", "1e1", "0x1F", "true", "false", *names))
        deeper: Callable[[], str] = lambda: self.number(depth - 1)  # noqa: E731  # used in each line below
        kind = rng.randrange(12)
        if kind < 5:
            return f"{deeper()} {rng.choice('+-*/')} {deeper()}"
        if kind == 5:
            return f"({deeper()})"
        if kind == 6:
            return f"{rng.choice('-~!')}{rng.choice(('', '(' + deeper() + ')')) or rng.choice(NUMBERS)}"
        if kind == 7:
            return f"{rng.choice(('n', 'k', '5', '6'))} {rng.choice('&|^')} {rng.choice(('3', '4', 'n', 'k'))}"
        if kind == 8:
            return f"{self.truth(depth - 1)} ? {deeper()} : {deeper()}"
        if kind == 9:
            return f"({rng.choice(('x', 'k'))} := {deeper()})"
        return self.truth(depth - 1)

    def text(self, depth: int) -> str:
        """An expression that is text."""
        rng = self.rng
        if depth <= 0 or rng.random() < 0.5:
            return rng.choice(("'red'", "'blue'", "''", "'4'", *TEXTS))
        kind = rng.randrange(4)
        if kind == 0:
            return f"{self.text(depth - 1)} + {self.text(depth - 1)}"
        if kind == 1:
            return f"{self.text(depth - 1)} .. {self.text(depth - 1)}"
        if kind == 2:
            return f"{self.text(0)} .. {self.number(0)}"
        return f"{self.truth(depth - 1)} ? {self.text(depth - 1)} : {self.text(depth - 1)}"

    def truth(self, depth: int) -> str:
        """An expression that is true or false."""
        rng = self.rng
        if self.simple:
            return f"{rng.choice('nk')} {rng.choice(('==', '!=', '<', '>'))} {rng.choice('0123')}"
        sign = rng.choice(("==", "!=", "<", "<=", ">", ">="))
        kind = rng.randrange(10) if depth > 0 else rng.randrange(3)
        if kind == 0:
            return rng.choice(("true", "false", "0", "1"))
        if kind in (1, 2):
            return f"{self.number(0)} {sign} {self.number(0)}"
        if kind == 3:
            return f"{self.text(1)} {rng.choice(('==', '!='))} {self.text(1)}"
        if kind == 4:
            return f"{self.truth(depth - 1)} {rng.choice(('&&', '||'))} {self.truth(depth - 1)}"
        if kind == 5:
            return f"!({self.truth(depth - 1)})"
        if kind == 6:
            return f"{self.number(0)} {sign} {self.number(0)} {rng.choice(('<', '<=', '=='))} {self.number(0)}"
        if kind == 7:
            return f"{rng.choice(('text', 'n'))} {sign} {rng.choice(('3', 'n', self.number(0)))}"
        if kind == 8:
            return f"({self.truth(depth - 1)})"
        return f"{self.number(depth - 1)} {sign} {self.number(depth - 1)}"
