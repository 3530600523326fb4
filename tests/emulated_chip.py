"""The emulated board for tests: the real firmware in simavr. Skipped where it is not built (make emulator)."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from emulator.chip import EmulatedChip, built

from mazeplan.core.errors import RigError
from mazeplan.rigs.link.protocol import encode

EMULATED = Path(__file__).resolve().parents[1] / "tools" / "emulated.yaml"
NEEDED = os.environ.get("MAZEPLAN_EMULATOR") == "needed"  # set where the packages are: nothing is skipped there


@pytest.fixture
def chip() -> Iterator[EmulatedChip]:
    try:
        parts = built()
    except RigError as missing:
        if NEEDED:
            raise
        pytest.skip(str(missing))
    with EmulatedChip(*parts) as chip:
        yield chip


def random_frame(rng: np.random.Generator) -> bytearray:
    """One that the board may obey, or with anything in it."""
    draw = rng.random()
    if draw < 0.3:
        return bytearray(encode("C", *rng.integers(1, 1 << 16, 3).tolist()))
    if draw < 0.4:
        low, level, high = sorted(rng.integers(0, 1 << 16, 3).tolist())
        return bytearray(encode("L", 1, int(rng.integers(2)), low, high, level, int(rng.integers(1, 1 << 16))))
    return bytearray(encode("CCLZIQ"[rng.integers(6)], *rng.integers(0, 1 << 17, rng.integers(0, 8)).tolist()))


def hostile(rng: np.random.Generator, size: int) -> bytes:
    """Noise, frames with random contents, and damaged ones."""
    stream = bytearray()
    while len(stream) < size:
        if rng.random() < 0.3:
            stream += rng.integers(0, 256, rng.integers(1, 80), dtype=np.uint8).tobytes()
        frame = random_frame(rng)
        if rng.random() < 0.3:
            frame[rng.integers(len(frame))] = rng.integers(256)
        stream += frame if rng.random() < 0.9 else frame[: rng.integers(len(frame))]
    return bytes(stream[:size])
