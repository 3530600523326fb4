"""Effects in sizes for the plant of tests/plant.py: what the plant is told, and the parameters that are to be found."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

DECLARED = {"rolling_inertia": {"factor": 5 / 7}, "viscous_friction": {"coefficient": 0.35}}
SIZES = (1, 3, 10)  # times the smallest size that is to be found
RADII = {"1": 0.0925, "2": 0.0689, "3": 0.0488}  # m, about those of rings 1 to 3
SECONDS, NOISE = 300.0, 0.4  # s of a record; rad/s^1.5 of the process noise, where there is any


def _effect(name: str, k: float) -> tuple[dict[str, Any], dict[str, float]]:
    """An effect at k times the smallest size: what the plant is told, and the parameters that are to come out."""
    return {
        "dry_friction": ({"dry": 0.05 * k}, {"coefficient": 0.05 * k}),
        "tilt_offset": ({"offset": (0.0005 * k, -0.0005 * k)}, {"beta": 0.0005 * k, "gamma": -0.0005 * k}),
        "rolling_inertia": ({"factor": 5 / 7 * (1 + 0.015 * k)}, {"factor": 5 / 7 * (1 + 0.015 * k)}),
        "viscous_friction": ({"viscous": 0.35 + 0.03 * k}, {"coefficient": 0.35 + 0.03 * k}),
        "quadratic_drag": ({"quadratic": 0.015 * k}, {"coefficient": 0.015 * k}),
        "constant_torque": ({"torque": 0.045 * k}, {"acceleration": 0.045 * k}),
        "axis_misalignment": ({"angle": 0.0075 * k}, {"angle": 0.0075 * k}),
        "sensor_delay": ({"delay": 0.0066 * k}, {"delay": round(0.0066 * k * 1200) / 1200}),
        "friction_drift": ({"drift": 0.12 * k / SECONDS}, {"rate": 0.12 * k / SECONDS}),
        "surface_profile": (
            {"wave": (0.08 * k, 0.0, 0.0, 0.08 * k)},
            {"cos1": 0.08 * k, "sin1": 0.0, "cos2": 0.0, "sin2": 0.08 * k},
        ),
        "surface_bump": ({"bump": (1.0, 0.3, 0.1 * k)}, {"height": 0.1 * k}),
        "gate_loss": ({"gate": (0.8, min(0.03 * k, 0.5))}, {"loss": min(0.03 * k, 0.5)}),
        "tilt_gain": ({"gain": (1 + 0.015 * k, 1 - 0.015 * k)}, {"beta": 1 + 0.015 * k, "gamma": 1 - 0.015 * k}),
        "camera_offset": (
            {"camera_offset": (0.0003 * k, -0.0002 * k)},
            {"x": 0.0003 * k, "y": -0.0002 * k},
        ),
    }[name]


NAMES = (
    "dry_friction", "tilt_offset", "rolling_inertia", "viscous_friction", "quadratic_drag", "constant_torque",
    "axis_misalignment", "sensor_delay", "friction_drift", "surface_profile", "surface_bump", "gate_loss", "tilt_gain",
    "camera_offset",
)  # fmt: skip
PAIRS = (
    ("dry_friction", "tilt_offset"), ("dry_friction", "sensor_delay"), ("viscous_friction", "rolling_inertia"),
    ("tilt_offset", "sensor_delay"), ("camera_offset", "dry_friction"), ("surface_bump", "tilt_offset"),
    ("friction_drift", "axis_misalignment"), ("gate_loss", "dry_friction"), ("quadratic_drag", "tilt_offset"),
    ("rolling_inertia", "surface_bump"),
)  # fmt: skip
UNKNOWN: dict[str, dict[str, Any]] = {
    "speed times tilt": {"cross": (4.0, -2.0)},
    "pull of the speed's past": {"memory": (1.0, 0.5)},
    "force that swings with time": {"hum": (1.7, 0.3)},
}


def sized(name: str, k: float) -> tuple[dict[str, Any], dict[str, dict[str, float]]]:
    """An effect at k times the smallest size: what the plant is told, and names with the parameters to be found."""
    what, parameters = _effect(name, k)
    return what, {name: parameters}


@dataclass(frozen=True)
class Job:
    """A record: what group it counts to, the plant's effects, the names and parameters to be found."""

    group: str
    what: dict[str, Any]
    true: dict[str, dict[str, float]]
    ring: str
    seed: int
    process: float = 0.0


def jobs_of(seeds: int) -> list[Job]:
    """Every record of the table."""
    jobs = [
        Job(f"{name} x {k}", *sized(name, k), ring, seed)
        for name in NAMES
        for k in SIZES
        for ring in RADII
        for seed in range(seeds)
    ]
    jobs += [
        Job(f"{name}, process noise", *sized(name, 10), ring, 50 + seed, NOISE)
        for name in NAMES
        for ring in RADII
        for seed in range(max(seeds // 3, 1))
    ]
    rings = list(RADII)
    jobs += [Job("nothing", {}, {}, rings[i % 3], 100 + i) for i in range(6 * seeds)]
    jobs += [Job("nothing, process noise", {}, {}, rings[i % 3], 200 + i, NOISE) for i in range(4 * seeds)]
    for i in range(3 * seeds):
        pair = PAIRS[i % len(PAIRS)]
        what, true = ({k: v for n in pair for k, v in sized(n, 3)[j].items()} for j in (0, 1))
        jobs.append(Job("two effects", what, true, rings[i % 3], 300 + i))
    jobs += [
        Job(f"unknown: {name}", what, {}, rings[seed % 3], 400 + seed)
        for name, what in UNKNOWN.items()
        for seed in range(seeds)
    ]
    return jobs
