"""Converts times of board and camera to the host's clock (`time.monotonic`).

`HostClock` converts the board's time stamps. `FrameClock` numbers the camera's pictures. `TiltTrack` interpolates the
tilt of the last second.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable

import numpy as np

from mazeplan.rigs.hardware.settings import TiltSensor
from mazeplan.rigs.link.protocol import TiltReport

KEPT_S = 1.0  # s; older reports are dropped
SILENT_S = 0.4  # s without a report of the tilt, after which the board counts as failed
AHEAD_S = 0.03  # s, longest extrapolation of the tilt after the last report
SLOPE_S = 0.02  # s before the last report over which the rate of the tilt is computed
DRIFT = 6e-3  # s/s, largest drift between the clocks of host and board: the resonator of a Mega is accurate to 0.5 %
RESTART_S = 1.0  # s; a larger change of the offset between the clocks: the board has restarted, or its counter wrapped
# s, shortest time from the middle of a report's conversions to its reception, measured on the emulated chip: half the
# conversions, 4 ms on the line, 2 ms in chip and host
REPORT_AGE_S = 0.008
PHASE, PERIOD = 0.1, 0.002  # gains of `FrameClock`


class HostClock:
    """Converts the board's time stamps to the host's clock.

    Reports arrive late, never early. So the smallest offset between the clocks is the right one. The offset grows only
    as fast as the clocks drift."""

    def __init__(self) -> None:
        self._offset: float | None = None
        self._last = 0.0

    def host(self, stamp: float, received: float) -> float:
        """Time of a board's stamp by the host's clock, s. received: when the report arrived, host's clock, s."""
        offset = received - stamp
        if self._offset is None or stamp < self._last or abs(offset - self._offset) > RESTART_S:
            self._offset = offset
        else:
            crept = self._offset + DRIFT * (stamp - self._last)
            self._offset = min(offset, crept)
        self._last = stamp
        return stamp + self._offset - REPORT_AGE_S


class TiltTrack:
    """The tilt of the last second, rad, by the host's clock."""

    def __init__(self, sensor: TiltSensor) -> None:
        self._sensor = sensor
        self._clock = HostClock()
        self._track: deque[tuple[float, float, float]] = deque()
        self._last: float | None = None

    def take(self, reports: Iterable[TiltReport]) -> None:
        """Add reports, which are in the order of time. Skips reports of earlier calls."""
        for report in reports:
            if self._last is not None and report.received_s <= self._last:
                continue
            self._last = report.received_s
            t = self._clock.host(report.time_s, report.received_s)
            if self._track and t <= self._track[-1][0]:
                continue
            self._track.append((t, *self._sensor.tilt(*report.volts)))
            while self._track[0][0] < t - KEPT_S:
                self._track.popleft()

    @property
    def newest(self) -> float | None:
        """Host's time of the last report, s."""
        return self._track[-1][0] if self._track else None

    def at(self, t: float) -> tuple[float, float] | None:
        """beta, gamma, rad, at time t of the host's clock; extrapolates by AHEAD_S at most. None without a report."""
        if not self._track:
            return None
        times, beta, gamma = np.array(self._track).T
        ahead, last = min(t - times[-1], AHEAD_S), times[-1]
        first = max(int(np.searchsorted(times, last - SLOPE_S, side="right")) - 1, 0)
        part = ahead / (last - times[first]) if ahead > 0.0 and last > times[first] else 0.0
        beta, gamma = (np.interp(t, times, tilt) + part * (tilt[-1] - tilt[first]) for tilt in (beta, gamma))
        return float(beta), float(gamma)


class FrameClock:
    """Numbers the pictures and computes when each picture was due.

    Phase and period follow the camera's slowly, so that a late thread does not shift the samples."""

    def __init__(self, rate_hz: float) -> None:
        self._nominal = self._period = 1.0 / rate_hz
        self._number = -1
        self._due = 0.0

    def start(self, arrived: float) -> None:
        """Give number 0 to the picture that arrived at this time of the host's clock."""
        self._number = 0
        self._due = arrived

    def due(self, number: int) -> float:
        """When a picture is due, host's clock, s."""
        return self._due + (number - self._number) * self._period

    def take(self, arrived: float) -> int:
        """The number of a picture that arrived at this time of the host's clock."""
        number = self._number + round((arrived - self._due) / self._period)
        error = arrived - self.due(number)
        self._due = self.due(number) + PHASE * error
        self._number = number
        self._period += PERIOD * error
        most = 0.02 * self._nominal
        self._period = min(max(self._period, self._nominal - most), self._nominal + most)
        return number
