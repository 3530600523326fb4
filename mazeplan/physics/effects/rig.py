"""Effects of the rig: stage, tilt sensor and camera. They are numbers in the model of that part (`entry`)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from mazeplan.physics.effect import CAMERA, STAGE, TILT_SENSOR, Effect, Parameter

AXES = ("beta", "gamma")
CALIBRATED = 0.1  # standard deviation of the scale of a tilt sensor that was compared with a level


def _part(
    name: str, acts: str, parameters: Mapping[str, tuple[Parameter, str]], text: str, source: str,
    places: tuple[str, ...] = (),
) -> Effect:  # fmt: skip
    """An effect whose parameters are in the model of a part of the rig."""
    entry = {key: place for key, (_, place) in parameters.items()}
    known = {key: p for key, (p, _) in parameters.items()}
    return Effect(name, known, acts, None, text, source, entry=entry, common=True, places=places)


def _both(field: str, parameter: Parameter) -> dict[str, tuple[Parameter, str]]:
    """A parameter of each axis of the stage."""
    return {axis: (parameter, f"stage.{axis}.{field}") for axis in AXES}


_GAIN = Parameter("1", 1.0, 0.1, 10.0, smallest=0.01, step=1e-4)
_LAG = {
    "natural_frequency": Parameter("rad/s", 26.0, 0.5, 240.0, smallest=2.0),
    "damping": Parameter("1", 0.9, 0.05, 7.0, smallest=0.1),
}
_SHARE = Parameter("1", 0.0, -0.5, 0.5, smallest=0.01)
_RATE = Parameter("rad/s", 50.0, 0.05, 50.0, smallest=0.05)
_LATE = Parameter("s", 0.0, 0.0, 0.5, smallest=0.005, step=1e-4)
_PLAY = Parameter("rad", 0.0, 0.0, 0.2, smallest=2e-3)
_BAND = Parameter("rad", 0.0, 0.0, 0.2, smallest=1e-3)
_SENSED = Parameter("1", 1.0, 0.3, 3.0, smallest=0.012, step=1e-4, prior=CALIBRATED)
_TURN = Parameter("rad", 0.0, -0.8, 0.8, smallest=0.005, step=1e-4)
_OFFSET = Parameter("m", 0.0, -0.02, 0.02, smallest=4e-4, step=1e-5)
_SCALE = Parameter("1", 1.0, 0.5, 2.0, smallest=0.005, step=1e-4)
_BEND = Parameter("1/m^2", 0.0, -30.0, 30.0, smallest=0.5, step=1e-2)
_CENTRE = Parameter("m", 0.0, -0.1, 0.1, step=1e-4)
_BEHIND = Parameter("s", 0.0, -0.1, 0.3, smallest=0.004, step=1e-4, words="camera behind the tilt sensor")

servo_gain = _part("servo_gain", STAGE, _both("gain", _GAIN), "tilt per command", "second-order servo")
servo_lag = _part(
    "servo_lag", STAGE, {f"{axis}_{key}": (p, f"stage.{axis}.{key}") for axis in AXES for key, p in _LAG.items()},
    "how fast each servo follows its command", "second-order servo",
)  # fmt: skip
rate_limit = _part("rate_limit", STAGE, _both("rate_limit", _RATE), "fastest turn of the plate", "saturation")
axis_coupling = _part(
    "axis_coupling", STAGE,
    {"beta_from_gamma": (_SHARE, "stage.beta.coupling"), "gamma_from_beta": (_SHARE, "stage.gamma.coupling")},
    "share of the other axis's command that an axis follows, too", "linear mixing of commands",
)  # fmt: skip
command_delay = _part(
    "command_delay", STAGE, {"delay": (_LATE, "stage.*.dead_time")}, "time before a servo hears a command", "dead time"
)
backlash = _part("backlash", STAGE, _both("backlash", _PLAY), "play between servo and plate", "play operator")
deadband = _part(
    "deadband", STAGE, _both("deadband", _BAND), "change of a command below which a servo stays where it is",
    "dead band",
)  # fmt: skip
tilt_gain = _part(
    "tilt_gain", TILT_SENSOR,
    {
        "beta": (replace(_SENSED, words="scale, tilt down at +x"), "tilt_sensor.gain_beta"),
        "gamma": (replace(_SENSED, words="scale, tilt up at +y"), "tilt_sensor.gain_gamma"),
    },
    "scale of the tilt sensor: measured over true", "linear sensor",
)  # fmt: skip
axis_misalignment = _part(
    "axis_misalignment", CAMERA, {"angle": (_TURN, "camera.angle")},
    "angle by which the camera's picture is turned against the tilt axes", "rotation",
)  # fmt: skip
camera_offset = _part(
    "camera_offset", CAMERA, {axis: (_OFFSET, f"camera.offset_{axis}") for axis in ("x", "y")},
    "where the camera sees the middle of the plate", "translation",
)  # fmt: skip
camera_scale = _part(
    "camera_scale", CAMERA, {"factor": (_SCALE, "camera.scale")}, "scale of the camera's picture: measured over true",
    "linear scale",
)  # fmt: skip
lens_distortion = _part(
    "lens_distortion", CAMERA,
    {
        "k": (_BEND, "camera.distortion"),
        "x": (_CENTRE, "camera.distortion_x"),
        "y": (_CENTRE, "camera.distortion_y"),
    },
    "the lens bends the picture: measured = centre + (p - centre) (1 + k d^2), d from the centre to p",
    "first term of Brown's radial distortion", places=("x", "y"),
)  # fmt: skip
sensor_delay = _part(
    "sensor_delay", CAMERA, {"delay": (_BEHIND, "camera_delay_s")},
    "time by which the camera is behind the tilt sensor", "delay",
)  # fmt: skip

FAMILY = (
    servo_gain, servo_lag, rate_limit, axis_coupling, command_delay, deadband, backlash, tilt_gain, axis_misalignment,
    camera_offset, camera_scale, lens_distortion, sensor_delay,
)  # fmt: skip
