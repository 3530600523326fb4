"""The record of a run of a tree, and claims about it: `record.reaches(5).never("ball_lost").within(8.0)`.

A claim that does not hold raises AssertionError. The message says what happened instead, with the rows of the timeline
around that moment. A claim about a name that the tree does not have raises InputError: otherwise a claim with a typing
error, such as `never("blal_lost")`, would always hold.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NoReturn

from mazeplan.btree.ports import shown
from mazeplan.core.errors import InputError
from mazeplan.core.events import FailureReported, RecoveryChosen, TimedEvent
from mazeplan.core.maths.angles import place_deg
from mazeplan.core.records import Command, FailureKind, NavigationResult
from mazeplan.maze.geometry import Maze
from mazeplan.run.resolve import ring_number

HALTED = "HALTED"
TOLERANCE = 1e-9  # s
NEAR = 7  # lines before and after a moment


@dataclass(frozen=True)
class NodeInfo:
    """A node of the tree that ran."""

    path: str  # names from the root of the main tree to the node
    name: str
    kind: str
    is_leaf: bool


@dataclass(frozen=True)
class Step:
    """One thing that happened to a node in a tick."""

    t: float  # rig time, s
    node: int  # its index in `Record.nodes`
    what: str  # RUNNING, SUCCESS, FAILURE, SKIPPED or HALTED
    ticked: bool  # whether the node itself was ticked: no precondition decided in its place


@dataclass(frozen=True)
class Tick:
    """One tick of the tree."""

    t: float  # rig time, s
    ring: int  # place of the ball: on the light rig the true place, else the estimate
    theta: float  # rad, of the same place
    seen: bool  # whether the camera saw the ball
    status: str  # of the root
    command: Command | None
    leaf: str  # that gave the command


@dataclass(repr=False)
class Record:
    """What a tree did, tick by tick.

    goal: the goal ring
    tree: its name
    nodes: all nodes, parents first
    steps: what happened to each node, in order; a node comes before its children
    reason: with a rig, why the navigation ended (arrived, stuck, out_of_time ...; rig_failed after a RigError);
        without a rig, the last status of the root
    result: of the navigation; None without a rig, or if the rig failed"""

    maze: Maze
    goal: int
    tree: str = ""
    nodes: list[NodeInfo] = field(default_factory=list)
    ticks: list[Tick] = field(default_factory=list)
    steps: list[Step] = field(default_factory=list)
    events: list[TimedEvent] = field(default_factory=list)
    reason: str = ""
    success: bool = False
    result: NavigationResult | None = None

    def __repr__(self) -> str:
        return f"<Record of {self.tree}: {self.reason} after {self.time_s:.3f} s, {len(self.ticks)} ticks>"

    # -- what happened ----------------------------------------------------------------------------------------------

    @property
    def time_s(self) -> float:
        """Rig time of the last tick, s."""
        return self.ticks[-1].t if self.ticks else 0.0

    @property
    def failures(self) -> list[str]:
        """Kinds of failure, in order."""
        return [e.event.kind for e in self.events if isinstance(e.event, FailureReported)]

    @property
    def recoveries(self) -> list[str]:
        """Names of recoveries, in order."""
        return [e.event.recovery for e in self.events if isinstance(e.event, RecoveryChosen)]

    @property
    def openings(self) -> list[str]:
        """Openings through which the ball rolled into another ring, in order; without a rig, none."""
        passages = () if self.result is None else self.result.rings
        return [passage.opening for passage in passages if passage.opening is not None]

    def statuses(self, name: str) -> list[str]:
        """How each tick of a node ended; HALTED where the node was halted. Raises InputError.

        name: name, kind or path of the node"""
        known = self._nodes(name)
        return [step.what for step in self.steps if step.node in known]

    def timeline(self, around: float | None = None) -> str:
        """What changed, one line each: leaves that take over, rings, failures, recoveries.

        around: only the lines near this time, s"""
        found = [
            (event.t, f"{event.kind} {' '.join(str(v) for v in event.detail.values() if v)}") for event in self.events
        ]
        ring, leaf, seen = None, "", True
        for tick in self.ticks:
            if tick.ring != ring:
                found.append((tick.t, f"ball in ring {tick.ring}, {place_deg(tick.theta, 0):.0f} deg"))
            if tick.seen != seen:
                found.append((tick.t, "ball seen again" if tick.seen else "ball not seen"))
            if tick.leaf and tick.leaf != leaf:
                found.append((tick.t, f"{tick.leaf} commands"))
            ring, leaf, seen = tick.ring, tick.leaf or leaf, tick.seen
        found.sort(key=lambda line: line[0])
        lines = [*found, (self.time_s, f"ended: {self.reason}")]
        if around is not None:
            middle = sum(t < around - TOLERANCE for t, _ in lines)
            lines = lines[max(0, middle - NEAR) : middle + NEAR]
        return "\n".join(f"  {t:7.3f} s  {text}" for t, text in lines)

    # -- claims -----------------------------------------------------------------------------------------------------

    def reaches(self, ring: int | str = "goal") -> Record:
        """Claim that the ball was in a ring.

        ring: number or name; "goal": the ball is in the goal ring when the tree ends with success"""
        if ring == "goal":
            if not (self.success and self.ticks[-1].ring == self.goal):
                self._fail(f"expected the tree to succeed with the ball in ring {self.goal}")
            return self
        wanted, seen = ring_number(ring, self.maze), dict.fromkeys(tick.ring for tick in self.ticks)
        if wanted not in seen:
            self._fail(f"expected the ball in ring {wanted}, it was in {', '.join(map(str, seen))}")
        return self

    def within(self, seconds: float) -> Record:
        """Claim that the tree ended after at most so many seconds of rig time."""
        if self.time_s > seconds + TOLERANCE:
            self._fail(f"expected an end within {seconds:g} s, it took {self.time_s:.3f} s")
        return self

    def ends_with(self, reason: str) -> Record:
        """Claim that the tree ended for this reason."""
        if self.reason != reason:
            self._fail(f"expected the end {shown(reason)}, got {shown(self.reason)}")
        return self

    def visits(self, *names: str) -> Record:
        """Claim that these nodes were ticked, in this order. Other nodes may be ticked in between.

        names: name, kind or path of each node"""
        at = 0
        for i, name in enumerate(names):
            known = self._nodes(name)
            ticked = [k for k, step in enumerate(self.steps) if step.node in known and step.ticked]
            if not ticked:
                self._fail(f"expected {name} to be ticked, it never was")
            if ticked[-1] < at:
                t = self.steps[at - 1].t
                self._fail(f"expected {name} to be ticked after {names[i - 1]}, it never was", t)
            at = next(k for k in ticked if k >= at) + 1
        return self

    def never(self, *what: str) -> Record:
        """Claim that something never happened. Each word is one of these:

        - name, kind or path of a node: it was never ticked
        - kind of a failure: it was never reported"""
        for name in what:
            for timed in self.events:
                if isinstance(timed.event, FailureReported) and timed.event.kind == name:
                    self._fail(f"expected never {name}, it happened at {timed.t:.3f} s", timed.t)
            known = set[int]() if name in list(FailureKind) else self._nodes(name)
            for step in self.steps:
                if step.node in known and step.ticked:
                    self._fail(f"expected {name} never to be ticked, it was at {step.t:.3f} s", step.t)
        return self

    def _nodes(self, name: str) -> set[int]:
        found = {k for k, info in enumerate(self.nodes) if name in (info.name, info.kind, info.path)}
        if not found:
            leaves = ", ".join(dict.fromkeys(info.name for info in self.nodes if info.is_leaf))
            more = "another node, or a kind of failure"
            raise InputError(f"got {shown(name)}, expected a leaf ({leaves}), {more}", key=f"tree {self.tree}")
        return found

    def _fail(self, problem: str, around: float | None = None) -> NoReturn:
        shown = self.timeline(self.time_s if around is None else around)
        raise AssertionError(f"{problem}; {self.tree} ended after {self.time_s:.3f} s: {self.reason}\n{shown}")
