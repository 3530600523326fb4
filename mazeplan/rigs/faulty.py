"""Any rig, with faults on a schedule: what arrives from it and what reaches it is not what it should be.

The faults are those of `faultkinds`. Faults of the machine itself are handed to the rig inside, where it offers
`inject`, as the simulated one does. The safe state always gets through: `level` is never lost.
"""

from __future__ import annotations

import math
import threading
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from time import monotonic
from typing import Any, Protocol, runtime_checkable

import numpy as np

from mazeplan.errors import RigError, SettingsError
from mazeplan.maths.angles import difference
from mazeplan.maze.geometry import Maze, Opening
from mazeplan.records import Observation
from mazeplan.rigs.channelfaults import CHANGES
from mazeplan.rigs.faultschedule import Drawn
from mazeplan.rigs.interface import Rig
from mazeplan.rigs.settings import Fault

HISTORY = 120  # samples of the rig that are kept for pictures that come late
TOLERANCE = 1e-9  # rad, of the tilt limit
FOR_GOOD = 1e6  # s
IN_THE_MACHINE = {  # kinds of `settings.Fault`, and which value of it is the size
    "ball_elsewhere": ("teleport", ""), "ball_taken_out": ("removed", ""), "ball_gone": ("removed", ""),
    "ball_stuck": ("stuck", ""), "ball_pushed": ("push", "speed_m_s"),
    "gate_blocked": ("blocked", ""), "gates_blocked": ("blocked", ""),
    "servo_stuck": ("dead_axis", ""), "servo_slow": ("slow_axis", "slew_deg_s"),
    "servo_offset": ("offset_axis", "offset_deg"), "brown_out": ("brown_out", ""),
}  # fmt: skip


@runtime_checkable
class Injectable(Protocol):
    """A rig in which things can be made to go wrong."""

    def inject(self, fault: Fault) -> None:
        """Let something go wrong from its `at_s` on."""
        ...


def impossible(rig: object) -> set[str]:
    """Kinds of faults that a machine says it cannot have: `cannot`, of kinds of `settings.Fault`."""
    cannot = getattr(rig, "cannot", ())
    return {name for name, (kind, _) in IN_THE_MACHINE.items() if kind in cannot}


@dataclass
class Orders:
    """What the outside does to the program that drives: `aimed_at` is the opening that is next, `close` closes one."""

    aimed_at: Callable[[], str | None] = field(default=lambda: None)
    close: Callable[[str], object] = field(default=lambda name: None)


