"""The emulated rig: a `HardwareRig` with a simulated world behind its serial port and its camera.

The world (`world`) runs in real time: the firmware runs on a simulated chip, a renderer makes the pictures, MuJoCo
simulates plate and ball. The calibrations in the rig's file were made like those of a real rig.
"""

from __future__ import annotations

import math
import sys

import numpy as np

from emulator.settings import EmulatedSettings
from emulator.table import EmulatedTable
from mazeplan.core.errors import MazeplanError, RigError
from mazeplan.rigs.camera.source import FrameSource
from mazeplan.rigs.hardware.rig import HardwareRig
from mazeplan.rigs.link.board import Board, open_board

SEEDS = 2**31
GRACE_S = 0.2  # s to wait for the last message of a world that ends
LOST = 0.02  # a larger share of lost pictures is reported


class EmulatedRig(HardwareRig):
    """See `interface.Rig`. settings: the keys of emulated.yaml."""

    settings_kind = EmulatedSettings
    settings: EmulatedSettings
    table: EmulatedTable | None = None

    def _open_board(self) -> Board:
        self.table = EmulatedTable(self.maze, self.settings.world)
        return open_board(self.table.port, self.settings.servo.limits())

    def _open_camera(self) -> FrameSource:
        assert self.table is not None
        return self.table

    @property
    def _camera_name(self) -> str:
        return "of the emulated rig"

    def cause(self, problem: MazeplanError) -> MazeplanError:
        """The error that caused `problem`. If the emulated table ends or hangs, board and camera fall silent."""
        if self.table is None or not isinstance(problem, RigError):
            return problem
        if self.table.ends_within(GRACE_S):
            return RigError(self.table.why)
        return RigError(f"the emulated table hangs, or this machine is too slow for it: {problem}")

    def level(self) -> None:
        """As `HardwareRig.level`. Does nothing if the table has ended by itself."""
        if self.table is None or not self.table.gone:
            super().level()

    def _place(self, ring: int, theta: float, rng: np.random.Generator) -> None:
        """Place the ball, as a person would."""
        assert self.table is not None
        self.table.place(ring, math.remainder(theta, math.tau), int(rng.integers(SEEDS)))

    def close(self) -> None:
        """Close the rig as `HardwareRig.close`, and end the table. Reports if this computer was too slow."""
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
