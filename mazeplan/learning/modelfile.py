"""Model folders: `model.yaml` holds everything that a fitted model knows. A person can read and edit it.

    format: 1
    kind: pi
    rate_hz: 30
    camera_delay_s: {value: 0.0667, stderr: 0.0004}
    stage: {beta: {gain: {value: 1.0, stderr: 0.001}, ...}, gamma: {follows: at once, ...}}
    camera: {offset_x: {value: 0.001, unit: m}, offset_y: ..., angle: {value: 0.01, unit: rad}}
    tilt_sensor: {gain_beta: {value: 1.02, unit: "1"}, gain_gamma: ...}
    rings: {1: {rolling_inertia: {factor: {value: 0.52, stderr: 0.003, unit: "1"}}, ...}, ...}
    body: {of: 1f..., rolling: {value: 0.082, stderr: 0.001, unit: m/s^2}, ..., terms: {floor_warp: ...}}
    processes: {1: {file: ring1.npz, sha256: ...}, ...}
    data: [{file: ..., sha256: ...}, ...]
    scores: {...}

A plain number may replace {value: number}. Sections and parameters at their defaults are left out (camera, tilt
sensor, play, coupling). A ring may hold any effect on the ball (`physics.registry`). The arrays of a Gaussian process
are in files beside it (`gp_file`). Loading executes nothing. A log holds a model folder as a zip file (`packed_model`).
"""

from __future__ import annotations

import io
import math
import re
import zipfile
import zlib
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Literal

import yaml
from pydantic import Field, TypeAdapter, ValidationError, model_validator

from mazeplan.core import file_kinds, resources
from mazeplan.core.errors import ModelError, one_of
from mazeplan.core.whole_file import whole_file
from mazeplan.learning.gaussian_process import GaussianProcess
from mazeplan.learning.gp_file import read_process, write_process
from mazeplan.learning.rig_model import RigModel
from mazeplan.learning.rigid_body_entries import KEPT, PARAMETERS, Body
from mazeplan.maze.sections import MISSING, Section, problems
from mazeplan.maze.yamltree import Tree, check_format, key_path, read_yaml, shown
from mazeplan.physics.ball_model import BallModel
from mazeplan.physics.effect import Effect, Term
from mazeplan.physics.effects.local_forces import FAMILY as LOCAL
from mazeplan.physics.registry import EFFECTS
from mazeplan.physics.rig.sensors import Camera, TiltSensor
from mazeplan.physics.rig.stage import ORDERS, PROMPT, StageAxis, StageModel

FORMAT = 1
AXIS_UNITS = {"gain": "1", "natural_frequency": "rad/s", "damping": "1", "dead_time": "s", "offset": "rad"}
# these are written if they are not at their default
AXIS_MORE = {"backlash": "rad", "deadband": "rad", "coupling": "1", "rate_limit": "rad/s", "resolution": "rad"}
CAMERA_UNITS = {"offset_x": "m", "offset_y": "m", "angle": "rad"}
CAMERA_MORE = {"scale": "1", "distortion": "1/m^2", "distortion_x": "m", "distortion_y": "m"}
SENSOR_UNITS = {"gain_beta": "1", "gain_gamma": "1"}
BODY_UNITS = {name: PARAMETERS[name].unit for name in KEPT}
ROUNDED = 1e-6  # s; precision of a delay in a file
PROCESSES = ("np", "sp")
KINDS = ("p", "pi", *PROCESSES)
PACKAGED = resources.PACKAGE / "learning" / "packaged"
ATTACHED, MEDIA_TYPE = "model.zip", "application/zip"
LARGEST = 32 * 2**20  # maximum bytes of an unpacked model; packaged models have one or two MB
MEMBER = re.compile(r"model\.yaml|ring[0-9]{1,3}\.npz")


def model_names() -> tuple[str, ...]:
    """Names of the packaged models."""
    return tuple(sorted(path.parent.name for path in PACKAGED.glob("*/model.yaml")))


