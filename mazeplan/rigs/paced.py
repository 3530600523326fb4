"""A simulated rig at the pace of the wall clock, so that a person can watch it.

Samples come at least 1 / rate_hz apart. A late program delays them; the rig catches up by one sample at most.
Any thread may call `level_now`. It acts within one sample, also while the loop computes.
"""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable
from time import monotonic

import numpy as np

from mazeplan.core.records import Observation
from mazeplan.rigs.interface import Rig, RigWrapper

Wait = Callable[[threading.Event, float], object]


class PacedRig(RigWrapper):
    """A rig around a simulated rig, see `interface.Rig`.

    now: the clock, s.
    wait(event, seconds): waits by this clock until the event is set, but at most so long."""

    realtime = False  # still a simulation: no watchdog

    def __init__(self, rig: Rig, now: Callable[[], float] = monotonic, wait: Wait = threading.Event.wait) -> None:
        super().__init__(rig)
        self._now = now
        self._wait = wait
        self._due: float | None = None  # wall time of the next sample
        self._woken = threading.Event()  # another thread wants the loop to act now
        self._levelled = False
        self._orders: deque[Callable[[], object]] = deque()  # threads may append while another one pops

    def reset(self, *, ring: int, theta: float, rng: np.random.Generator) -> None:
        """Reset the rig inside; forget the order to level, and waiting orders."""
        super().reset(ring=ring, theta=theta, rng=rng)
        self._due = None
        self._levelled = False
        self._woken.clear()
        self._orders.clear()

    def observe(self) -> Observation:
        """The next sample, when it is due."""
        self._obey()
        sample = super().observe()
        period, due = 1.0 / self.rate_hz, self._now() if self._due is None else self._due
        while (left := due - self._now()) > 0.0:
            self._wait(self._woken, left)
            if self._woken.is_set():
                self._obey()
        # a program that is late by more than one sample does not hurry afterwards
        self._due = period + max(due, self._now() - period)
        return sample

    def command(self, u_beta: float, u_gamma: float) -> None:
        """Pass the command on; after `level_now`, level the plate instead."""
        self._obey()
        if self._levelled:
            self.inside.level()
        else:
            self.inside.command(u_beta, u_gamma)

    def _obey(self) -> None:
        """Carry out the orders of other threads. Only the loop's thread may touch the simulation."""
        if self._woken.is_set():
            self._woken.clear()
            if self._levelled:
                self.inside.level()
        while self._orders:
            self._orders.popleft()()

    def level_now(self) -> None:
        """Level the plate until the next reset, and ignore commands. Any thread may call."""
        self._levelled = True
        self._woken.set()

    def between_samples(self, order: Callable[[], object]) -> None:
        """Call `order` between two samples, in the loop's thread. Any thread may call."""
        self._orders.append(order)
