"""True properties of the parts of an emulated rig. A seed draws them, and calibrations must find them.

Diode: its two voltages follow the laser's spot, which moves by tan(2 tilt). The diode is turned against the axes. Its
channels have different gains and offsets, and it is not linear at its edges.
Servos: each has its own level pulse, gain and direction.
Camera: it hangs about half a metre above the plate, slightly tilted and slightly beside the middle.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np

from mazeplan.core.records import Array
from mazeplan.rigs.camera.pinhole import CameraModel

FULL_DEG = 5.0  # tilt at which the spot is at the place 1


@dataclass(frozen=True)
class Diode:
    """volts = offset + gain * (s + bend), s = turn @ (tan 2 beta, tan 2 gamma cos beta) / tan 2 FULL_DEG.

    turn (2, 2): rotation of the diode against the axes.
    gain, offset (2,): V.
    square (2, 3), cube (2,): coefficients of the bend."""

    turn: Array
    gain: Array
    offset: Array
    square: Array
    cube: Array

    @classmethod
    def drawn(cls, rng: np.random.Generator) -> Diode:
        """A random diode."""
        angle = rng.normal(0.0, 0.1)
        turn = np.array([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]])
        gain = rng.uniform(0.75, 1.1, 2) * rng.choice([-1.0, 1.0], 2)
        return cls(turn, gain, rng.normal(2.5, 0.15, 2), rng.normal(0.0, 0.02, (2, 3)), rng.uniform(-0.03, 0.03, 2))

    def volts(self, beta: float, gamma: float) -> tuple[float, float]:
        """Voltages of the two channels at a tilt in rad."""
        full = math.tan(2.0 * math.radians(FULL_DEG))
        spot = np.array([math.tan(2.0 * beta), math.tan(2.0 * gamma) * math.cos(beta)]) / full
        s = self.turn @ spot
        bend = self.square @ np.array([s[0] ** 2, s[0] * s[1], s[1] ** 2]) + self.cube * s * float(s @ s)
        first, second = np.clip(self.offset + self.gain * (s + bend), 0.0, 5.0)
        return float(first), float(second)


@dataclass(frozen=True)
class EmulatedServos:
    """The two servos.

    level (2,): pulses of the level plate, us.
    us_per_deg (2,): change of the pulse for 1 deg of tilt."""

    level: Array
    us_per_deg: Array

    @classmethod
    def drawn(cls, rng: np.random.Generator) -> EmulatedServos:
        """Random servos."""
        return cls(rng.normal(1500.0, 20.0, 2), rng.uniform(36.0, 44.0, 2) * rng.choice([-1.0, 1.0], 2))

    def tilt(self, beta_us: float, gamma_us: float) -> tuple[float, float]:
        """beta, gamma in rad for two pulses."""
        beta, gamma = np.radians((np.array([beta_us, gamma_us]) - self.level) / self.us_per_deg)
        return float(beta), float(gamma)


def camera_drawn(rng: np.random.Generator) -> CameraModel:
    """A random webcam on an arm; the plate with its markers fills the height of the picture."""
    focal, height = rng.normal(1150.0, 15.0), rng.normal(0.56, 0.01)
    matrix = np.array(
        [
            [focal, 0.0, rng.normal(320.0, 5.0)],
            [0.0, focal * rng.normal(1.0, 2e-3), rng.normal(240.0, 5.0)],
            [0.0, 0.0, 1.0],
        ]
    )
    distortion = np.array([rng.normal(-0.06, 0.02), rng.normal(0.05, 0.02), *rng.normal(0.0, 5e-4, 2), 0.0])
    down = np.diag([1.0, -1.0, -1.0])  # x to the right, y up in the plate; y down, z away in the camera
    askew, _ = cv2.Rodrigues(np.radians(rng.normal(0.0, (1.0, 1.0, 1.5))))
    shift = np.array([*rng.normal(0.0, 3e-3, 2), height])
    return CameraModel(matrix, distortion, askew @ down, shift)


@dataclass(frozen=True)
class Truth:
    """True properties of all parts of a world."""

    diode: Diode
    servos: EmulatedServos
    camera: CameraModel

    @classmethod
    def drawn(cls, seed: int) -> Truth:
        """The properties that belong to a seed."""
        diode, servos, camera = (np.random.default_rng([seed, part]) for part in range(3))
        return cls(Diode.drawn(diode), EmulatedServos.drawn(servos), camera_drawn(camera))
