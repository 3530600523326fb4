"""A wrapper that makes any rig fail on a schedule: it disturbs samples, commands and calls.

`kinds` lists the faults. Faults of the machine go to the rig inside if it has `inject`, as the simulated rig does.
The call `level` always reaches the rig.
"""

from __future__ import annotations

import math
import threading
from collections import deque
from collections.abc import Callable, Sequence
from time import monotonic
from typing import Any

import numpy as np

from mazeplan.core.errors import RigError, SettingsError
from mazeplan.core.maths.angles import difference
from mazeplan.core.records import Observation
from mazeplan.maze.geometry import Maze
from mazeplan.rigs.faults.kinds import AGE_S, KINDS, Drawn, FaultContext, sample_at
from mazeplan.rigs.interface import TOLERANCE, Rig, RigWrapper, traits
from mazeplan.rigs.sim.settings import Fault

HISTORY = 120  # samples of the rig that are kept at least: any of the last 60 may come out of order
LASTING_S = 1e6  # s, duration of a fault for good


def unsupported_faults(rig: object) -> set[str]:
    """Names of the faults that the rig's `inject` refuses."""
    cannot = traits(rig).cannot
    return {kind.name for kind in KINDS.values() if kind.machine in cannot}


class FaultyRig(RigWrapper):
    """Makes the rig inside fail by a schedule. See `interface.Rig`.

    shut: closes an opening in the program that drives the rig; aimed_at: gives this program's next opening

    Raises SettingsError for a fault of the machine that the rig inside cannot have."""

    def __init__(self, rig: Rig, maze: Maze, faults: Sequence[Drawn], shut: Callable[[str], object]) -> None:
        super().__init__(rig)
        self._maze = maze
        self._faults = tuple(faults)
        self._shut = shut
        self.aimed_at: Callable[[], str | None] = lambda: None
        self._inject = traits(rig).inject
        for fault in faults:
            if (fault.kind.machine and self._inject is None) or fault.kind.name in unsupported_faults(rig):
                raise SettingsError(f"{fault.kind.name}: this rig cannot do that; a simulated rig of the program can")
        self._chance: dict[int, np.random.Generator] = {}
        self._closed = threading.Event()
        self._clear()

    def add(self, fault: Drawn) -> None:
        """Add a fault, also during a run. Call it in the thread of the loop."""
        self._chance[id(fault)] = np.random.default_rng(fault.seed)
        self._faults = (*self._faults, fault)

    def _clear(self) -> None:
        self._past: deque[Observation] = deque(maxlen=max(HISTORY, math.ceil(AGE_S[1] * self.rate_hz) + 2))
        self._starts: dict[int, Observation] = {}  # by fault, the sample at its start
        self._queue: deque[tuple[float, float, float]] = deque()
        self.now = 0.0  # time of the last sample by the clock of the rig inside, s, without faults
        self.begun: list[Drawn] = []
        self.beyond: list[tuple[float, float]] = []  # commands, rad, that were NaN or beyond the tilt limit
        self.levelled = True  # `level` was called after the last command
        self.hangs_since: float | None = None  # when a call began to hang, monotonic clock, s
        self.idle_s = 0.0  # longest wall time from the end of `observe` to the next `observe` or `level`
        self._returned = math.inf
        self._true: dict[float, float] = {}  # by the time of a sample, the time without faults

    def reset(self, *, ring: int, theta: float, rng: np.random.Generator) -> None:
        """Reset the rig inside, and start the schedule again."""
        self.inside.reset(ring=ring, theta=theta, rng=rng)
        self._clear()
        self._chance = {id(fault): np.random.default_rng(fault.seed) for fault in self._faults}

    def observe(self) -> Observation:
        """The next sample, changed by the faults that act. Raises RigError for the fault `observe_raises`."""
        self.idle_s = max(self.idle_s, monotonic() - self._returned)
        sample = self._faulty(self.inside.observe())
        self._returned = monotonic()
        return sample

    def _faulty(self, sample: Observation) -> Observation:
        self.now = sample.t
        self._past.append(sample)
        while self._queue and self._queue[0][0] <= self.now + 1e-9:
            self.inside.command(*self._queue.popleft()[1:])
        for fault in self._faults:
            if self.now >= fault.at_s and fault not in self.begun:
                self.begun.append(fault)
                self._begin(fault, sample)
        for fault in self._acting():
            if fault.kind.name == "observe_raises":
                raise RigError("the camera does not answer (injected)")
            if fault.kind.change is not None:
                if id(fault) not in self._starts:  # kept, because a fault may last longer than the samples
                    self._starts[id(fault)] = sample_at(self._past, fault.at_s)
                chance, start = self._chance[id(fault)], self._starts[id(fault)]
                sample = fault.kind.change(FaultContext(fault, self._past, sample, chance, self._maze, start))
        self._true.setdefault(sample.t, self.now)
        return sample

    def true_time(self, t: float) -> float:
        """True rig time, s, of the first sample that carried the (perhaps wrong) time t; t if no sample did."""
        return self._true.get(t, t)

    def command(self, u_beta: float, u_gamma: float) -> None:
        """Command a tilt, unless a fault loses or delays the command."""
        limit = self._maze.tilt_limit + TOLERANCE
        if not (abs(u_beta) <= limit and abs(u_gamma) <= limit):  # also NaN
            self.beyond.append((u_beta, u_gamma))
        self.levelled = False
        acting = {fault.kind.name: fault for fault in self._acting()}
        if "commands_lost" in acting:
            return
        if "commands_late" in acting:
            self._queue.append((self.now + acting["commands_late"].size, u_beta, u_gamma))
            return
        self._queue.clear()  # this command replaces the delayed ones, which are older
        self.inside.command(u_beta, u_gamma)

    def level(self) -> None:
        """Level the plate now. No fault stops this call."""
        self.idle_s = max(self.idle_s, monotonic() - self._returned)
        self._queue.clear()
        self.inside.level()
        self.levelled = True

    def close(self) -> None:
        """Release the machine, and end a call that hangs."""
        self._closed.set()
        self.inside.close()

    def tilt_after(self, seconds: float) -> float:
        """Larger tilt of the plate `seconds` after the last fault, rad, by the rig inside (of a simulation: true)."""
        self._closed.set()
        until = max([self.now] + [f.until_s for f in self.begun if math.isfinite(f.until_s)]) + seconds
        tilts: deque[tuple[float, float]] = deque(maxlen=5)
        truth = traits(self.inside).truth
        for _ in range(math.ceil((until - self.now) * self.rate_hz)):
            sample = self.inside.observe()
            tilts.append((sample.beta, sample.gamma) if truth is None else tuple(truth()[5:7]))
        return float(np.max(np.abs(np.mean(tilts, axis=0))))

    def _acting(self) -> list[Drawn]:
        return [fault for fault in self._faults if fault.acts(self.now)]

    def _begin(self, fault: Drawn, sample: Observation) -> None:
        if fault.kind.name == "observe_hangs":
            self.hangs_since = monotonic()
            self._closed.wait(fault.size)
        elif fault.kind.place == "orders":
            for opening in self._chosen(fault, sample):
                self._shut(opening)
        elif fault.kind.machine and self._inject is not None:
            for injected in self._in_the_machine(fault, sample):
                self._inject(injected)

    def _in_the_machine(self, fault: Drawn, sample: Observation) -> list[Fault]:
        """The fault as settings of the simulated rig."""
        rng, kind = np.random.default_rng(fault.seed), fault.kind.machine
        rings = [ring.number for ring in self._maze.rings if ring.number != self._ring(sample)]
        side = -1.0 if kind == "offset_axis" and fault.seed % 2 else 1.0
        values: dict[str, Any] = {
            "kind": kind,
            "at_s": self.now,
            "duration_s": 0.0 if kind in ("push", "teleport") else min(fault.until_s - self.now, LASTING_S),
            "axis": "both" if len(fault.axes) == 2 or kind == "brown_out" else ("beta", "gamma")[fault.axes[0]],
            "direction_deg": float(rng.uniform(-180.0, 180.0)),
            "ring": int(rng.choice(rings)),
        }
        if fault.kind.machine_size:
            values[fault.kind.machine_size] = side * fault.size
        openings = self._chosen(fault, sample) if kind == "blocked" else [None]
        return [Fault.model_validate({**values, "opening": opening}) for opening in openings]

    def _ring(self, sample: Observation) -> int:
        """Ring in which the ball was seen last; 1 if the ball was never seen."""
        seen = next((s for s in reversed([*self._past, sample]) if s.x is not None and s.y is not None), None)
        return 1 if seen is None else self._maze.ring_at(math.hypot(seen.x or 0.0, seen.y or 0.0))

    def _chosen(self, fault: Drawn, sample: Observation) -> list[str]:
        """Names of the openings that the fault closes: the next opening, or all openings in its wall.

        If `aimed_at` gives no next opening, take the nearest one in the wall inside the ball's ring."""
        maze, aimed_at = self._maze, self.aimed_at()
        if aimed_at is None:
            wall = [o for o in maze.openings if o.outer == min(self._ring(sample), len(maze.rings) - 1)]
            theta = None if sample.x is None or sample.y is None else math.atan2(sample.y, sample.x)
            opening = min(wall, key=lambda o: 0.0 if theta is None else abs(difference(o.angle, theta)))
        else:
            opening = maze.opening(aimed_at)
            wall = [o for o in maze.openings if o.outer == opening.outer]
        one = fault.kind.name in ("gate_blocked", "opening_closed")
        return [opening.name] if one else [o.name for o in wall]
