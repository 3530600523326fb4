"""The environment with rigs that run in real time, under a watchdog."""

from __future__ import annotations

from mazeplan.apps.environment.worlds import RigRow
from mazeplan.core.errors import RigError
from mazeplan.core.records import Observation
from mazeplan.maze.mapfile import load_map

MAZE = load_map("cme")


class Table:
    """A rig in real time, at 100 samples a second. The ball rests in ring 1."""

    rate_hz = 100.0

    def __init__(self, maze, settings):
        self.told, self.samples, self.levels = [], 0, True

    def reset(self, *, ring, theta, rng):
        self.told.append("reset")
        self.samples = 0

    def observe(self):
        self.samples += 1
        return Observation((self.samples - 1) / self.rate_hz, MAZE.track_radius(1), 0.0, 0.0, 0.0)

    def command(self, u_beta, u_gamma):
        self.told.append("command")

    def level(self):
        self.told.append("level")
        if not self.levels:
            raise RigError("the board does not confirm that the plate is level")

    def close(self):
        self.told.append("close")


def test_a_rig_that_cannot_level_is_closed_all_the_same():
    tables = [Table(MAZE, {}), Table(MAZE, {})]
    tables[0].levels = False
    RigRow(lambda: tables).close()
    assert [table.told for table in tables] == [["level", "close"]] * 2