def is_packaged_model(source: str | Path) -> bool:
    """Whether `source` means a packaged model: see `resources.is_packaged`."""
    return resources.is_packaged(source, model_names())


def model_path(source: str | Path) -> Path:
    """The model.yaml in a folder, or of the packaged model of that name. Raises ModelError if there is none."""
    folder = PACKAGED / source if is_packaged_model(source) else Path(source)
    path = folder if folder.suffix == ".yaml" else folder / "model.yaml"
    if not path.exists():
        what = file_kinds.got(folder)
        problem = "no such model; " if what == "no such file" else f"got {what}, "
        inside = folder / "model"
        meant = f"; did you mean {inside}?" if (inside / "model.yaml").exists() else ""
        expected = f"expected a folder with model.yaml, or {one_of(model_names(), str(source))}{meant}"
        raise ModelError(problem + expected, file=source)
    return path


def load_model(source: str | Path) -> RigModel:
    """The model in a folder, or the packaged model of that name. Raises ModelError with file, line and key."""
    path = model_path(source)
    return _Reader(read_yaml(path, error=ModelError, what="a model (model.yaml)"), path).model()


def model_stamp(source: str | Path) -> tuple[tuple[str, int, int], ...]:
    """Name, time of the last change (ns) and size of each file of a model folder; empty for a packaged model."""
    if is_packaged_model(source):
        return ()
    folder = Path(source).parent if Path(source).suffix == ".yaml" else Path(source)
    files = sorted(path for path in folder.iterdir() if path.is_file()) if folder.is_dir() else []
    return tuple((path.name, path.stat().st_mtime_ns, path.stat().st_size) for path in files)


class Entry(Section):
    """A number, with its standard error and unit; a plain number is its value."""

    value: float
    stderr: float | None = Field(default=None, ge=0)
    unit: str | None = None

    @model_validator(mode="before")
    @classmethod
    def _plain(cls, given: Any) -> Any:
        return given if isinstance(given, dict) else {"value": given}


Entries = dict[str, Entry]


class ModelFile(Section):
    """The content of model.yaml."""

    format: int
    kind: Literal["p", "pi", "np", "sp"] = "p"
    rate_hz: float = Field(default=30.0, ge=1, le=1000)
    camera_delay_s: Entry = Entry(value=0.0)
    stage: dict[str, dict[str, Any]]
    camera: Entries | None = None
    tilt_sensor: Entries | None = None
    rings: dict[str, dict[str, Entries]] = Field(min_length=1)
    body: dict[str, Any] | None = None
    processes: dict[str, dict[str, str]] | None = None
    data: list[dict[str, Any]] | None = None
    scores: dict[str, Any] | None = None


