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
are in files beside it (`gp_file`). Loading executes nothing. A log holds a model folder
as a zip file (`packed_model`).
"""

from __future__ import annotations

import io
import math
import re
import zipfile
import zlib
from collections.abc import Callable, Mapping
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, TypeVar

import yaml

from mazeplan.core import file_kinds, resources
from mazeplan.core.errors import ModelError
from mazeplan.core.name_hints import one_of
from mazeplan.core.whole_file import whole_file
from mazeplan.learning.gaussian_process import GaussianProcess
from mazeplan.learning.gp_file import read_process, write_process
from mazeplan.learning.model_document import (
    AXIS_MORE,
    AXIS_UNITS,
    BODY_UNITS,
    CAMERA_MORE,
    CAMERA_UNITS,
    FORMAT,
    SENSOR_UNITS,
    ModelDumper,
    model_document,
)
from mazeplan.learning.rig_model import RigModel
from mazeplan.learning.rigid_body_entries import KEPT, Body
from mazeplan.maze.yamltree import Key, Tree, check_format, key_path, read_yaml, shown
from mazeplan.physics.ball_model import BallModel
from mazeplan.physics.effect import Effect, Term
from mazeplan.physics.effects.local_forces import FAMILY as LOCAL
from mazeplan.physics.registry import EFFECTS, make_term
from mazeplan.physics.rig.sensors import Camera, TiltSensor
from mazeplan.physics.rig.stage import ORDERS, PROMPT, StageAxis, StageModel

Part = TypeVar("Part")
RATES = (1.0, 1000.0)  # Hz, samples of a rig
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


def _nothing_learned(kind: str) -> str:
    """The message for a file of a learned kind whose learned parts are missing."""
    make = f"make them with `mazeplan learn --kind {kind}`"
    return f"got {kind}, but there are no Gaussian processes (section processes) in this file; expected pi, or {make}"


class _Reader:
    """Turns the tree of a model.yaml into a RigModel. Its methods raise ModelError with line and key."""

    def __init__(self, tree: Tree, path: Path) -> None:
        self._tree, self._path = tree, path

    def fail(self, problem: str, *key: str | int) -> ModelError:
        """The error at a key."""
        return ModelError(problem, file=self._path, line=self._tree.line(key), key=key_path(key) or None)

    def section(
        self, node: Any, key: Key, allowed: tuple[str, ...] | None = None, needed: tuple[str, ...] = ()
    ) -> dict[str, Any]:
        """A mapping with only allowed (None: any) and all needed keys."""
        if not isinstance(node, dict):
            raise self.fail(f"got {shown(node)}, expected a mapping", *key)
        for name in node:
            if allowed is not None and name not in allowed:
                raise self.fail(f"unknown key, expected {one_of(allowed, name)}", *key, name)
        for name in needed:
            if name not in node:
                raise self.fail(f"{name} is missing", *key)
        return node

    def number(self, node: Any, *key: str | int, unit: str | None = None) -> tuple[float, float | None]:
        """(value, standard error) of a number or of {value, stderr, unit}; unit: the only allowed unit."""
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

    def part(
        self,
        node: Any,
        key: Key,
        units: Mapping[str, str] | None,
        build: Callable[[dict[str, float], dict[str, float]], Part],
    ) -> Part:
        """A part built from a section of numbers, with their values and standard errors.

        units: unit of each allowed name; None: any name."""
        self.section(node, key, None if units is None else tuple(units))
        found = {
            name: self.number(v, *key, name, unit=None if units is None else units[name]) for name, v in node.items()
        }
        try:
            return build(
                {name: value for name, (value, _) in found.items()},
                {name: stderr for name, (_, stderr) in found.items() if stderr is not None},
            )
        except ValueError as problem:
            raise self.fail(str(problem), *key) from None

    def model(self) -> RigModel:
        """The whole file."""
        known = ("format", "kind", "rate_hz", "camera_delay_s", "stage", "camera", "tilt_sensor", "rings", "body",
                 "processes", "data", "scores")  # fmt: skip
        check_format(self._tree, FORMAT, file=self._path, error=ModelError)
        root = self.section(self._tree.data, (), known, ("format", "stage", "rings"))
        delay, delay_stderr = self.number(root.get("camera_delay_s", 0.0), "camera_delay_s", unit="s")
        axes = self.section(root["stage"], ("stage",), ("beta", "gamma"), ("beta", "gamma"))
        stage = StageModel(*(self.axis(axes[name], name) for name in ("beta", "gamma")))
        least = 0.0 - stage.dead_time
        if not least - ROUNDED <= delay <= 0.5:
            expected = f"expected {least:.3g} to 0.5 s"
            raise self.fail(f"got {delay}, {expected}", "camera_delay_s")
        rings = self.section(root["rings"], ("rings",))
        if not rings:
            raise self.fail("expected at least one ring", "rings")
        kind = root.get("kind", "p")
        if kind not in KINDS:
            raise self.fail(f"got {shown(kind)}, expected {one_of(KINDS, kind)}", "kind")
        rate = self.number(root.get("rate_hz", 30.0), "rate_hz")[0]
        low, high = RATES
        if not low <= rate <= high:
            raise self.fail(f"got {rate:g}, expected {low:g} to {high:g} Hz", "rate_hz")
        data = [] if root.get("data") is None else root["data"]
        if not isinstance(data, list):
            raise self.fail(f"got {shown(data)}, expected a list", "data")
        scores = {} if root.get("scores") is None else root["scores"]
        camera, sensor = ({} if root.get(name) is None else root[name] for name in ("camera", "tilt_sensor"))
        return RigModel(
            stage=stage,
            balls={self.ring_number(name): self.ball(node, name) for name, node in rings.items()},
            camera_delay=delay,
            camera_delay_stderr=delay_stderr,
            kind=kind,
            rate_hz=rate,
            data=tuple(self.section(entry, ("data", i)) for i, entry in enumerate(data)),
            scores=self.section(scores, ("scores",)),
            processes=self.processes(root.get("processes"), kind),
            camera=self.part(camera, ("camera",), CAMERA_UNITS | CAMERA_MORE, lambda v, s: Camera(**v, stderr=s)),
            tilt_sensor=self.part(sensor, ("tilt_sensor",), SENSOR_UNITS, lambda v, s: TiltSensor(**v, stderr=s)),
            body=None if root.get("body") is None else self.body(root["body"]),
        )

    def processes(self, node: Any, kind: str) -> dict[int, GaussianProcess]:
        """The Gaussian processes of a model; their arrays are checked against the file."""
        learned, empty = kind in PROCESSES, node is None or node == {}
        if empty or not learned:
            if empty == learned:
                problem = _nothing_learned(kind) if empty else f"kind {kind} has no processes"
                raise self.fail(problem, "kind" if empty else "processes")
            return {}
        out = {}
        for name, entry in self.section(node, ("processes",)).items():
            self.section(entry, ("processes", name), ("file", "sha256"), ("file", "sha256"))
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
        """One axis of the stage. An axis that follows at once has no frequency, one of first order no damping."""
        order, node = 2, dict(self.section(node, ("stage", name)))
        if "follows" in node:
            if (kind := node.pop("follows")) not in ORDERS:
                raise self.fail(f"got {shown(kind)}, expected {one_of(ORDERS, str(kind))}", "stage", name, "follows")
            order = ORDERS.index(kind)
        if order == 0 and isinstance(node.get("natural_frequency"), dict):
            at_least = self.section(node["natural_frequency"], ("stage", name, "natural_frequency"))
            node["natural_frequency"] = at_least.get("faster_than", PROMPT)
        usual: dict[str, Any] = {} if order == 2 else {"damping": 1.0}
        if isinstance(gears := node.get("backlash"), dict):
            node["backlash"] = {key: value for key, value in gears.items() if key != "behind_the_lag"}
            usual["behind"] = bool(gears.get("behind_the_lag", False))
        return self.part(
            node, ("stage", name), AXIS_UNITS | AXIS_MORE,
            lambda v, s: StageAxis(**{**usual, **v}, stderr=s, order=order),
        )  # fmt: skip

    def ball(self, node: Any, ring: str) -> BallModel:
        """The effects of one ring."""
        effects, stderr = [], {}
        for name, parameters in self.section(node, ("rings", ring)).items():
            units = {k: p.unit for k, p in EFFECTS[name].parameters.items()} if name in EFFECTS else None
            key = ("rings", ring, name)
            term, stderr[name] = self.part(parameters, key, units, lambda v, s, name=name: (make_term(name, v), s))
            effects.append(term)
        return BallModel(tuple(effects), stderr)

    def body(self, node: Any) -> Body:
        """The ball as a rigid body."""
        of = str(self.section(node, ("body",), ("of", *KEPT, "terms"), ("of",))["of"])
        known = {**LOCAL, **EFFECTS}
        terms = self.section(node.get("terms", {}), ("body", "terms"), tuple(known))
        more = tuple(self.term(known[name], values, ("body", "terms", name))[0] for name, values in terms.items())
        numbers = {name: value for name, value in node.items() if name in KEPT}
        return self.part(numbers, ("body",), BODY_UNITS, lambda v, s: Body(v, of, s, more))

    def term(self, effect: Effect, node: Any, key: Key) -> tuple[Term, dict[str, float]]:
        """An effect with its values, and their standard errors."""
        units = {name: p.unit for name, p in effect.parameters.items()}
        return self.part(node, key, units, lambda v, s: (effect(**v), s))


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
