"""A simulated rig held to the clock on the wall, so that a person can watch it: samples come 1 / rate_hz apart, and no
sooner.

It waits for nobody else: where the program is late, the rig's time stays behind the wall's and is not made up for but
by one sample. `level_now` may be called by any thread and has its way within one sample, also while the loop computes.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from time import monotonic
from typing import Any, Protocol

import numpy as np

from mazeplan.records import Observation
from mazeplan.rigs.interface import Rig


class Wall(Protocol):
    """The clock, and who waits by it."""

    def now(self) -> float:
        """s, from any moment on."""
        ...

    def wait(self, woken: threading.Event, seconds: float) -> None:
        """Until `woken` is set, or so long."""
        ...


class WallClock:
    """The real one."""

    def now(self) -> float:
        """Monotonic, s."""
        return monotonic()

    def wait(self, woken: threading.Event, seconds: float) -> None:
        """Sleep."""
        woken.wait(seconds)


class PacedRig:
    """See `interface.Rig`; around a simulation, whose other methods and marks it passes on."""

    realtime = False  # a simulation still: no watchdog

    def __init__(self, rig: Rig, wall: Wall | None = None) -> None:
        self.inside, self.rate_hz, self._wall = rig, rig.rate_hz, wall or WallClock()
        self._due: float | None = None  # when on the wall the next sample is to come
        self._woken = threading.Event()  # somebody wants the plate level
        self._levelled = False
        self._orders: list[Callable[[], object]] = []
        self._lock = threading.Lock()

    def __getattr__(self, name: str) -> Any:
        if name.startswith("_") or name == "inside":  # while being copied there is no rig yet
            raise AttributeError(name)
        return getattr(self.inside, name)

    # -- the loop's side --------------------------------------------------------------------------------------------

    def reset(self, *, ring: int, theta: float, rng: np.random.Generator) -> None:
        """As the rig inside; an order to level counts no more."""
        self.inside.reset(ring=ring, theta=theta, rng=rng)
        self._due, self._levelled = None, False
        self._woken.clear()
        with self._lock:
            self._orders.clear()

    def observe(self) -> Observation:
        """The next sample, when it is due."""
        self._obey()
        sample = self.inside.observe()
        period, due = 1.0 / self.rate_hz, self._wall.now() if self._due is None else self._due
        while (left := due - self._wall.now()) > 0.0:
            self._wall.wait(self._woken, left)
            if self._woken.is_set():
                self._obey()
        # who is late by more than one sample does not hurry afterwards
        self._due = period + max(due, self._wall.now() - period)
        return sample

    def command(self, u_beta: float, u_gamma: float) -> None:
        """As the rig inside, but level once somebody wanted it level."""
        self._obey()
        if self._levelled:
            self.inside.level()
        else:
            self.inside.command(u_beta, u_gamma)

    def level(self) -> None:
        """As the rig inside."""
        self.inside.level()

    def close(self) -> None:
        """As the rig inside."""
        self.inside.close()

    def _obey(self) -> None:
        """In the loop's thread, as the simulation is no thing for two: what others want."""
        if self._woken.is_set():
            self._woken.clear()
            if self._levelled:
                self.inside.level()
        with self._lock:
            orders, self._orders = self._orders, []
        for order in orders:
            order()

    # -- others -----------------------------------------------------------------------------------------------------

    def level_now(self) -> None:
        """The plate goes level, and stays so until the next reset, whatever is commanded. Any thread may call."""
        self._levelled = True
        self._woken.set()

    def between_samples(self, order: Callable[[], object]) -> None:
        """Have something done to the simulation between two samples, in the loop's thread. Any thread may call."""
        with self._lock:
            self._orders.append(order)
