"""`diagnose` of a ball in one ring."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from mazeplan.core.errors import InputError
from mazeplan.core.logs.table import Table, as_table, name_of
from mazeplan.diagnosis.record import centred, record_of, turned_round
from mazeplan.diagnosis.ring import diagnose as ring_diagnosis
from mazeplan.diagnosis.ring.system import ring_library
from mazeplan.diagnosis.stage.comparison import Known
from mazeplan.diagnosis.update import base_model, updated
from mazeplan.learning.modelfile import RigModel, save_model
from mazeplan.learning.rig_model import part_values, with_part
from mazeplan.learning.samples import rings_of
from mazeplan.maze.geometry import Maze
from mazeplan.physics.effects import rig
from mazeplan.physics.effects.openings import Openings, wall_library
from mazeplan.physics.effects.rig import FAMILY as RIG_EFFECTS
from mazeplan.physics.registry import own_effects
from mazeplan.physics.rig.sensors import Camera
from mazeplan.physics.rig.stage import StageModel
from mazeplan.run.commands.diagnosis_request import DiagnosisRequest, DiagnosisResult, Values, declare_known, finish
from mazeplan.run.commands.log_context import check_channel, check_radius, check_wiring, logged_map

CAMERA_EFFECTS = (rig.camera_offset, rig.camera_scale, rig.lens_distortion)
FEWEST_IN_RINGS = 0.7  # minimum share of the samples in rings of the map; a run's log also has passages


def diagnose_ring(log: Any, request: DiagnosisRequest, why: str = "") -> DiagnosisResult:
    """Diagnose one ring of a log; write the report and the model, if asked for. Raises InputError.

    why: why the other rings are left out; empty if one ring was asked for"""
    maze = logged_map(request.map, log, *([] if request.test is None else [request.test])).maze
    model = request.known
    done, document = _diagnose(log, maze, model, request)
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
    return finish(done, document, request, f"ring {number} of {name_of(log)}" if number else name_of(log))


def _diagnose(
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