class _Reader:
    """Turns the tree of a model.yaml into a RigModel. Its methods raise ModelError with line and key."""

    def __init__(self, tree: Tree, path: Path) -> None:
        self._tree = tree
        self._path = path

    def fail(self, problem: str, *key: str | int) -> ModelError:
        """The error at a key, or at the nearest one above it in the file."""
        while key and key not in self._tree.lines:
            key = key[:-1]
        return ModelError(problem, file=self._path, line=self._tree.line(key), key=key_path(key) or None)

    def valid(self, kind: Any, node: Any, *key: str | int) -> Any:
        """The node at a key as a value of this kind."""
        try:
            return TypeAdapter(kind).validate_python(node, strict=True)
        except ValidationError as wrong:
            where, said = problems(kind, wrong)[0]
            missing = said == MISSING
            raise self.fail(f"{where[-1]} {said}" if missing else said, *key, *where[: len(where) - missing]) from None

    def part(self, entries: Entries, units: Mapping[str, str], build: Callable[..., Any], *key: str | int) -> Any:
        """What `build` makes of the values and standard errors of a section. units: of each allowed name."""
        for name, entry in entries.items():
            if name not in units:
                raise self.fail(f"unknown key, expected {one_of(tuple(units), name)}", *key, name)
            if entry.unit not in (None, units[name]):
                raise self.fail(f"got {shown(entry.unit)}, expected {units[name]}", *key, name, "unit")
        stderr = {name: entry.stderr for name, entry in entries.items() if entry.stderr is not None}
        try:
            return build({name: entry.value for name, entry in entries.items()}, stderr)
        except ValueError as problem:
            raise self.fail(str(problem), *key) from None

    def model(self) -> RigModel:
        """The whole file."""
        check_format(self._tree, FORMAT, file=self._path, error=ModelError)
        file: ModelFile = self.valid(ModelFile, self._tree.data)
        if file.stage.keys() != {"beta", "gamma"}:
            raise self.fail(f"got {', '.join(file.stage)}, expected beta and gamma", "stage")
        stage = StageModel(self.axis(file.stage["beta"], "beta"), self.axis(file.stage["gamma"], "gamma"))
        delay = file.camera_delay_s
        if not -stage.dead_time - ROUNDED <= delay.value <= 0.5:
            problem = f"got {delay.value}, expected {0.0 - stage.dead_time:.3g} to 0.5 s"
            raise self.fail(problem, "camera_delay_s")
        return RigModel(
            stage=stage,
            balls={self.ring_number(name, "rings"): self.ball(node, name) for name, node in file.rings.items()},
            camera_delay=delay.value,
            camera_delay_stderr=delay.stderr,
            kind=file.kind,
            rate_hz=file.rate_hz,
            data=tuple(file.data or ()),
            scores=file.scores or {},
            processes=self.processes(file.processes or {}, file.kind),
            camera=self.part(
                file.camera or {}, CAMERA_UNITS | CAMERA_MORE, lambda v, s: Camera(**v, stderr=s), "camera"
            ),
            tilt_sensor=self.part(
                file.tilt_sensor or {}, SENSOR_UNITS, lambda v, s: TiltSensor(**v, stderr=s), "tilt_sensor"
            ),
            body=None if file.body is None else self.body(dict(file.body)),
        )

    def processes(self, entries: Mapping[str, Mapping[str, str]], kind: str) -> dict[int, GaussianProcess]:
        """The Gaussian processes of a model; their arrays are checked against the file."""
        if bool(entries) != (kind in PROCESSES):
            has = "has" if entries else "lacks"
            raise self.fail(f"got {kind}, but the file {has} Gaussian processes (section processes)", "kind")
        out = {}
        for name, entry in entries.items():
            if entry.keys() != {"file", "sha256"}:
                raise self.fail(f"got {', '.join(entry)}, expected file and sha256", "processes", name)
            try:
                out[self.ring_number(name, "processes")] = read_process(self._path.parent, **entry)
            except ValueError as problem:
                raise self.fail(str(problem), "processes", name) from None
        return out

    def ring_number(self, name: str, section: str) -> int:
        """The number of a ring from its key."""
        if not re.fullmatch("[1-9][0-9]{0,3}", name):
            raise self.fail(f"got {shown(name)}, expected a ring number from 1", section, name)
        return int(name)

    def axis(self, node: Mapping[str, Any], name: str) -> StageAxis:
        """One axis of the stage. An axis that follows at once has no frequency, one of first order no damping."""
        node, kind, gears = dict(node), node.get("follows", ORDERS[2]), node.get("backlash")
        if kind not in ORDERS:
            raise self.fail(f"got {shown(kind)}, expected {one_of(ORDERS, str(kind))}", "stage", name, "follows")
        node.pop("follows", None)
        order = ORDERS.index(kind)
        usual: dict[str, Any] = {} if order == 2 else {"damping": 1.0}
        if order == 0 and isinstance(at_least := node.get("natural_frequency"), dict):
            node["natural_frequency"] = at_least.get("faster_than", PROMPT)
        if isinstance(gears, dict):
            node["backlash"] = {key: value for key, value in gears.items() if key != "behind_the_lag"}
            usual["behind"] = bool(gears.get("behind_the_lag", False))
        return self.part(
            self.valid(Entries, node, "stage", name), AXIS_UNITS | AXIS_MORE,
            lambda v, s: StageAxis(**{**usual, **v}, stderr=s, order=order), "stage", name,
        )  # fmt: skip

    def ball(self, node: Mapping[str, Entries], ring: str) -> BallModel:
        """The effects of one ring."""
        found = self.terms(node, EFFECTS, "rings", ring)
        return BallModel(tuple(term for term, _ in found), {term.name: stderr for term, stderr in found})

    def terms(self, node: Mapping[str, Entries], known: Mapping[str, Effect], *key: str) -> list[Any]:
        """The effects in a section, each with the standard errors of its parameters."""
        found = []
        for name, entries in node.items():
            if name not in known:
                own = "; an effect of your own needs --effects MODULE:FUNCTION"
                raise self.fail(f"got {shown(name)}, expected {one_of(tuple(known), name)}{own}", *key, name)
            effect = known[name]
            units = {part: p.unit for part, p in effect.parameters.items()}
            found.append(self.part(entries, units, lambda v, s, effect=effect: (effect(**v), s), *key, name))
        return found

    def body(self, node: dict[str, Any]) -> Body:
        """The ball as a rigid body."""
        of = self.valid(str, node.pop("of", None), "body", "of")
        terms = self.valid(dict[str, Entries], node.pop("terms", {}), "body", "terms")
        more = tuple(term for term, _ in self.terms(terms, {**LOCAL, **EFFECTS}, "body", "terms"))
        entries = self.valid(Entries, node, "body")
        return self.part(entries, BODY_UNITS, lambda v, s: Body(v, of, s, more), "body")


