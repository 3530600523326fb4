"""Model folders: `model.yaml`, which a person can read and edit, holds everything a fitted model knows.

    format: 1
    kind: pi
    rate_hz: 30
    camera_delay_s: {value: 0.0667, stderr: 0.0004}
    stage: {beta: {gain: {value: 1.0, stderr: 0.001}, ...}, gamma: {...}}
    camera: {offset_x: {value: 0.001, unit: m}, offset_y: ..., angle: {value: 0.01, unit: rad}}
    tilt_sensor: {gain_beta: {value: 1.02, unit: "1"}, gain_gamma: ...}
    rings: {1: {rolling_inertia: {factor: {value: 0.52, stderr: 0.003, unit: "1"}}, ...}, ...}
    body: {of: 1f..., rolling: {value: 0.082, stderr: 0.001, unit: m/s^2}, ...}
    processes: {1: {file: ring1.npz, sha256: ..., rows: 4000, kernel: rbf, amplitude: ..., lengthscales: ...}, ...}
    data: [{file: ..., sha256: ...}, ...]
    scores: {...}

What says nothing is left out: a camera above the plate's middle and in line with its axes, a sensor that is calibrated,
gears without play, axes that do not share commands. A ring may hold any effect on the ball (`physics.registry`).
A plain number may stand for {value: number}. Kinds np and sp have processes, whose arrays lie beside the file
(`processfile`). Nothing is executed on loading.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Any, TypeVar

import yaml

from mazeplan import filekinds, resources
from mazeplan.constants import FREE_ROLLING, WALL_ROLLING
from mazeplan.errors import ModelError
from mazeplan.maths.fingerprint import LATER
from mazeplan.maze.geometry import Maze
from mazeplan.maze.yamltree import Key, Tree, key_path, read_yaml, shown
from mazeplan.models.bodyentries import Body, body_entries, read_body
from mazeplan.models.gaussian_process import GaussianProcess
from mazeplan.models.processfile import read_process, write_process
from mazeplan.physics.ball import dry_friction, rolling_inertia, viscous_friction
from mazeplan.physics.ball_model import BallModel
from mazeplan.physics.effect import Term
from mazeplan.physics.entries import declared_parts
from mazeplan.physics.registry import EFFECTS, make_term
from mazeplan.physics.sensors import Camera, TiltSensor
from mazeplan.physics.stage import StageAxis, StageModel
from mazeplan.records import Latency

Sensor = TypeVar("Sensor", Camera, TiltSensor)
FORMAT = 1
KINDS = ("p", "pi", "np", "sp")
PACKAGED = resources.PACKAGE / "models" / "packaged"
AXIS_UNITS = {"gain": "1", "natural_frequency": "rad/s", "damping": "1", "dead_time": "s", "offset": "rad"}
AXIS_MORE = {"backlash": "rad", "deadband": "rad", "coupling": "1"}  # written where they are not nought
CAMERA_UNITS = {
    "offset_x": "m", "offset_y": "m", "angle": "rad", "scale": "1", "distortion": "1/m^2", "distortion_x": "m",
    "distortion_y": "m",
}  # fmt: skip
SENSOR_UNITS = {"gain_beta": "1", "gain_gamma": "1"}
LATENCY_STDERR = 0.002  # s, of a delay that was measured while the plate swung
NOMINAL_DRY = 0.05  # m/s^2; a steel ball that stays where it is up to 0.4 deg


@dataclass(frozen=True)
class RigModel:
    """Everything that estimation and planning know of a rig.

    stage: both axes; camera_delay: s that the ball's position is behind the tilt sensor; balls: ring number -> model;
    kind: p, pi, np or sp; processes: ring number -> what a Gaussian process adds to the effects (sp), or has
    in their place (np); rate_hz; data, scores: what it came from and how well it did, as written in the file;
    camera, tilt_sensor: what is off with them; body: a ball with a body, where there is one."""

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
    body: Body | None = field(default=None, metadata=LATER)

    def ball(self, ring: int) -> BallModel:
        """The ball model of a ring; of the nearest ring that has one, when this one has none."""
        nearest = min(self.balls, key=lambda number: abs(number - ring))
        return self.balls[nearest]

    def by_effects(self, ring: int) -> bool:
        """Whether effects say how the ball moves in a ring, and not a process in their place (kind np)."""
        return not (self.kind == "np" and ring in self.processes)

    @property
    def delay_known(self) -> bool:
        """Whether the camera's delay was identified, or written by a person; else a run has to find it out."""
        return self.kind != "p" or self.camera_delay != 0.0 or self.camera_delay_stderr is not None or bool(self.data)

    @property
    def late_s(self) -> float:
        """By how much what is seen is older than the moment at which a command acts, s; infinite where not known."""
        dead_time = max(self.stage.beta.dead_time, self.stage.gamma.dead_time)
        return self.camera_delay + dead_time if self.delay_known else math.inf

    def late_by(self, latency: Latency) -> RigModel:
        """With the delays that were measured of the rig in the place of its own."""
        stage = StageModel(*(replace(a, dead_time=latency.command_s) for a in (self.stage.beta, self.stage.gamma)))
        stderr = self.camera_delay_stderr or LATENCY_STDERR
        return replace(self, stage=stage, camera_delay=latency.camera_s, camera_delay_stderr=stderr)

    def declared(self, ring: int) -> dict[str, dict[str, float]]:
        """What it says of a ring and of the rig's parts, as {effect: {parameter: value}}. The camera's offset is not
        among them: it is taken off the measured positions."""
        known = {effect.name: effect.values() for effect in self.ball(ring).effects}
        return known | declared_parts(self)

    @property
    def true_stage(self) -> StageModel:
        """The stage in tilts as they are; `stage` is in tilts as they are measured."""
        if self.tilt_sensor == TiltSensor():
            return self.stage
        gains = self.tilt_sensor.gain_beta, self.tilt_sensor.gain_gamma
        axes = zip((self.stage.beta, self.stage.gamma), gains, strict=True)
        return StageModel(*(replace(axis, gain=axis.gain / k, offset=axis.offset / k) for axis, k in axes))

    @classmethod
    def nominal(cls, maze: Maze) -> RigModel:
        """Textbook values for a rig that has no model yet: a ball that rolls on floor and wall (in the disc: on the
        floor),
        a little viscous friction, steel on a printed floor for dry friction, a servo that settles in 0.2 s, a camera
        whose delay is not known (`estimation.delay_bank` finds it out), a level table."""
        balls = {
            ring.number: BallModel(
                (
                    rolling_inertia(FREE_ROLLING if ring.is_disc else WALL_ROLLING),
                    viscous_friction(0.3),
                    dry_friction(NOMINAL_DRY / max(ring.track_radius, 0.5 * ring.outer_radius)),
                )
            )
            for ring in maze.rings
        }
        return cls(StageModel(), balls)


