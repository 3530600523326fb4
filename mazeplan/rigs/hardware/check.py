"""Checks a rig on a table part by part: port, firmware, servos, then tilt sensor, camera, markers and ball.

`check_rig` goes on from there: whether the plate follows commands, and the rules of every rig. The board comes first,
because it needs no calibration. A lost part, or a mistake in the rig's file, ends the check with an error. A failed
step that is in `NEEDED` ends the check without an error.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from time import monotonic, sleep

import numpy as np

from mazeplan.core.errors import MazeplanError
from mazeplan.rigs.conformance import CheckResult
from mazeplan.rigs.hardware.rig import HardwareRig, NotSeen
from mazeplan.rigs.hardware.tiltreadings import hold_pulses, mean_volts
from mazeplan.rigs.link.port import ports_found

LOOK_S, SETTLE_S = 1.5, 1.0
TILT_DEG = 3.0  # tilt in the step that tests a servo's direction
OFF_DEG = 0.7  # largest error of a level plate
MARKERS_DEG = 0.5  # largest difference between the tilt by the markers and the tilt by the sensor
RATE = 0.1  # largest relative error of the camera's rate
AVERAGE_S = 0.3  # s over which reports are averaged
NEEDED = ("camera",)  # steps without which the later ones cannot run
MOVED_V = 0.05  # V, minimum change of a tilt channel when the plate moves
PINS = {"beta": 11, "gamma": 12}
SIDES = {"beta": "the +x side (right in the maze's drawing) lower", "gamma": "the +y side (top) higher"}
Ask = Callable[[str], bool]  # asks a person a question: yes or no


class _Problem(Exception):  # noqa: N818
    """A step failed; the message is its result."""


class HardwareCheck:
    """One check of a rig. `steps` yields a result for each step. ask: asks a person."""

    def __init__(self, rig: HardwareRig, ask: Ask) -> None:
        self.rig, self.ask = rig, ask

    def steps(self) -> Iterator[CheckResult]:
        """Run the steps, and yield their results. The rig stays open, with the plate level.

        After the result of a step that ended with an error, raises this error: RigError for a lost part, SettingsError
        for a mistake in the rig's file."""
        for name, step in (
            ("port", self._port), ("firmware", self._firmware), ("beta servo", lambda: self._servo("beta")),
            ("gamma servo", lambda: self._servo("gamma")), ("calibrations", self._calibrated),
            ("tilt sensor", self._tilt_sensor), ("camera", self._camera), ("markers", self._markers),
            ("ball", self._ball),
        ):  # fmt: skip
            error: MazeplanError | None = None
            try:
                result = CheckResult(name, True, step())
            except (_Problem, NotSeen) as problem:
                result = CheckResult(name, False, str(problem))
            except MazeplanError as problem:
                error = self.rig.cause(problem)
                result = CheckResult(name, False, str(error))
            yield result
            if error is not None:
                raise error
            if not result.passed and name in NEEDED:
                return
        self.rig.level()

    # -- the board ----------------------------------------------------------------------------------------------------

    def _port(self) -> str:
        found = ", ".join(ports_found()) or "none"
        return f"{self.rig.board.port} answers (ports behind USB: {found})"

    def _firmware(self) -> str:
        identity = self.rig.board.identity
        assert identity is not None
        return (
            f"{identity.name} {identity.version}, protocol {identity.protocol}; pulses {identity.min_us:g} to "
            f"{identity.max_us:g} us at most, level after {1e3 * identity.watchdog_s:g} ms of silence"
        )

    def _servo(self, axis: str) -> str:
        """Move one servo, and compare the voltages of the tilt channels before and after. Needs no calibration."""
        board, servo = self.rig.board, self.rig.settings.servo
        one = servo.beta if axis == "beta" else servo.gamma
        level = (servo.beta.level_us, servo.gamma.level_us)
        pulse = one.pulse(math.radians(TILT_DEG))
        with hold_pulses(board, level):
            sleep(SETTLE_S)
            before = self._volts()
        with hold_pulses(board, (pulse, level[1]) if axis == "beta" else (level[0], pulse)):
            sleep(SETTLE_S)
            change = np.round(self._volts() - before, 2) + 0.0  # no -0.00
            text = f"{one.level_us:.0f} to {pulse:.0f} us: channel 0 {change[0]:+.2f} V, channel 1 {change[1]:+.2f} V"
            if np.abs(change).max() < MOVED_V:
                what = f"is the servo at pin {PINS[axis]}, has it current, and is the laser's spot on the diode?"
                raise _Problem(f"{text}: nothing moved; {what}")
            right = self.ask(f"is {SIDES[axis]} than the middle?")
        if right:
            return text
        if self.rig.settings.tilt is None:
            return f"{text}; it turns the other way, which `mazeplan calibrate tilt` corrects"
        raise _Problem(f"{text}, but to your eyes it is the other way: calibrate the tilt anew")

    def _volts(self) -> np.ndarray:
        """Mean of both channels over AVERAGE_S, V."""
        return mean_volts(self.rig.board, AVERAGE_S)

    def _calibrated(self) -> str:
        self.rig.ready()
        tilt, camera = self.rig.settings.tilt, self.rig.settings.camera or {}
        dates = (f"tilt {tilt.date if tilt else ''}", f"camera {camera.get('date') or ''}")
        return ", ".join(text.strip() for text in dates)

    # -- parts --------------------------------------------------------------------------------------------------------

    def _tilt_sensor(self) -> str:
        self.rig.level()
        sleep(SETTLE_S)  # the servos moved just before
        samples = self._watch(LOOK_S)
        report = self.rig.parts.board.latest()
        first, second = (math.nan, math.nan) if report is None else report.volts
        seen = f"{first:.2f} and {second:.2f} V"
        sensor = self.rig.settings.tilt
        if sensor is None or not sensor.sensor().reaches(first, second):
            raise _Problem(f"{seen} is outside what was calibrated: is the laser's spot on the diode?")
        beta, gamma = self._tilt(samples)
        if max(abs(beta), abs(gamma)) > OFF_DEG:
            raise _Problem(f"level is {beta:+.2f}, {gamma:+.2f} deg by {seen}: calibrate anew")
        return f"{seen}; level is {beta:+.2f}, {gamma:+.2f} deg"

    def _camera(self) -> str:
        began, clock = monotonic(), []
        while monotonic() - began < LOOK_S:
            self.rig.observe()
            clock.append(self.rig.sighting is not None)
        rate = sum(clock) / (monotonic() - began)
        if abs(rate / self.rig.rate_hz - 1.0) > RATE:
            raise _Problem(f"{rate:.1f} pictures a second, expected {self.rig.rate_hz:g}")
        return f"{rate:.1f} pictures a second"

    def _markers(self) -> str:
        samples = self._watch(LOOK_S)
        seen = [s for _, _, s in samples if s is not None]
        if not seen:
            raise _Problem(
                "no markers are seen: are they lit, and in the picture? without them the tilt in a picture is not known"
            )
        by_markers, (beta, gamma) = np.degrees(np.median(seen, axis=0)), self._tilt(samples)
        off = max(abs(by_markers[0] - beta), abs(by_markers[1] - gamma))
        text = f"in {len(seen)} of {len(samples)} pictures, tilt {by_markers[0]:+.2f}, {by_markers[1]:+.2f} deg"
        if off > MARKERS_DEG:
            raise _Problem(f"{text}, but {beta:+.2f}, {gamma:+.2f} by the sensor: calibrate the camera anew")
        return text

    def _ball(self) -> str:
        self.rig.reset(ring=1, theta=0.0, rng=np.random.default_rng(0))
        pictures, seen = 0, []
        for _ in range(round(LOOK_S * self.rig.rate_hz)):
            o = self.rig.observe()
            pictures += self.rig.sighting is not None
            seen += [(o.x, o.y)] if o.seen else []
        if not seen or len(seen) < 0.9 * pictures:
            why = "" if self.rig.sighting is None else f" ({self.rig.sighting.why})"
            raise _Problem(f"seen in {len(seen)} of {pictures} pictures{why}; more light, or calibrate the camera anew")
        spread = 1e3 * float(np.sqrt(np.mean(np.var(seen, axis=0))))
        x, y = 1e3 * np.mean(seen, axis=0)
        return f"in {len(seen)} of {pictures} pictures, at {x:.1f}, {y:.1f} mm, scatter {spread:.2f} mm"

    # -- small things -------------------------------------------------------------------------------------------------

    def _watch(self, seconds: float, u: tuple[float, float] = (0.0, 0.0)) -> list[tuple[float, float, tuple | None]]:
        """Samples under a constant command u, rad: (beta, gamma, (beta, gamma) by the markers or None), rad.

        The first two are by the tilt sensor."""
        out = []
        for _ in range(round(seconds * self.rig.rate_hz)):
            o = self.rig.observe()
            self.rig.command(*u)
            s = self.rig.sighting
            markers = None if s is None or s.beta is None or s.gamma is None else (s.beta, s.gamma)
            out.append((o.beta, o.gamma, markers))
        return out

    @staticmethod
    def _tilt(samples: list[tuple[float, float, tuple | None]]) -> tuple[float, float]:
        """Mean of beta and gamma, deg."""
        beta, gamma = np.degrees(np.mean([(b, g) for b, g, _ in samples], axis=0))
        return float(beta), float(gamma)
