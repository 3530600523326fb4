"""The model of a rig: what estimation and planning know of it. `transfer_model` adapts it to another maze; `fits_words`
says whether it fits the machine that it was learned from.

An effect of stage, tilt sensor or camera names the place of each of its parameters in the model (`Effect.entry`):
`stage.beta.gain`, `camera.angle`, `camera_delay_s`; a star stands for both axes. `part_values` and `with_part` read and
write them."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

from mazeplan.core.constants import FREE_ROLLING, WALL_ROLLING
from mazeplan.core.records import Latency
from mazeplan.learning.gaussian_process import GaussianProcess
from mazeplan.learning.rigid_body_entries import Body
from mazeplan.maze.geometry import Maze, Ring
from mazeplan.physics.ball_model import BallModel, ball_of
from mazeplan.physics.dynamics.planar import PlanarModel
from mazeplan.physics.dynamics.ring_parameters import FASTEST, RingParameters
from mazeplan.physics.effect import Effect
from mazeplan.physics.effects.ball import dry_friction, rolling_inertia, viscous_friction
from mazeplan.physics.effects.rig import AXES, FAMILY
from mazeplan.physics.rig.sensors import Camera, TiltSensor
from mazeplan.physics.rig.stage import StageModel

LATENCY_STDERR = 0.002  # s; standard error of a delay that was measured while the plate swung
NOMINAL_DRY = 0.05  # m/s^2; a steel ball stays at rest up to a tilt of 0.4 deg
SAME_RADIUS_M = 1e-3  # m; radii of the same rings in two maps differ by less
FITS = 1.3  # times the noise up to which a description fits a record
DEAD_TIME = 0.005  # s; a smaller dead time does not count as an effect
ALWAYS = ("servo_gain", "servo_lag")  # effects of every model
TAKEN_OFF = ("camera_offset", "camera_scale", "lens_distortion")  # corrected in measured positions before a fit
DELAY = "camera_delay_s"  # the place of the one number that belongs to no part
SLIDING, SMOOTH = 0.8, 0.02  # factor of gravity that no rolling ball has; friction of a wall that hardly has any


@dataclass(frozen=True)
class RigModel:
    """The model of a rig.

    stage:                both axes of the plate, with their servos
    balls:                ball model by ring
    camera_delay:         delay of the ball's position behind the tilt sensor, s; at least minus the dead time
    camera_delay_stderr:  its standard error, s; None if unknown
    kind:                 one of `modelfile.KINDS`
    rate_hz:              rate of the samples, Hz
    data, scores:         source and quality, as in the model file
    processes:            learned parts by ring; they add to the effects (sp) or replace them (np)
    camera, tilt_sensor:  their errors
    body:                 the ball as a rigid body, if identified"""

    stage: StageModel
    balls: dict[int, BallModel]
    camera_delay: float = 0.0
    camera_delay_stderr: float | None = None
    kind: str = "p"
    rate_hz: float = 30.0
    data: tuple[dict[str, Any], ...] = ()
    scores: dict[str, Any] = field(default_factory=dict)
    processes: dict[int, GaussianProcess] = field(default_factory=dict, compare=False)
    camera: Camera = field(default_factory=Camera)
    tilt_sensor: TiltSensor = field(default_factory=TiltSensor)
    body: Body | None = None

    def ball(self, ring: int) -> BallModel:
        """The ball model of a ring, or of the nearest ring that has one."""
        return ball_of(self.balls, ring)

    def by_effects(self, ring: int) -> bool:
        """Whether effects describe the ball in a ring; False if a learned part replaces them (kind np)."""
        return not (self.kind == "np" and ring in self.processes)

    def ring_parameters(self, ring: int, radius: float) -> RingParameters:
        """Parameters of a plan along a ring; radius: of the ball's track, m. The stage is on the safe side."""
        careful = ((axis, *axis.careful(FASTEST)) for axis in (self.true_stage.beta, self.true_stage.gamma))
        beta, gamma = (replace(axis, order=2, natural_frequency=w, damping=z) for axis, w, z in careful)
        return RingParameters(radius, self.ball(ring).planned, beta, gamma, physics=self.by_effects(ring))

    def planar(self, maze: Maze) -> PlanarModel:
        """The planar model of ball and stage in a maze."""
        return PlanarModel.build(maze, self.true_stage, self.balls)

    @property
    def delay_known(self) -> bool:
        """Whether the camera's delay was identified or set; otherwise a run has to estimate it."""
        return self.kind != "p" or self.camera_delay != 0.0 or self.camera_delay_stderr is not None

    @property
    def late_s(self) -> float:
        """Time from a picture to the earliest effect of a command, s; infinite if unknown."""
        return self.camera_delay + self.stage.dead_time if self.delay_known else math.inf

    def late_by(self, latency: Latency) -> RigModel:
        """The model with the measured delays of the rig."""
        stage = StageModel(*(replace(a, dead_time=latency.command_s) for a in (self.stage.beta, self.stage.gamma)))
        stderr = self.camera_delay_stderr or LATENCY_STDERR
        return replace(self, stage=stage, camera_delay=latency.camera_s, camera_delay_stderr=stderr)

    def declared(self, ring: int) -> dict[str, dict[str, float]]:
        """Effects of a ring and of the rig's parts, as {effect: {parameter: value}}.

        The camera's offset is missing, because it is subtracted from the measured positions."""
        known = {effect.name: effect.values() for effect in self.ball(ring).effects}
        return known | declared_parts(self)

    @property
    def true_stage(self) -> StageModel:
        """The stage in true tilts; `stage` is in measured tilts."""
        if self.tilt_sensor == TiltSensor():
            return self.stage
        gains = self.tilt_sensor.gain_beta, self.tilt_sensor.gain_gamma
        axes = zip((self.stage.beta, self.stage.gamma), gains, strict=True)
        return StageModel(*(axis.by_gain(k) for axis, k in axes))

    @classmethod
    def nominal(cls, maze: Maze) -> RigModel:
        """Textbook values for a rig without a model.

        The ball rolls on floor and wall (in the disc: on the floor), with a little viscous friction and the dry
        friction of steel on a printed floor. The servos settle in 0.2 s, the table is level, the delay of the camera
        is unknown."""
        balls = {}
        for ring in maze.rings:
            factor = rolling_inertia(FREE_ROLLING if ring.is_disc else WALL_ROLLING)
            dry = dry_friction(NOMINAL_DRY / max(ring.track_radius, 0.5 * ring.outer_radius))
            balls[ring.number] = BallModel((factor, viscous_friction(0.3), dry))
        return cls(StageModel(), balls)


