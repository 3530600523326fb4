"""What is to be shown of a run at one time: plain records, whatever shows them, live or afterwards.

Lengths m, angles rad, times s of the rig's clock. `story` makes moments from a run's messages.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from mazeplan.records import Array, Failure

COLUMNS = (
    "t", "x", "y", "u_beta", "u_gamma", "beta", "gamma", "theta", "planned_theta", "planner_ms", "tick_ms",
)  # fmt: skip
COLUMN = {name: i for i, name in enumerate(COLUMNS)}


@dataclass(frozen=True)
class TreeNode:
    """A node of the behaviour tree. parent: number of the node above, -1 of the root; depth: 0 of the root."""

    path: str
    kind: str
    name: str
    parent: int
    depth: int


@dataclass(frozen=True)
class Ahead:
    """The plan that is followed.

    places: (N, 2) x, y on the track of the ring; theta: (N,), continuous; t0, dt: time of the first and step;
    doubt: (N,) how far off along the ring earlier plans of this run turned out to be after as many steps, rms, m; NaN
    where too few plans are that old to tell."""

    t0: float
    dt: float
    ring: int
    theta: Array
    places: Array
    doubt: Array


@dataclass(frozen=True)
class Gate:
    """An opening and what is known of it: successes and failures as they count now, and from them the Beta posterior
    of getting through: its mean and the bounds between which it is with 90 %. next: the ball is brought there."""

    name: str
    closed: bool
    next: bool
    successes: float
    failures: float
    chance: float
    low: float
    high: float

    @property
    def tried(self) -> bool:
        """Whether anything is known of it."""
        return self.successes + self.failures > 0.05


@dataclass(frozen=True)
class Said:
    """Something that happened, in words."""

    t: float
    text: str


@dataclass(frozen=True)
class Moment:
    """A run at one time.

    run, tree: how many runs and trees have begun until now: when they change, all is new; tick: how many ticks this
    run has had, 0 before the first; header: what the run told of itself; map_text: YAML of its maze.
    ball: x, y by the estimate, None while nobody knows; seen: whether the last picture showed it.
    tilt, command: beta, gamma as measured and as commanded. rows: (N, len(COLUMNS)) of the last seconds, the newest
    last, NaN for what is not known; theta in them goes on beyond half a turn.
    statuses: a letter for each of `nodes` (`data.runlog.STATUSES`); active: numbers of those that run, with all above
    them. failure: the last one of the run, with its recovery. result: the outcome, None while it goes on."""

    run: int = 0
    tree: int = 0
    tick: int = 0
    t: float = 0.0
    header: dict[str, Any] = field(default_factory=dict)
    ring: int | None = None
    goal: int | None = None
    opening: str | None = None
    goal_theta: float | None = None
    ball: tuple[float, float] | None = None
    seen: bool = False
    tilt: tuple[float, float] = (0.0, 0.0)
    command: tuple[float, float] = (0.0, 0.0)
    rows: Array = field(default_factory=lambda: np.empty((0, len(COLUMNS))))
    plan: Ahead | None = None
    gates: tuple[Gate, ...] = ()
    nodes: tuple[TreeNode, ...] = ()
    statuses: str = ""
    active: tuple[int, ...] = ()
    leaf: str = ""
    doubts: str = ""
    failure: Failure | None = None
    failures: int = 0
    said: tuple[Said, ...] = ()
    result: dict[str, Any] | None = None

    def column(self, name: str) -> Array:
        """One column of `rows`, (N,)."""
        return self.rows[:, COLUMN[name]]

    def trail(self, seconds: float) -> Array:
        """Where the ball was, (N, 2), within the last seconds; NaN where nobody knew."""
        return self.rows[self.column("t") >= self.t - seconds][:, [COLUMN["x"], COLUMN["y"]]]