def model_names() -> tuple[str, ...]:
    """Names of the packaged models."""
    return tuple(sorted(path.parent.name for path in PACKAGED.glob("*/model.yaml")))


def load_model(source: str | Path) -> RigModel:
    """The model in a folder, or the packaged one of that name. Raises ModelError with file, line and key."""
    folder = Path(source)
    if not folder.exists() and str(source) in model_names():
        folder = PACKAGED / str(source)
    path = folder if folder.suffix == ".yaml" else folder / "model.yaml"
    if not path.exists():
        what = filekinds.got(folder)
        told = "no such model; " if what == "no such file" else f"got {what}, "
        raise ModelError(f"{told}expected a folder with model.yaml, or one of {', '.join(model_names())}", file=source)
    return _Reader(read_yaml(path, error=ModelError, what="a model (model.yaml)"), path).model()


def model_stamp(source: str | Path) -> tuple[tuple[str, int, int], ...]:
    """Name, ns of the last change and size of each file beside a model, by which one sees whether it was edited; of a
    packaged one nothing."""
    folder = Path(source).parent if Path(source).suffix == ".yaml" else Path(source)
    files = sorted(path for path in folder.iterdir() if path.is_file()) if folder.is_dir() else []
    return tuple((path.name, path.stat().st_mtime_ns, path.stat().st_size) for path in files)