def declared_parts(model: RigModel) -> dict[str, dict[str, float]]:
    """Effects of stage, tilt sensor and camera in a model, without neutral ones: {effect: {parameter: value}}."""
    found = {}
    for effect in FAMILY:
        values = part_values(model, effect)
        neutral = all(values[name] == p.default for name, p in effect.parameters.items()) and effect.name not in ALWAYS
        at_once = effect.name == "command_delay" and values["delay"] <= DEAD_TIME
        if effect.name not in TAKEN_OFF and not neutral and not at_once:
            found[effect.name] = values
    return found


def part_values(model: RigModel, effect: Effect) -> dict[str, float]:
    """Values of the parameters of an effect in a model."""
    return {name: min(_read(model, place), effect.parameters[name].high) for name, place in effect.entry.items()}


def part_stderr(model: RigModel, effect: Effect) -> dict[str, float]:
    """Standard errors of the parameters of an effect in a model; NaN if unknown."""
    return {name: _stderr(model, place) for name, place in effect.entry.items()}


def with_part(model: RigModel, effect: Effect, values: Mapping[str, float], stderr: Mapping[str, float]) -> RigModel:
    """The model with new parameters of an effect, clipped to their bounds."""
    for name, value in values.items():
        p = effect.parameters[name]
        inside = min(max(value, p.low), p.high)
        model = _write(model, effect.entry[name], inside, stderr.get(name, math.inf))
    return model


def _owners(model: RigModel, place: str) -> tuple[dict[str, Any], str]:
    """The objects that have the number of an entry, by their names in the model or in its stage; and its name there."""
    part, *names = place.split(".")
    if part != "stage":
        return {part: getattr(model, part)}, names[0]
    return {axis: getattr(model.stage, axis) for axis in (AXES if names[0] == "*" else names[:1])}, names[1]