class FaultyRig:
    """See `interface.Rig`; around any rig, with faults drawn from a schedule.

    Afterwards `begun` tells which faults came, `beyond` the commands that were no numbers or beyond the tilt limit,
    `levelled` whether the last order was `level`, and `hangs_since`, on the monotonic clock, when a call began to hang.
    Raises SettingsError for a fault of the machine in a rig without `inject`."""

    def __init__(self, rig: Rig, maze: Maze, faults: Sequence[Drawn], orders: Orders | None = None) -> None:
        self.rate_hz, self.realtime = rig.rate_hz, getattr(rig, "realtime", True)
        self.inside, self._maze, self._faults, self.orders = rig, maze, tuple(faults), orders or Orders()
        for fault in faults:
            if fault.kind.place == "machine" and not isinstance(rig, Injectable):
                raise SettingsError(f"{fault.kind.name}: this rig has no `inject`; a simulated rig has")
            if fault.kind.name in impossible(rig):
                raise SettingsError(f"{fault.kind.name}: this rig cannot do that; a rig of the program's own can")
        self._chance: dict[int, np.random.Generator] = {}
        self._closed = threading.Event()
        self._clear()

    @property
    def now(self) -> float:
        """Rig time of the last sample, by the rig inside, s."""
        return self._now

    def add(self, fault: Drawn) -> None:
        """One more fault, also while running; in the thread of the loop."""
        self._chance[id(fault)] = np.random.default_rng(fault.seed)
        self._faults = (*self._faults, fault)

    def _clear(self) -> None:
        self._past: deque[Observation] = deque(maxlen=HISTORY)
        self._queue: deque[tuple[float, float, float]] = deque()
        self._now = 0.0
        self.begun: list[Drawn] = []
        self.beyond: list[tuple[float, float]] = []
        self.levelled = True
        self.hangs_since: float | None = None
        self._true: dict[float, float] = {}

    def reset(self, *, ring: int, theta: float, rng: np.random.Generator) -> None:
        """As the rig inside; the schedule begins anew."""
        self.inside.reset(ring=ring, theta=theta, rng=rng)
        self._clear()
        self._chance = {id(fault): np.random.default_rng(fault.seed) for fault in self._faults}

    def observe(self) -> Observation:
        """The next sample, as the faults let it arrive. Raises RigError where one says so."""
        sample = self.inside.observe()
        self._now = sample.t
        self._past.append(sample)
        while self._queue and self._queue[0][0] <= self._now + 1e-9:
            self.inside.command(*self._queue.popleft()[1:])
        for fault in self._faults:
            if self._now >= fault.at_s and fault not in self.begun:
                self.begun.append(fault)
                self._begin(fault, sample)
        for fault in self._acting():
            if fault.kind.name == "observe_raises":
                raise RigError("the camera does not answer (injected)")
            change = CHANGES.get(fault.kind.name)
            if change is not None:
                sample = change(fault, self._past, sample, self._chance[id(fault)], self._maze)
        self._true.setdefault(sample.t, self._now)
        return sample

    def true_time(self, t: float) -> float:
        """When it really was, s, as a sample that bears the time t came for the first time; t if none did."""
        return self._true.get(t, t)

    def command(self, u_beta: float, u_gamma: float) -> None:
        """Command a tilt, unless a fault loses it or keeps it for a while."""
        limit = self._maze.tilt_limit + TOLERANCE
        if not (abs(u_beta) <= limit and abs(u_gamma) <= limit):  # also NaN
            self.beyond.append((u_beta, u_gamma))
        self.levelled = False
        acting = {fault.kind.name: fault for fault in self._acting()}
        if "commands_lost" in acting:
            return
        if "commands_late" in acting:
            self._queue.append((self._now + acting["commands_late"].size, u_beta, u_gamma))
            return
        self._queue.clear()  # one that goes straight through is newer than those
        self.inside.command(u_beta, u_gamma)

    def level(self) -> None:
        """Level the plate, now, whatever is lost otherwise."""
        self._queue.clear()
        self.inside.level()
        self.levelled = True

    def close(self) -> None:
        """Give the machine back, and let go of a call that hangs."""
        self._closed.set()
        self.inside.close()

    def tilt_after(self, seconds: float) -> float:
        """Where the plate is `seconds` after the last fault that ends, rad, the larger of both axes: by the rig inside,
        as it is (of a simulated one the truth) and not as faults let it appear."""
        self._closed.set()
        until = max([self._now] + [f.until_s for f in self.begun if math.isfinite(f.until_s)]) + seconds
        tilts: deque[tuple[float, float]] = deque(maxlen=5)
        for _ in range(math.ceil((until - self._now) * self.rate_hz)):
            sample = self.inside.observe()
            truth = getattr(self.inside, "truth", None)
            tilts.append((sample.beta, sample.gamma) if truth is None else tuple(truth()[5:7]))
        return float(np.max(np.abs(np.mean(tilts, axis=0))))

    def _acting(self) -> list[Drawn]:
        return [fault for fault in self._faults if fault.acts(self._now)]

    # -- faults that begin at one moment ----------------------------------------------------------------------------

    def _begin(self, fault: Drawn, sample: Observation) -> None:
        kind = fault.kind
        if kind.name == "observe_hangs":
            self.hangs_since = monotonic()
            self._closed.wait(fault.size)
        elif kind.place == "orders":
            for opening in self._chosen(fault, sample):
                self.orders.close(opening)
        elif kind.place == "machine" and isinstance(self.inside, Injectable):
            for injected in self._in_the_machine(fault, sample):
                self.inside.inject(injected)

    def _in_the_machine(self, fault: Drawn, sample: Observation) -> list[Fault]:
        """The same in the words of the simulated rig."""
        rng, (kind, size_is) = np.random.default_rng(fault.seed), IN_THE_MACHINE[fault.kind.name]
        rings = [ring.number for ring in self._maze.rings if ring.number != self._ring(sample)]
        side = -1.0 if kind == "offset_axis" and fault.seed % 2 else 1.0
        values: dict[str, Any] = {
            "kind": kind,
            "at_s": self._now,
            "duration_s": min(fault.until_s - self._now, FOR_GOOD),
            "axis": "both" if len(fault.axes) == 2 or kind == "brown_out" else ("beta", "gamma")[fault.axes[0]],
            "direction_deg": float(rng.uniform(-180.0, 180.0)),
            "ring": int(rng.choice(rings)),
        }
        if size_is:
            values[size_is] = side * fault.size
        if kind in ("push", "teleport"):  # at one moment
            values["duration_s"] = 0.0
        if kind == "blocked":
            return [Fault.model_validate({**values, "opening": name}) for name in self._chosen(fault, sample)]
        return [Fault.model_validate(values)]

    def _ring(self, sample: Observation) -> int:
        """Where the ball was seen last; ring 1 where it never was."""
        seen = next((s for s in reversed([*self._past, sample]) if s.x is not None and s.y is not None), None)
        return 1 if seen is None else self._maze.ring_at(math.hypot(seen.x or 0.0, seen.y or 0.0))

    def _chosen(self, fault: Drawn, sample: Observation) -> list[str]:
        """Names of openings: the one that is next, or all of the wall that it is in; where nobody tells which is next,
        the nearest in the wall inside the ball's ring (in the centre: around it)."""
        maze, ring = self._maze, self._ring(sample)
        next_one = self.orders.aimed_at()
        wall = [o for o in maze.openings if o.outer == min(ring, len(maze.rings) - 1)]
        if next_one is not None:
            opening = maze.opening(next_one)
            wall = [o for o in maze.openings if o.outer == opening.outer]
        else:
            opening = min(wall, key=lambda o: self._turn(o, sample))
        one = fault.kind.name in ("gate_blocked", "opening_closed")
        return [opening.name] if one else [o.name for o in wall]

    @staticmethod
    def _turn(opening: Opening, sample: Observation) -> float:
        if sample.x is None or sample.y is None:
            return 0.0
        return abs(difference(opening.angle, math.atan2(sample.y, sample.x)))
