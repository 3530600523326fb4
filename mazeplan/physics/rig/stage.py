"""The tip-tilt stage: each axis a second-order servo with dead time.

    angle_dd = wn^2 (gain u(t - dead_time) + offset - angle) - 2 zeta wn angle_d

zeta may exceed 1. `stage_simulation` simulates an axis.
"""

from __future__ import annotations

from dataclasses import dataclass, field

from mazeplan.core.field_checks import unit_hint
from mazeplan.core.maths.fingerprint import LATER


@dataclass(frozen=True)
class StageAxis:
    """One axis of the stage.

    gain:              tilt per command
    natural_frequency: rad/s
    damping:           ratio
    dead_time:         s
    offset:            rad
    stderr:            standard errors by field
    backlash:          play between servo and plate, rad
    deadband:          smallest change of command with an effect, rad
    coupling:          share of the other axis's command
    """

    gain: float = 1.0
    natural_frequency: float = 26.0
    damping: float = 0.9
    dead_time: float = 0.0
    offset: float = 0.0
    stderr: dict[str, float] = field(default_factory=dict, compare=False)
    backlash: float = 0.0
    deadband: float = 0.0
    coupling: float = field(default=0.0, metadata=LATER)

    def __post_init__(self) -> None:
        for name, low, high, unit in (
            ("backlash", 0.0, 0.2, "rad"),
            ("deadband", 0.0, 0.2, "rad"),
            ("gain", 0.05, 20.0, ""),
            ("natural_frequency", 0.5, 500.0, "rad/s"),
            ("damping", 0.02, 20.0, ""),
            ("dead_time", 0.0, 1.0, "s"),
            ("offset", -0.5, 0.5, "rad"),
            ("coupling", -0.5, 0.5, ""),
        ):
            value = getattr(self, name)
            if not low <= value <= high:
                hint = unit_hint(value, unit, low, high)
                raise ValueError(f"{name}: got {value}, expected {low} to {high}{hint}")

    def poles(self) -> tuple[complex, complex]:
        """Poles of the continuous axis, rad/s."""
        w, z = self.natural_frequency, self.damping
        root = complex(z * z - 1.0) ** 0.5
        return w * (-z + root), w * (-z - root)


@dataclass(frozen=True)
class StageModel:
    """Both axes of the stage."""

    beta: StageAxis = field(default_factory=StageAxis)
    gamma: StageAxis = field(default_factory=StageAxis)

    def mixed(self, u_beta: float, u_gamma: float) -> tuple[float, float]:
        """Command that reaches each axis, rad: its command plus a share of the other axis's command."""
        return u_beta + self.beta.coupling * u_gamma, u_gamma + self.gamma.coupling * u_beta