class _Reader:
    """Turns the tree of a model.yaml into a RigModel, or raises with line and key."""

    def __init__(self, tree: Tree, path: Path) -> None:
        self._tree, self._path = tree, path

    def fail(self, problem: str, *key: str | int) -> ModelError:
        """The error at a key."""
        return ModelError(problem, file=self._path, line=self._tree.line(key), key=key_path(key) or None)

    def section(
        self, node: Any, key: Key, allowed: tuple[str, ...] | None, needed: tuple[str, ...] = ()
    ) -> dict[str, Any]:
        """A mapping with only allowed and all needed keys."""
        if not isinstance(node, dict):
            raise self.fail(f"got {shown(node)}, expected a mapping", *key)
        for name in node:
            if allowed is not None and name not in allowed:
                raise self.fail(f"unknown key, expected one of {', '.join(allowed)}", *key, name)
        for name in needed:
            if name not in node:
                raise self.fail(f"{name} is missing", *key)
        return node

    def number(self, node: Any, *key: str | int, unit: str | None = None) -> tuple[float, float | None]:
        """(value, standard error) of a number or {value, stderr, unit}; unit: it must be in, if it says one."""
        stderr: float | None = None
        if isinstance(node, dict):
            self.section(node, key, ("value", "stderr", "unit"), ("value",))
            if unit is not None and str(node.get("unit", unit)) != unit:
                raise self.fail(f"got {shown(node['unit'])}, expected {unit}", *key, "unit")
            if node.get("stderr") is not None:
                stderr = self.number(node["stderr"], *key, "stderr")[0]
                if stderr < 0.0:
                    raise self.fail(f"got {stderr:g}, expected a number >= 0", *key, "stderr")
            node = node["value"]
        if isinstance(node, bool) or not isinstance(node, int | float) or not math.isfinite(node):
            raise self.fail(f"got {shown(node)}, expected a finite number", *key)
        return float(node), stderr

    def model(self) -> RigModel:
        """The whole file."""
        known = ("format", "kind", "rate_hz", "camera_delay_s", "stage", "camera", "tilt_sensor", "rings", "body",
                 "processes", "data", "scores")  # fmt: skip
        root = self.section(self._tree.data, (), known, ("format", "stage", "rings"))
        if root["format"] != FORMAT:
            newer = isinstance(root["format"], int) and root["format"] > FORMAT
            advice = "; it was written by a newer version of mazeplan" if newer else ""
            raise self.fail(f"got {shown(root['format'])}, expected {FORMAT}{advice}", "format")
        delay, delay_stderr = self.number(root.get("camera_delay_s", 0.0), "camera_delay_s", unit="s")
        if not 0.0 <= delay <= 0.5:
            raise self.fail(f"got {delay}, expected 0 to 0.5 s", "camera_delay_s")
        stage = self.section(root["stage"], ("stage",), ("beta", "gamma"), ("beta", "gamma"))
        rings = self.section(root["rings"], ("rings",), None)
        if not rings:
            raise self.fail("expected at least one ring", "rings")
        kind = root.get("kind", "p")
        if kind not in KINDS:
            raise self.fail(f"got {shown(kind)}, expected one of {', '.join(KINDS)}", "kind")
        rate = self.number(root.get("rate_hz", 30.0), "rate_hz")[0]
        if rate <= 0.0:
            raise self.fail(f"got {rate:g}, expected a number > 0", "rate_hz")
        data = [] if root.get("data") is None else root["data"]
        if not isinstance(data, list):
            raise self.fail(f"got {shown(data)}, expected a list", "data")
        scores = {} if root.get("scores") is None else root["scores"]
        return RigModel(
            stage=StageModel(self.axis(stage["beta"], "beta"), self.axis(stage["gamma"], "gamma")),
            balls={self.ring_number(name): self.ball(node, name) for name, node in rings.items()},
            camera_delay=delay,
            camera_delay_stderr=delay_stderr,
            kind=kind,
            rate_hz=rate,
            data=tuple(self.section(entry, ("data", i), None) for i, entry in enumerate(data)),
            scores=self.section(scores, ("scores",), None),
            processes=self.processes(root.get("processes"), kind),
            camera=self.numbers(Camera, root.get("camera"), "camera", CAMERA_UNITS),
            tilt_sensor=self.numbers(TiltSensor, root.get("tilt_sensor"), "tilt_sensor", SENSOR_UNITS),
            body=read_body(self, root.get("body")),
        )

    def numbers(self, kind: type[Sensor], node: Any, key: str, units: Mapping[str, str]) -> Sensor:
        """A section that is a few numbers and nothing else."""
        if node is None:
            return kind()
        names = tuple(f.name for f in fields(kind) if f.name != "stderr")
        known = self.section(node, (key,), names)
        found = {name: self.number(value, key, name, unit=units[name]) for name, value in known.items()}
        try:
            return kind(
                **{name: value for name, (value, _) in found.items()},
                stderr={name: s for name, (_, s) in found.items() if s is not None},
            )
        except ValueError as problem:
            raise self.fail(str(problem), key) from None

    def processes(self, node: Any, kind: str) -> dict[int, GaussianProcess]:
        """The processes of a model of kind np or sp; their arrays are read and checked against what the file says."""
        learned, empty = kind in ("np", "sp"), node is None or node == {}
        if empty or not learned:
            if empty == learned:
                problem = f"kind {kind} {'needs' if learned else 'has no'} processes"
                raise self.fail(problem, "kind" if empty else "processes")
            return {}
        out = {}
        for name, entry in self.section(node, ("processes",), None).items():
            self.section(entry, ("processes", name), None, ("file", "sha256"))
            try:
                out[self.ring_number(name, "processes")] = read_process(self._path.parent, entry)
            except ValueError as problem:
                raise self.fail(str(problem), "processes", name) from None
        return out

    def ring_number(self, name: str, section: str = "rings") -> int:
        """The number of a ring from its key."""
        if not re.fullmatch("[1-9][0-9]{0,3}", name):
            raise self.fail(f"got {shown(name)}, expected a ring number from 1", section, name)
        return int(name)

    def axis(self, node: Any, name: str) -> StageAxis:
        """One axis of the stage."""
        key = ("stage", name)
        units = AXIS_UNITS | AXIS_MORE
        self.section(node, key, tuple(units))
        numbers = {k: self.number(v, *key, k, unit=units[k]) for k, v in node.items()}
        try:
            return StageAxis(
                **{k: value for k, (value, _) in numbers.items()},
                stderr={k: s for k, (_, s) in numbers.items() if s is not None},
            )
        except ValueError as problem:
            raise self.fail(str(problem), *key) from None

    def ball(self, node: Any, ring: str) -> BallModel:
        """The effects of one ring."""
        key = ("rings", ring)
        effects: list[Term] = []
        stderr: dict[str, dict[str, float]] = {}
        for name, parameters in self.section(node, key, None).items():
            self.section(parameters, (*key, name), None)
            known = EFFECTS[name].parameters if name in EFFECTS else {}
            units = {k: known[k].unit if k in known else None for k in parameters}
            numbers = {k: self.number(v, *key, name, k, unit=units[k]) for k, v in parameters.items()}
            try:
                effects.append(make_term(name, {k: value for k, (value, _) in numbers.items()}))
            except ValueError as problem:
                raise self.fail(str(problem), *key, name) from None
            stderr[name] = {k: s for k, (_, s) in numbers.items() if s is not None}
        return BallModel(tuple(effects), stderr)