def entry(value: float, stderr: float | None, unit: str) -> dict[str, Any]:
    """A number with its standard error, if that is known, and its unit."""
    entry: dict[str, Any] = {"value": float(f"{value:.6g}")}
    if stderr is not None and math.isfinite(stderr):
        entry["stderr"] = float(f"{stderr:.2g}")
    return {**entry, "unit": unit}


def _entries(
    part: StageAxis | Camera | TiltSensor, units: Mapping[str, str], more: Mapping[str, str]
) -> dict[str, Any]:
    """The entries of a part; those of `more` only if they differ from their default."""
    usual = type(part)()
    chosen = {**units, **{name: unit for name, unit in more.items() if getattr(part, name) != getattr(usual, name)}}
    return {name: entry(getattr(part, name), part.stderr.get(name), unit) for name, unit in chosen.items()}


def _axis_entries(axis: StageAxis) -> dict[str, Any]:
    """The entries of an axis, without numbers that its kind does not have."""
    entries = _entries(axis, AXIS_UNITS, AXIS_MORE)
    if axis.behind and axis.backlash:
        entries["backlash"]["behind_the_lag"] = True
    if axis.dead_time == 0.0:
        del entries["dead_time"]
    if axis.order < 2:
        del entries["damping"]
        if axis.order == 0:
            entries["natural_frequency"] = {"faster_than": axis.natural_frequency, "unit": "rad/s"}
        return {"follows": ORDERS[axis.order], **entries}
    return entries


def _term_entries(terms: Iterable[Term], stderr: Mapping[str, Mapping[str, float]]) -> dict[str, Any]:
    return {
        term.name: {
            k: entry(value, stderr.get(term.name, {}).get(k), term.effect.parameters[k].unit)
            for k, value in term.values().items()
        }
        for term in terms
    }


