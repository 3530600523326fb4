"""A rig of somebody's own, behind the six methods alone: the ball goes straight inwards."""

from mazeplan.core.records import Observation


class Sinking:
    """Each sample a millimetre nearer to the centre, whatever is commanded; every tenth sample sees nothing."""

    rate_hz, realtime = 30.0, False

    def __init__(self, maze, settings):
        self._maze = maze

    def reset(self, *, ring, theta, rng):
        self._count, self._r, self._tilt = 0, self._maze.track_radius(ring), (0.0, 0.0)

    def observe(self):
        t, self._count, self._r = self._count / 30.0, self._count + 1, max(self._r - 0.001, 0.0)
        seen = self._count % 10 > 0
        return Observation(t, self._r if seen else None, 0.0 if seen else None, *self._tilt)

    def command(self, u_beta, u_gamma):
        self._tilt = (u_beta, u_gamma)

    def level(self):
        self._tilt = (0.0, 0.0)

    def close(self):
        pass
