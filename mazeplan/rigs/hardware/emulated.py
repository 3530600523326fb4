"""The rig on an emulated table: all of `HardwareRig`, with a simulated world behind serial port and camera.

The firmware runs in a simulated chip, the pictures are rendered, the plate and the ball are MuJoCo's; everything goes
on at the pace of the clock on the wall (`world`). The calibrations in its file were found as those of a real rig are.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Mapping
from typing import Any

import numpy as np

from mazeplan.errors import MazeplanError, RigError
from mazeplan.rigs.camera.source import FrameSource
from mazeplan.rigs.hardware.parts import open_board
from mazeplan.rigs.hardware.rig import HardwareRig
from mazeplan.rigs.hardware.settings import EmulatedSettings, check_section
from mazeplan.rigs.hardware.table import Table
from mazeplan.rigs.link.board import Board

SEEDS = 2**31
GRACE_S = 0.2  # for the word of what is behind an error
LOST = 0.02  # of the pictures that may be lost without a word


class EmulatedRig(HardwareRig):
    """See `interface.Rig`. settings: the keys of emulated.yaml."""

    settings: EmulatedSettings

    def _checked(self, settings: Mapping[str, Any]) -> EmulatedSettings:
        return check_section(EmulatedSettings, settings)

    table: Table | None = None

    def _open_board(self) -> Board:
        self.table = Table(self.maze, self.settings.world)
        return open_board(self.settings, self.table.port)

    def _open_camera(self) -> FrameSource:
        assert self.table is not None
        return self.table

    @property
    def _camera_name(self) -> str:
        return "of the emulated rig"

    def cause(self, problem: MazeplanError) -> MazeplanError:
        """As `HardwareRig.cause`: a table that is gone takes board and camera with it, one that hangs silences them."""
        if self.table is None or not isinstance(problem, RigError):
            return problem
        if self.table.going(GRACE_S):
            return RigError(self.table.why)
        return RigError(f"the emulated table hangs, or this machine is too slow for it: {problem}")

    def level(self) -> None:
        """As `HardwareRig.level`; a plate that is gone with its table needs none."""
        if self.table is None or not self.table.gone:
            super().level()

    def _place(self, ring: int, theta: float, rng: np.random.Generator) -> None:
        """What a person would do."""
        assert self.table is not None
        self.table.place(ring, math.remainder(theta, math.tau), int(rng.integers(SEEDS)))

    def close(self) -> None:
        """As `HardwareRig.close`; the table is folded up, too. Where the machine did not keep up with it, this says so,
        once."""
        table, self.table = self.table, None
        try:
            super().close()
        finally:
            if table is not None:
                table.close()
                due = table.lost + len(table.shown)
                if table.lost > LOST * due:
                    what = f"{table.lost} of {due} pictures of the emulated camera were lost"
                    print(f"this machine does not keep up: {what}", file=sys.stderr, flush=True)
