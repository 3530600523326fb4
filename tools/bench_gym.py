"""Section `gym`: samples a second of the Gymnasium environment, alone and many at once, on one thread and on two."""

from __future__ import annotations

import time
from typing import Any

import gymnasium
import numpy as np
from bench_kit import Section, Table

import mazeplan.apps.environment as room

SIZES = (1, 4, 16, 64, 256, 512)
HOLD = 5  # samples for which a drawn action stays


def rate(number: int, threads: int, seconds: float, **options: Any) -> float:
    """Samples a second of all environments together, with random actions from all rings."""
    envs = gymnasium.make_vec(room.ID, num_envs=number, threads=threads, start_ring="any", **options)
    envs.reset(seed=0)
    rng = np.random.default_rng(0)

    def play(seconds: float) -> float:
        steps, began = 0, time.perf_counter()
        actions = np.zeros((number, 2), dtype=np.float32)
        while time.perf_counter() - began < seconds:
            if steps % HOLD == 0:
                actions = rng.uniform(-1.0, 1.0, (number, 2)).astype(np.float32)
            envs.step(actions)
            steps += 1
        return steps * number / (time.perf_counter() - began)

    play(0.5 * seconds)  # models of walls are made where balls come for the first time
    reached = play(seconds)
    envs.close()
    return reached


def gym_section(quick: bool) -> Section:
    """Samples a second by the number of environments."""
    seconds = 0.5 if quick else 8.0
    table = Table(("environments", "one thread", "two threads", "of one"))
    for number in SIZES[:3] if quick else SIZES:
        one, two = (rate(number, threads, seconds) for threads in (1, 2))
        table.add(number, f"{one:,.0f}", f"{two:,.0f}", f"{two / one:.2f}")
    pixels = rate(4, 2, seconds, observation="pixels")
    table.add("4, with pictures of 96 x 96", "-", f"{pixels:,.0f}", "-")
    notes = (
        f"`{room.ID}` on `toy`, random actions held for {HOLD} samples, balls in all rings.",
        "Samples of all environments together, a second; 30 samples are 1 s of the rig.",
    )
    return Section("Gymnasium environment", notes, (table,))
