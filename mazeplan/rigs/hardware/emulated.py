"""The rig on an emulated table: all of `HardwareRig`, with a simulated world behind serial port and camera.

The firmware runs in a simulated chip, the pictures are rendered, the plate and the ball are MuJoCo's; everything goes
on at the pace of the clock on the wall (`world`). The calibrations in its file were found as those of a real rig are.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from mazeplan.rigs.hardware.parts import Parts, assemble
from mazeplan.rigs.hardware.rig import HardwareRig
from mazeplan.rigs.hardware.settings import EmulatedSettings, check_section
from mazeplan.rigs.hardware.table import Table

SEEDS = 2**31


class EmulatedRig(HardwareRig):
    """See `interface.Rig`. settings: the keys of emulated.yaml."""

    settings: EmulatedSettings

    def _checked(self, settings: Mapping[str, Any]) -> EmulatedSettings:
        return check_section(EmulatedSettings, settings)

    table: Table | None = None

    def _connect(self) -> Parts:
        table = Table(self.maze, self.settings.world)
        try:
            parts = assemble(self.settings, self.maze, self.folder, lambda: table, "of the emulated rig", table.port)
        except BaseException:
            table.close()
            raise
        self.table = table
        return parts

    def _place(self, ring: int, theta: float, rng: np.random.Generator) -> None:
        """What a person would do."""
        assert self.table is not None
        self.table.place(ring, math.remainder(theta, math.tau), int(rng.integers(SEEDS)))

    def close(self) -> None:
        """As `HardwareRig.close`; the table is folded up, too."""
        try:
            super().close()
        finally:
            table, self.table = self.table, None
            if table is not None:
                table.close()
