"""Coverage of a tree: which of its leaves and branches some runs exercised.

A leaf is covered when it was ticked. There are two sorts of branches:

- a child of a Fallback or ReactiveFallback: taken when it ran or succeeded, the last child whenever it was ticked;
- an outcome of a precondition: it decides in place of the node, or it lets the node be ticked.

An element of the file counts once, however often its subtree is used.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field

from mazeplan.apps.testing.record import Record
from mazeplan.apps.testing.watch import HALTED, NodeInfo
from mazeplan.core.errors import InputError

OF = ("leaves", "branches")
SHOWN = ("SUCCESS", "FAILURE", HALTED)


@dataclass
class _Element:
    """One element of a file, and what happened to it in all runs; count: how often it was ticked."""

    info: NodeInfo
    happened: set[str] = field(default_factory=set)
    count: int = 0

    @property
    def ticked(self) -> bool:
        return bool(self.happened & {"RUNNING", "SUCCESS", "FAILURE", "RAISED"})


@dataclass(frozen=True)
class Branch:
    """A branch of a tree.

    place: file:line
    what: the text that reports the branch as missing
    taken: whether any run took it"""

    place: str
    what: str
    taken: bool


class Coverage:
    """The coverage by one or more runs. Add their records with `Coverage(record, ...)` or `coverage.add(record)`."""

    def __init__(self, *records: Record) -> None:
        self._elements: dict[tuple[str, tuple[str | int, ...]], _Element] = {}
        self._children: dict[tuple[str, tuple[str | int, ...]], list[tuple[str, tuple[str | int, ...]]]] = {}
        self.runs = 0
        for record in records:
            self.add(record)

    def add(self, record: Record) -> Record:
        """Count one more run. Returns its record, so that claims can follow."""
        self.runs += 1
        keys = {info.index: (str(info.file), info.element) for info in record.nodes}
        for info in record.nodes:
            if keys[info.index] not in self._elements:
                self._elements[keys[info.index]] = _Element(info)
                if info.parent is not None:
                    self._children.setdefault(keys[info.parent], []).append(keys[info.index])
        for step in record.steps:
            element = self._elements[keys[step.node]]
            what = f"{step.what} {step.decided}" if step.what.startswith("_") else step.what
            element.happened.add(what)
            element.count += step.what in ("RUNNING", "SUCCESS", "FAILURE")
        return record

    # -- figures ----------------------------------------------------------------------------------------------------

    @property
    def leaves(self) -> float:
        """Share of the leaves that were ticked, 0 to 1."""
        return _share(element.ticked for element in self._leaves())

    @property
    def branches(self) -> float:
        """Share of the branches that were taken, 0 to 1."""
        return _share(branch.taken for branch in self.all_branches())

    def results(self, name: str) -> set[str]:
        """How the nodes of a name or kind ended a tick in any run: RUNNING, SUCCESS, FAILURE, SKIPPED, HALTED, RAISED.

        Raises InputError for a name that no tree has."""
        found = [e for e in self._elements.values() if name in (e.info.name, e.info.kind)]
        if not found:
            known = ", ".join(dict.fromkeys(element.info.name for element in self._leaves()))
            raise InputError(f"got {name!r}, expected one of {known}", key="coverage")
        return {what for element in found for what in element.happened if not what.startswith("_")}

    def missing(self, of: str = "leaves") -> list[str]:
        """A line for each leaf (or branch) that no run reached: file:line and its name. of: leaves or branches."""
        if of == "leaves":
            return [f"{e.info.place}: {e.info.short}: never ticked" for e in self._leaves() if not e.ticked]
        return [f"{branch.place}: {branch.what}" for branch in self.all_branches() if not branch.taken]

    def all_branches(self) -> list[Branch]:
        """All branches of the trees, in order."""
        out = []
        for key, element in self._elements.items():
            info, children = element.info, self._children.get(key, [])
            if info.chooses and len(children) > 1:
                for i, child in enumerate(self._elements[k] for k in children):
                    last = i == len(children) - 1
                    taken = bool(child.happened & {"RUNNING", "SUCCESS"}) or (last and child.ticked)
                    what = f"{child.info.short}: child {i + 1} of {info.kind} never taken"
                    out.append(Branch(child.info.place, what, taken))
            for name in info.conditions:
                ways = ((True, "never decided"), (False, "never let it pass"))
                out += [
                    Branch(info.place, f"{info.short}: {name} {said}", f"{name} {way}" in element.happened)
                    for way, said in ways
                ]
        return out

    def _leaves(self) -> list[_Element]:
        return [element for element in self._elements.values() if element.info.is_leaf]

    # -- for people -------------------------------------------------------------------------------------------------

    def covers(self, at_least: float = 1.0, of: str = "leaves") -> Coverage:
        """Claim that the runs covered at least a share of the leaves or branches.

        at_least: share, 0 to 1
        of: leaves or branches

        Raises AssertionError that lists the missing ones, InputError for arguments that are not allowed."""
        if of not in OF or not 0.0 <= at_least <= 1.0:
            raise InputError(f"got {at_least}, {of!r}, expected 0 to 1, and one of {', '.join(OF)}", key="covers")
        got = self.leaves if of == "leaves" else self.branches
        if not self.runs or got < at_least - 1e-9:
            missing = "\n".join(f"  {line}" for line in self.missing(of))
            said = f"expected {at_least:.0%} of the {of}, {_counted(self.runs)} covered {got:.0%}"
            raise AssertionError(f"{said}\n{missing}")
        return self

    def report(self) -> str:
        """A table of the leaves, then the leaves and branches that no run reached, with file and line."""
        branches, leaves = self.all_branches(), self._leaves()
        ticked, taken = sum(e.ticked for e in leaves), sum(b.taken for b in branches)
        width = max([len(e.info.short) for e in leaves], default=4)
        lines = [
            f"{_counted(self.runs)}: {ticked} of {len(leaves)} leaves ticked,"
            f" {taken} of {len(branches)} branches taken",
            f"{'leaf':{width}}  line   ticks  {'  '.join(SHOWN)}",
        ]
        for e in leaves:
            marks = "  ".join(f"{'x' if what in e.happened else '-':^{len(what)}}" for what in SHOWN)
            lines.append(f"{e.info.short:{width}}  {e.info.line:4d}  {e.count:6d}  {marks}")
        return "\n".join([*lines, *self.missing("leaves"), *self.missing("branches")])


def _counted(runs: int) -> str:
    return f"{runs} run" if runs == 1 else f"{runs} runs"


def _share(flags: Iterable[bool]) -> float:
    all_flags = list(flags)
    return sum(all_flags) / len(all_flags) if all_flags else 1.0
