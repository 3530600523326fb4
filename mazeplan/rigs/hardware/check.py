"""Checks a rig on a table part by part: port, firmware, servos, then tilt sensor, camera, markers and ball.

`check_rig` goes on from there: whether the plate follows commands, and the rules of every rig. The board comes first,
because it needs no calibration. A lost part, or a mistake in the rig's file, ends the check with an error.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from time import monotonic, sleep

import numpy as np

from mazeplan.core.errors import MazeplanError
from mazeplan.core.records import Array
from mazeplan.rigs.conformance import CheckResult, UnfitError
from mazeplan.rigs.hardware.rig import HardwareRig, NotSeen
from mazeplan.rigs.hardware.tiltcalibration import PulseHolder
from mazeplan.rigs.link.board import ports_found

LOOK_S, SETTLE_S = 1.5, 1.0
TILT_DEG = 3.0  # tilt in the step that tests a servo's direction
OFF_DEG = 0.7  # largest error of a level plate
MARKERS_DEG = 0.5  # largest difference between the tilt by the markers and the tilt by the sensor
RATE = 0.1  # largest relative error of the camera's rate
AVERAGE_S = 0.3  # s over which reports are averaged
MOVED_V = 0.05  # V, minimum change of a tilt channel when the plate moves
PINS = {"beta": 11, "gamma": 12}
SIDES = {"beta": "the +x side (right in the maze's drawing) lower", "gamma": "the +y side (top) higher"}
Ask = Callable[[str], bool]  # asks a person a question: yes or no


class HardwareCheck:
    """One check of a rig. `steps` yields a result for each step. ask: asks a person."""

    def __init__(self, rig: HardwareRig, ask: Ask) -> None:
        self.rig = rig
        self.ask = ask
        self._pictures = round(LOOK_S * rig.rate_hz)

    def steps(self) -> Iterator[CheckResult]:
        """Run the steps, and yield their results. The rig stays open, with the plate level.

        After the result of a step that ended with an error, raises this error: RigError or SettingsError."""
        for name, step in (
            ("port", self._port), ("firmware", self._firmware), ("beta servo", lambda: self._servo("beta")),
            ("gamma servo", lambda: self._servo("gamma")), ("calibrations", self._calibrated),
            ("tilt sensor", self._tilt_sensor), ("camera", self._camera), ("markers", self._markers),
            ("ball", self._ball),
        ):  # fmt: skip
            try:
                yield CheckResult(name, True, step())
            except (UnfitError, NotSeen) as problem:
                yield CheckResult(name, False, str(problem))
            except MazeplanError as problem:
                error = self.rig.cause(problem)
                yield CheckResult(name, False, str(error))
                raise error from None
        self.rig.level()

    def _port(self) -> str:
        found = ", ".join(ports_found()) or "none"
        return f"{self.rig.board.port} answers (ports behind USB: {found})"

    def _firmware(self) -> str:
        identity = self.rig.board.identity
        assert identity is not None
        limits = f"pulses {identity.min_us:g} to {identity.max_us:g} us at most"
        level = f"level after {1e3 * identity.watchdog_s:g} ms of silence"
        return f"{identity.name} {identity.version}, protocol {identity.protocol}; {limits}, {level}"

    def _servo(self, axis: str) -> str:
        """Move one servo, and compare the voltages of the tilt channels before and after. Needs no calibration."""
        board, servo = self.rig.board, self.rig.settings.servo
        one = servo.beta if axis == "beta" else servo.gamma
        level = (servo.beta.level_us, servo.gamma.level_us)
        pulse = one.pulse(math.radians(TILT_DEG))
        with PulseHolder(board, level) as holder:
            sleep(SETTLE_S)
            before = holder.volts(AVERAGE_S)
        with PulseHolder(board, (pulse, level[1]) if axis == "beta" else (level[0], pulse)) as holder:
            sleep(SETTLE_S)
            change = np.round(holder.volts(AVERAGE_S) - before, 2) + 0.0  # no -0.00
            text = f"{one.level_us:.0f} to {pulse:.0f} us: channel 0 {change[0]:+.2f} V, channel 1 {change[1]:+.2f} V"
            if np.abs(change).max() < MOVED_V:
                what = f"is the servo at pin {PINS[axis]}, has it current, and is the laser's spot on the diode?"
                raise UnfitError(f"{text}: nothing moved; {what}")
            right = self.ask(f"is {SIDES[axis]} than the middle?")
        if right:
            return text
        if self.rig.settings.tilt is None:
            return f"{text}; it turns the other way, which `mazeplan calibrate tilt` corrects"
        raise UnfitError(f"{text}, but to your eyes it is the other way: calibrate the tilt anew")

    def _calibrated(self) -> str:
        self.rig.ready()
        tilt, camera = self.rig.settings.tilt, self.rig.settings.camera
        return f"tilt {tilt.date if tilt else ''}, camera {camera.date or ''}"

    def _tilt_sensor(self) -> str:
        self.rig.level()
        sleep(SETTLE_S)  # the servos moved just before
        (beta, gamma), _ = self._watch()
        report, sensor = self.rig.parts.board.latest(), self.rig.settings.tilt
        first, second = (math.nan, math.nan) if report is None else report.volts
        seen = f"{first:.2f} and {second:.2f} V"
        if sensor is None or not sensor.reaches(first, second):
            raise UnfitError(f"{seen} is outside what was calibrated: is the laser's spot on the diode?")
        if max(abs(beta), abs(gamma)) > OFF_DEG:
            raise UnfitError(f"level is {beta:+.2f}, {gamma:+.2f} deg by {seen}: calibrate anew")
        return f"{seen}; level is {beta:+.2f}, {gamma:+.2f} deg"

    def _camera(self) -> str:
        began, clock = monotonic(), []
        while monotonic() - began < LOOK_S:
            self.rig.observe()
            clock.append(self.rig.sighting is not None)
        rate = sum(clock) / (monotonic() - began)
        if abs(rate / self.rig.rate_hz - 1.0) > RATE:
            raise UnfitError(f"{rate:.1f} pictures a second, expected {self.rig.rate_hz:g}")
        return f"{rate:.1f} pictures a second"

    def _markers(self) -> str:
        tilt, seen = self._watch()
        if not len(seen):
            raise UnfitError("no markers are seen: are they lit, and in the picture?")
        found = np.median(seen, axis=0)
        text = f"in {len(seen)} of {self._pictures} pictures, tilt {found[0]:+.2f}, {found[1]:+.2f} deg"
        if np.abs(found - tilt).max() > MARKERS_DEG:
            raise UnfitError(f"{text}, but {tilt[0]:+.2f}, {tilt[1]:+.2f} by the sensor: calibrate the camera anew")
        return text

    def _ball(self) -> str:
        self.rig.reset(ring=1, theta=0.0, rng=np.random.default_rng(0))
        pictures, seen = 0, []
        for _ in range(self._pictures):
            o = self.rig.observe()
            pictures += self.rig.sighting is not None
            seen += [(o.x, o.y)] if o.seen else []
        if not seen or len(seen) < 0.9 * pictures:
            why = "" if self.rig.sighting is None else f" ({self.rig.sighting.why})"
            what = f"seen in {len(seen)} of {pictures} pictures{why}"
            raise UnfitError(f"{what}; more light, or calibrate the camera anew")
        spread = 1e3 * float(np.sqrt(np.mean(np.var(seen, axis=0))))
        x, y = 1e3 * np.mean(seen, axis=0)
        return f"in {len(seen)} of {pictures} pictures, at {x:.1f}, {y:.1f} mm, scatter {spread:.2f} mm"

    def _watch(self) -> tuple[Array, Array]:
        """Mean tilt (2,) by the sensor of a level plate over LOOK_S, and tilts (N, 2) by the markers, deg."""
        tilts, by_markers = [], []
        for _ in range(self._pictures):
            o = self.rig.observe()
            self.rig.command(0.0, 0.0)
            tilts.append((o.beta, o.gamma))
            s = self.rig.sighting
            by_markers += [] if s is None or s.beta is None else [(s.beta, s.gamma)]
        return np.degrees(np.mean(tilts, axis=0)), np.degrees(np.array(by_markers, dtype=float))
