"""What all kinds of `diagnose` share, and `diagnose` of one mechanism: a ball in one ring, or another machine."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from mazeplan.core.errors import InputError, one_of
from mazeplan.core.logs.columns import ColumnSource
from mazeplan.core.logs.table import Table, as_table, name_of
from mazeplan.core.progress import Words, no_words
from mazeplan.core.results import PAGES, DocumentResult, finite
from mazeplan.core.user_modules import user_module
from mazeplan.core.whole_file import write_text
from mazeplan.diagnosis.engine.diagnosis import MotionDiagnosis, diagnose_motion
from mazeplan.diagnosis.engine.emps import Axis, emps_result, read_drive
from mazeplan.diagnosis.engine.record import read_record
from mazeplan.diagnosis.engine.system import System, system_of
from mazeplan.diagnosis.record import centred, record_of, turned_round
from mazeplan.diagnosis.ring import diagnose as ring_diagnosis
from mazeplan.diagnosis.ring.system import ring_library
from mazeplan.diagnosis.stage.comparison import Known
from mazeplan.diagnosis.update import base_model, updated
from mazeplan.learning.modelfile import RigModel, load_model, save_model
from mazeplan.learning.rig_model import part_values, with_part
from mazeplan.learning.samples import rings_of
from mazeplan.maze.geometry import Maze
from mazeplan.physics.effect import Effect
from mazeplan.physics.effects import rig
from mazeplan.physics.effects.openings import Openings, wall_library
from mazeplan.physics.effects.rig import FAMILY as RIG_EFFECTS
from mazeplan.physics.registry import load_effects, own_effects
from mazeplan.physics.rig.sensors import Camera
from mazeplan.physics.rig.stage import StageModel
from mazeplan.run.commands.log_context import check_channel, check_radius, check_wiring, logged_map

CAMERA_EFFECTS = (rig.camera_offset, rig.camera_scale, rig.lens_distortion)
FEWEST_IN_RINGS = 0.7  # minimum share of the samples in rings of the map; a run's log also has passages

Values = dict[str, dict[str, float]]  # {effect: {parameter: value}}


@dataclass(frozen=True)
class DiagnosisRequest:
    """Options of `diagnose`.

    logs, test, references: paths, or tables in memory"""

    logs: list[Any]
    model: str | Path | RigModel | None
    radius: float | None  # of the track, m
    declare: list[str]
    ring: int | None
    test: Any
    map: str | Path | Maze | None
    effects: str | None
    output: Path | None
    references: list[Any]
    columns: Mapping[str, ColumnSource] = field(default_factory=dict)
    progress: Words = no_words  # gets the step under way

    @property
    def known(self) -> RigModel | None:
        """The model, read; None without one. Raises ModelError."""
        return self.model if isinstance(self.model, RigModel | None) else load_model(self.model)


@dataclass(frozen=True)
class DiagnosisResult(DocumentResult):
    """A diagnosis: its document, what its pictures show, and the result in words."""

    kind: ClassVar[str] = "diagnosis"

    evidence: dict[str, Any] = field(repr=False)
    lines: tuple[str, ...]

    @property
    def verdict(self) -> str:
        """nothing_missing, effect_found, ambiguous or unknown_effect."""
        return self.document["verdict"]


def declare_known(known: Values, texts: Iterable[str], candidates: Iterable[Effect], partly: str = "") -> None:
    """Add the parameters of `--declare` to `known`. Raises InputError that names the allowed ones.

    texts: EFFECT.PARAM=VALUE
    candidates: the effects that may be declared
    partly: an effect whose other parameters stay undeclared; those of another declared effect get their defaults"""
    library = {effect.name: effect for effect in candidates}
    for text in texts:
        name, _, value = text.partition("=")
        effect, _, parameter = name.partition(".")
        if effect not in library:
            raise InputError(f"--declare: got effect {effect!r}, expected {one_of(library, effect)}")
        allowed = library[effect].parameters
        if parameter not in allowed:
            expected = f"expected {one_of(allowed, parameter)}"
            raise InputError(f"--declare: got parameter {parameter!r} of {effect}, {expected}")
        spec = allowed[parameter]
        try:
            number = float(value)
        except ValueError:
            number = math.nan
        if not (math.isfinite(number) and spec.low <= number <= spec.high):
            expected = f"expected EFFECT.PARAM=VALUE with a value from {spec.low:g} to {spec.high:g} {spec.unit}"
            raise InputError(f"--declare: got {text!r}, {expected}")
        defaults = {} if effect == partly else {key: p.default for key, p in allowed.items()}
        known.setdefault(effect, defaults)[parameter] = number


def finish(
    document: dict[str, Any], evidence: dict[str, Any], request: DiagnosisRequest, sentence: str, on_test: str,
    advice: Iterable[str] = (),
) -> DiagnosisResult:  # fmt: skip
    """The result. Writes report.json, evidence.json and report.html, if asked for, and sets `report` in the document.

    on_test: errors before and after, on the record of --test; empty without such a record"""
    if request.output is not None:
        page = request.output / "report.html"
        document["report"] = str(page)
        write_text(page.with_name("report.json"), json.dumps(finite(document), indent=1) + "\n")
        write_text(page.with_name("evidence.json"), json.dumps(finite(evidence)) + "\n")
        import_module(PAGES).write_diagnosis(document, evidence, page)
    lines = [sentence, *([f"on the record of --test: {on_test}"] if on_test else []), *advice]
    lines += [f"note: {note}" for note in document["notes"]]
    lines += [f"{key}: {document[key]}" for key in ("report", "model") if document.get(key) is not None]
    return DiagnosisResult(document, evidence, tuple(lines))


def finish_mechanism(
    done: ring_diagnosis.RingDiagnosis | MotionDiagnosis,
    document: dict[str, Any],
    request: DiagnosisRequest,
    title: str,
) -> DiagnosisResult:
    """The result of a diagnosis of one mechanism; see `finish`."""
    on_test = "" if done.test is None else done.test[0].both(done.test[1])  # pyright: ignore[reportArgumentType]
    ring, sentence = document.get("ring"), done.sentence()
    sentence = f"Ring {ring}: {sentence}" if ring else sentence
    return finish(document, done.evidence_document(title, document["notes"]), request, sentence, on_test)


def diagnose_ring(log: Any, request: DiagnosisRequest, why: str = "") -> DiagnosisResult:
    """Diagnose one ring of a log; write the report and the model, if asked for. Raises InputError.

    why: why the other rings are left out; empty if one ring was asked for"""
    maze = logged_map(request.map, log, request.test).maze
    model = request.known
    done, document = _diagnose_ring(log, maze, model, request)
    number, known = document["ring"], document["declared"]
    if why:
        document["notes"].append(f"one ring was diagnosed, not all of them together: {why}")
    before, after = (document[part]["rollout40"] or 0.0 for part in ("before", "after"))
    if request.output is not None and done.effects and after > before:
        document["notes"].append("no model was written: with what was found, held-out parts are predicted worse")
    elif request.output is not None and done.effects:
        stage = None if done.stage is None else StageModel(*done.stage.axes)
        old = base_model(number, known, stage) if model is None else model
        new = updated(old, {number or 1: done.effects})
        document["model"] = str(save_model(new, request.output / "model").parent)
    return finish_mechanism(done, document, request, f"ring {number} of {name_of(log)}" if number else name_of(log))


def _diagnose_ring(
    log: Any, maze: Maze, model: RigModel | None, request: DiagnosisRequest
) -> tuple[ring_diagnosis.RingDiagnosis, dict[str, Any]]:
    added = own_effects(request.effects)
    raw = as_table(log, request.columns)
    check_wiring(raw, maze if request.radius is None else None)
    camera, of_positions = _known_camera(raw, model, request.declare)
    centre = centred(raw, camera)
    if request.radius is None:
        ring = request.ring
        if ring is None:
            found, counts = np.unique(rings_of(centre, maze), return_counts=True)
            found, counts = found[found > 0], counts[found > 0]
            if not len(found):
                raise InputError("the ball is in no ring of the map; expected --radius M, or another --map")
            ring = int(found[np.argmax(counts)])
        check_channel(ring, maze)
        radius, rows, openings = maze.track_radius(ring), rings_of(centre, maze) == ring, ring_openings(maze, ring)
    else:
        ring, radius, rows, openings = request.ring, request.radius, np.ones(len(centre), dtype=bool), None
        check_radius(centre, radius, ring)
    known: Values = {} if model is None else model.declared(ring or 1)
    if "x" not in centre and (camera.offset_x or camera.offset_y):  # angles alone are not corrected by `centred`
        known["camera_offset"] = {"x": camera.offset_x, "y": camera.offset_y}
    library = [*ring_library(), *wall_library(openings or Openings()), *RIG_EFFECTS]
    declare_known(known, request.declare, [*library, *added])
    of_angles = {name: values for name, values in known.items() if name not in of_positions}
    known |= of_positions
    if request.radius is None:
        _check_rings(centre, maze)
    table, odd = turned_round(centre, radius)
    test = None
    if request.test is not None:
        other, _ = turned_round(centred(as_table(request.test, request.columns), camera), radius)
        in_ring = np.ones(len(other), dtype=bool) if openings is None else rings_of(other, maze) == ring
        test = record_of(other, in_ring, ring=ring)
    done = ring_diagnosis.diagnose(
        record_of(table, rows, odd, ring), radius, of_angles, openings=openings, more=added, test=test,
        progress=request.progress, corrected=camera,
        known=None if model is None else _known_stage(model, known, request.declare),
    )  # fmt: skip
    more = {"ring": ring, "radius_m": radius, "declared": known, "model": None, "report": None}
    return done, {**done.document(), **more}


def _known_camera(table: Table, model: RigModel | None, declare: Sequence[str]) -> tuple[Camera, Values]:
    """The camera of the model with its declared values, and the effects that have declared values.

    Without x and y, this is the camera of the model: the declared values then correct angles, not positions."""
    seen, declared = base_model(None, {}, None) if model is None else model, Values()
    if "x" not in table:
        return seen.camera, declared
    known = {effect.name: part_values(seen, effect) for effect in CAMERA_EFFECTS}
    texts = [text for text in declare if text.partition(".")[0] in known]
    declare_known(known, texts, CAMERA_EFFECTS)
    for effect in CAMERA_EFFECTS:
        if any(text.startswith(f"{effect.name}.") for text in texts):
            declared[effect.name] = values = known[effect.name]
            seen = with_part(seen, effect, values, dict.fromkeys(values, 0.0))
    return seen.camera, declared


def _known_stage(model: RigModel, known: Values, declare: Sequence[str]) -> Known:
    """The stage of the model with the declared values, which have no standard errors.

    known: effects of the model and of `declare`"""
    of, names = Known.of_model(model), {effect.name for effect in RIG_EFFECTS}
    given = {text.partition("=")[0] for text in declare}
    declared = {name.partition(".")[0] for name in given} & names
    errors = {
        name: {key: error for key, error in stderr.items() if f"{name}.{key}" not in given}
        for name, stderr in of.stderr.items()
    }
    return Known({**of.values, **{name: known[name] for name in declared}}, errors, of.kind)


def ring_openings(maze: Maze, ring: int) -> Openings:
    """Angles of the openings in the two walls of a ring."""
    openings = maze.openings_of(ring)
    return Openings(
        tuple(o.angle for o in openings if o.inner == ring), tuple(o.angle for o in openings if o.outer == ring)
    )


def _check_rings(table: Table, maze: Maze) -> None:
    if "ring" in table or "r" not in table:
        return
    seen = np.isfinite(table["r"])
    outside = float(np.mean(rings_of(table, maze)[seen] == 0)) if seen.any() else 1.0
    if outside > 1.0 - FEWEST_IN_RINGS:
        problem = f"the ball is in no ring of the map in {outside:.0%} of the samples that show it"
        raise InputError(f"{problem}; expected --radius M, or another --map")


def diagnose_system(system: Any, log: Any, request: DiagnosisRequest) -> DiagnosisResult:
    """Diagnose a record. system: emps, MODULE:CLASS, or a class. Raises InputError, TableError."""
    own = [] if request.effects is None else load_effects(request.effects)
    machine = _machine(system, Path(log).parent if isinstance(log, str | Path) else Path(), own)
    known, fitted = _declared(request.declare, machine)
    done: Any
    if system == "emps":
        record, gain = read_drive(Path(log))
        test = None if request.test is None else read_drive(Path(request.test), gain)[0]
        done = emps_result(machine, record, known, fitted, test, request.progress)
    else:
        columns = {"positions": machine.positions, "inputs": machine.inputs, "columns": request.columns}
        read = partial(read_record, units=machine.units, **columns)
        record, test = read(log), None if request.test is None else read(request.test)
        done = diagnose_motion(machine, record, known, fitted, test=test, progress=request.progress)
    name = system if isinstance(system, str) else f"{system.__module__}:{system.__qualname__}"
    document: dict[str, Any] = {**done.document(), "system": name, "declared": known, "report": None}
    return finish_mechanism(done, document, request, name_of(log))


def _machine(system: Any, folder: Path, own: Sequence[Effect]) -> System:
    """The system of a name. folder: folder of the log, in which the module is searched, too"""
    kind: Any = Axis if system == "emps" else system
    if isinstance(system, str) and system != "emps":
        module, _, name = system.partition(":")
        kind = getattr(user_module(module, "--system", folder), name, None)
        if kind is None:
            raise InputError(f"--system: module {module!r} has no {name!r}, expected the name of a class in it")
    try:
        return system_of(kind, own)
    except InputError as problem:
        raise InputError(f"--system: {system}: {problem}") from None


def _declared(declare: Sequence[str], machine: System) -> tuple[Values, list[str]]:
    fitted = [text for text in declare if "=" not in text and "." not in text]
    known: Values = {}
    names = [effect.name for effect in machine.library]
    valued = [text for text in declare if text not in fitted]
    declare_known(known, valued, machine.library, machine.motion.name)
    for name in fitted:
        if name not in names:
            raise InputError(f"--declare: got effect {name!r}, expected {one_of(names, name)}")
        if name in known:
            raise InputError(f"--declare: got {name} both with and without a value, expected one of the two")
    return known, fitted