def model_document(model: RigModel, processes: Mapping[int, Mapping[str, Any]] | None = None) -> dict[str, Any]:
    """The content of model.yaml; processes: entries of the learned parts, from `write_process`."""
    out: dict[str, Any] = {
        "format": FORMAT,
        "kind": model.kind,
        "rate_hz": model.rate_hz,
        "camera_delay_s": entry(model.camera_delay, model.camera_delay_stderr, "s"),
        "stage": {name: _axis_entries(getattr(model.stage, name)) for name in ("beta", "gamma")},
    }
    if model.camera != Camera():
        out["camera"] = _entries(model.camera, CAMERA_UNITS, CAMERA_MORE)
    if model.tilt_sensor != TiltSensor():
        out["tilt_sensor"] = _entries(model.tilt_sensor, SENSOR_UNITS, {})
    out["rings"] = {ring: _term_entries(ball.effects, ball.stderr) for ring, ball in sorted(model.balls.items())}
    if model.body is not None:
        values, stderr = model.body.values, model.body.stderr
        numbers = {name: entry(value, stderr.get(name), BODY_UNITS[name]) for name, value in values.items()}
        terms = {"terms": _term_entries(model.body.terms, {})} if model.body.terms else {}
        out["body"] = {"of": model.body.of, **numbers, **terms}
    if processes:
        out["processes"] = processes
    return {**out, "data": [dict(entry) for entry in model.data], "scores": dict(model.scores)}


class ModelDumper(yaml.SafeDumper):
    """Writes innermost mappings on one line."""


def _mapping(dumper: ModelDumper, data: Mapping[str, Any]) -> yaml.Node:
    flat = bool(data) and all(not isinstance(value, dict | list) for value in data.values())
    return dumper.represent_mapping("tag:yaml.org,2002:map", data.items(), flow_style=flat)


ModelDumper.add_representer(dict, _mapping)


def save_model(model: RigModel, folder: str | Path) -> Path:
    """Write the folder, created if missing. Returns the path of its model.yaml. Raises ModelError."""
    path = Path(folder) / "model.yaml"
    if model.kind in PROCESSES and not model.processes:
        raise ModelError(f"got {model.kind}, but the model has no processes", file=path, key="kind")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        beside = {ring: write_process(path.parent, ring, part) for ring, part in sorted(model.processes.items())}
        text = yaml.dump(model_document(model, beside), Dumper=ModelDumper, sort_keys=False, width=120)
        with whole_file(path) as part:
            part.write_text(text, encoding="utf-8")
    except OSError as problem:
        raise ModelError(f"cannot be written: {problem.strerror}", file=path) from None
    return path


def packed_model(model: RigModel) -> bytes:
    """The model folder as a zip file; the same bytes for the same model. Raises ModelError if it is too large."""
    out = io.BytesIO()
    with TemporaryDirectory(prefix="mazeplan-model-") as folder:
        save_model(model, folder)
        with zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED) as packed:
            for path in sorted(Path(folder).iterdir()):
                packed.writestr(zipfile.ZipInfo(path.name), path.read_bytes(), zipfile.ZIP_DEFLATED)  # dated 1980
            size = sum(member.file_size for member in packed.infolist())
    if size > LARGEST:
        raise ModelError(f"got {size / 2**20:.0f} MB, expected at most {LARGEST // 2**20}")
    return out.getvalue()


def unpacked_model(data: bytes) -> RigModel:
    """The model of a zip file made by `packed_model`. Raises ModelError for any other content."""
    with TemporaryDirectory(prefix="mazeplan-model-") as folder:
        try:
            with zipfile.ZipFile(io.BytesIO(data)) as packed:
                members = packed.infolist()
                strange = next((m.filename for m in members if not MEMBER.fullmatch(m.filename)), None)
                if strange is not None:
                    raise ModelError(f"got a file {strange[:60]!r} in it, expected model.yaml and ring1.npz ...")
                if sum(m.file_size for m in members) > LARGEST:
                    raise ModelError(f"got more than {LARGEST // 2**20} MB unpacked")
                packed.extractall(folder)
        except (zipfile.BadZipFile, zlib.error, OSError, ValueError, RuntimeError) as problem:
            raise ModelError(f"is no packed model: {problem}") from None
        return load_model(folder)