def _entry(value: float, stderr: float | None, unit: str) -> dict[str, Any]:
    entry: dict[str, Any] = {"value": float(f"{value:.6g}")}
    if stderr is not None and math.isfinite(stderr):
        entry["stderr"] = float(f"{stderr:.2g}")
    return {**entry, "unit": unit}


def _told(camera: Camera) -> dict[str, str]:
    """Units of what a file says of a camera: place and angle, and what else is off."""
    usual = ("offset_x", "offset_y", "angle")
    return {k: u for k, u in CAMERA_UNITS.items() if k in usual or getattr(camera, k) != getattr(Camera(), k)}


def _entries(part: StageAxis | Camera | TiltSensor, units: Mapping[str, str]) -> dict[str, Any]:
    return {k: _entry(getattr(part, k), part.stderr.get(k), unit) for k, unit in units.items()}


def model_document(model: RigModel, processes: Mapping[int, Mapping[str, Any]] | None = None) -> dict[str, Any]:
    """What `save_model` writes; processes: what is said of the arrays beside it."""
    stage = {
        name: _entries(axis, AXIS_UNITS | {key: unit for key, unit in AXIS_MORE.items() if getattr(axis, key)})
        for name, axis in (("beta", model.stage.beta), ("gamma", model.stage.gamma))
    }
    off = {
        name: _entries(part, units)
        for name, part, units in (
            ("camera", model.camera, _told(model.camera)),
            ("tilt_sensor", model.tilt_sensor, SENSOR_UNITS),
        )
        if part != type(part)()
    }
    rings = {
        ring: {
            effect.name: {
                k: _entry(value, ball.stderr.get(effect.name, {}).get(k), effect.effect.parameters[k].unit)
                for k, value in effect.values().items()
            }
            for effect in ball.effects
        }
        for ring, ball in sorted(model.balls.items())
    }
    return {
        "format": FORMAT,
        "kind": model.kind,
        "rate_hz": model.rate_hz,
        "camera_delay_s": _entry(model.camera_delay, model.camera_delay_stderr, "s"),
        "stage": stage,
        **off,
        "rings": rings,
        **({} if model.body is None else {"body": body_entries(model.body, _entry)}),
        **({"processes": processes} if processes else {}),
        "data": [dict(entry) for entry in model.data],
        "scores": dict(model.scores),
    }


class _Dumper(yaml.SafeDumper):
    """Innermost mappings on one line, as people write them."""


def _mapping(dumper: _Dumper, data: Mapping[str, Any]) -> yaml.Node:
    flat = bool(data) and all(not isinstance(value, dict | list) for value in data.values())
    return dumper.represent_mapping("tag:yaml.org,2002:map", data.items(), flow_style=flat)


_Dumper.add_representer(dict, _mapping)


def save_model(model: RigModel, folder: str | Path) -> Path:
    """Write the folder (made if need be) and return the path of its model.yaml. Raises ModelError."""
    path = Path(folder) / "model.yaml"
    if model.kind in ("np", "sp") and not model.processes:
        raise ModelError(f"kind {model.kind} needs processes", file=path, key="kind")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        beside = {ring: write_process(path.parent, ring, process) for ring, process in sorted(model.processes.items())}
        text = yaml.dump(model_document(model, beside), Dumper=_Dumper, sort_keys=False, width=120)
        path.write_text(text, encoding="utf-8")
    except OSError as problem:
        raise ModelError(f"cannot be written: {problem.strerror}", file=path) from None
    return path