def _read(model: RigModel, place: str) -> float:
    if place == DELAY:
        return model.camera_delay
    owners, name = _owners(model, place)
    first, *rest = (float(getattr(owner, name)) for owner in owners.values())
    return (first + sum(rest)) / len(owners) if rest else first


def _stderr(model: RigModel, place: str) -> float:
    if place == DELAY:
        return math.nan if model.camera_delay_stderr is None else model.camera_delay_stderr
    owners, name = _owners(model, place)
    return math.hypot(*(owner.stderr.get(name, math.nan) for owner in owners.values())) / len(owners)


def _write(model: RigModel, place: str, value: float, stderr: float) -> RigModel:
    if place == DELAY:
        return replace(model, camera_delay=max(value, -model.stage.dead_time), camera_delay_stderr=stderr)
    owners, name = _owners(model, place)
    stderr *= math.sqrt(len(owners))  # `_stderr` reads the error of the mean of independent axes
    new = {key: replace(o, **{name: value}, stderr={**o.stderr, name: stderr}) for key, o in owners.items()}
    return replace(model, stage=replace(model.stage, **new)) if place.startswith("stage") else replace(model, **new)


def same_rings(a: Maze, b: Maze) -> bool:
    """Whether two mazes have the same rings, so that a model of one is a model of the other."""
    return len(a.rings) == len(b.rings) and all(
        abs(p.inner_radius - q.inner_radius) < SAME_RADIUS_M and abs(p.outer_radius - q.outer_radius) < SAME_RADIUS_M
        for p, q in zip(a.rings, b.rings, strict=True)
    )


def transfer_model(model: RigModel, home: Maze, maze: Maze) -> RigModel:
    """The physics of a model of the maze `home`, for `maze`; the model itself if both have the same rings.

    Stage, delays, sensors and the tilt of the table belong to the rig and stay. A ring takes the effects of the ring of
    `home` with the nearest radius, scaled by their power of the radius; a disc takes those of the disc. Effects at
    certain places and learned parts are left out."""
    if same_rings(home, maze):
        return model
    balls = {}
    for ring in maze.rings:
        if ring.is_disc and len(home.rings) not in model.balls:
            continue  # the disc of `home` has no model either
        like = min((r for r in home.rings if r.is_disc == ring.is_disc), key=lambda r: abs(_radius(r) - _radius(ring)))
        ratio = _radius(ring) / _radius(like)
        effects = [
            e.effect(**{k: value * ratio ** powers[k] for k, value in e.values().items()})
            for e in model.ball(like.number).effects
            if (powers := e.effect.by_radius) is not None
        ]
        balls[ring.number] = BallModel(tuple(effects))
    return replace(model, balls=balls, kind="p" if model.kind == "p" else "pi", processes={})


def _radius(ring: Ring) -> float:
    """Typical radius of the ball: that of the track; in the disc half of the outer radius."""
    return ring.track_radius or 0.5 * ring.outer_radius


def fits_words(model: RigModel) -> str:
    """One line about stage and ball; empty for a model that does not know how well it fits."""
    fits: dict[str, float] = model.scores.get("fits") or {}
    words = [
        f"the {part} {'fits' if times <= FITS else 'does not fit'} ({times:.1f} times its noise)"
        for part, times in fits.items()
    ]
    hints = ["a servo of another kind?"] if fits.get("stage", 0.0) > FITS else []
    hints += [_hint(model)] if fits.get("ball", 0.0) > FITS else []
    return ", ".join(words) + (": " + " ".join(hints) if hints else "")


def _hint(model: RigModel) -> str:
    """What a ball that does not fit may be."""
    factors = [ball.parameter("rolling_inertia", "factor", 0.0) for ball in model.balls.values()]
    wall = model.body.values.get("wall", 0.0) if model.body is not None else 1.0
    return f"{kind_of_ball(max(factors, default=0.0) > SLIDING, wall)}?"


def kind_of_ball(slides: bool, wall: float) -> str:
    """What a ball that does not fit may be, by its numbers. wall: friction coefficient at a wall"""
    if slides:
        return "a ball that slides"
    return "walls without friction" if wall < SMOOTH else "an unbalanced ball, or soft walls"
