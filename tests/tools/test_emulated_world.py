"""The emulated table's camera on a machine that is too slow for it, and what is said of that in the end."""

from __future__ import annotations

import mmap
import time
from types import SimpleNamespace

import numpy as np
import pytest
from emulated_chip import EMULATED
from emulator.rig import EmulatedRig
from emulator.table import SIZE
from emulator.world import SLOTS, EmulatedCamera

from mazeplan.maze.mapfile import load_map
from mazeplan.rigs.registry import make_rig


class Slow:
    """Takes a quarter of a second for a picture."""

    def render(self, ball, beta, gamma, rng):
        time.sleep(0.25)
        return np.zeros(SIZE, np.uint8)


def test_pictures_that_come_too_late_are_left_out_and_counted():
    said = []
    memory = mmap.mmap(-1, SLOTS * int(np.prod(SIZE)))
    camera = EmulatedCamera(Slow(), memory, 0.05, said.append)  # pyright: ignore[reportArgumentType]
    camera.start()
    for _ in range(8):
        camera.shots.put((time.monotonic(), None, 0.0, 0.0))
    camera.end()
    assert camera.lost >= 2
    assert len(said) + camera.lost == 8
    assert [document["lost"] for document in said] == sorted(document["lost"] for document in said)
    assert said[-1]["lost"] >= 1


@pytest.mark.parametrize(("lost", "line"), [(1, ""), (25, "this machine does not keep up: 25 of 125 pictures of the ")])
def test_the_end_of_an_emulated_rig_says_so_in_one_line(capsys, lost, line):
    rig = make_rig(str(EMULATED), load_map("cme"))
    assert isinstance(rig, EmulatedRig)
    rig.table = SimpleNamespace(lost=lost, shown=[(0.0, 0.0, 0.0)] * 100, close=lambda: None)  # pyright: ignore
    rig.close()
    rig.close()
    err = capsys.readouterr().err
    assert err.startswith(line)
    assert err.count("\n") == (1 if line else 0)
