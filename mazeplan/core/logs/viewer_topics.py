"""A run repeated in Foxglove's message types, so that Foxglove's 3D panel, its log panel and other viewers draw it.

    /foxglove/scene  foxglove.SceneUpdate: plate, walls and ball once; the newest plan of a chunk
    /foxglove/tf     foxglove.FrameTransform: world -> plate (tilt) and plate -> ball (place), every second tick
    /foxglove/ball   foxglove.PoseInFrame: the ball in the frame `plate`, in the same ticks, if the ball was seen
    /foxglove/log    foxglove.Log: events, and the result

Names and fields are those of Foxglove's published schemas, as JSON; the schemas here hold the fields that are written.
Lengths are in m, times are those of the rig. The other topics hold all of this, too, so `read_log` skips these topics.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from mazeplan.core.records import Array

SCENE, FRAMES, BALL, LOG = (f"/foxglove/{name}" for name in ("scene", "tf", "ball", "log"))
NS = 10**9
EVERY = 2  # one tick in this many is drawn: 15 Hz look smooth, and cost half
PLAN_POINTS = 40  # maximum number of points of a drawn plan
PLATE_THICKNESS = 0.002  # m, as drawn
INFO, WARNING, ERROR = 2, 3, 4  # levels of foxglove.Log
LEVELS = {"failure": WARNING, "doubt": WARNING, "drive_failed": WARNING}  # kinds of events; others are INFO
LINE_STRIP, LINE_LOOP = 0, 1  # types of foxglove.LinePrimitive
WALL, PLAN, FLOOR, STEEL = ((0.2, 0.2, 0.25, 1.0), (0.84, 0.37, 0.0, 1.0), (0.8, 0.8, 0.78, 0.5), (0.1, 0.45, 0.7, 1.0))
SHAPES = ("arrows", "cubes", "spheres", "cylinders", "lines", "triangles", "texts", "models")  # of an entity
Message = tuple[str, int, bytes]  # topic, rig time in ns, content


def _object(**fields: Any) -> dict[str, Any]:
    return {"type": "object", "properties": fields}


def _objects(**fields: Any) -> dict[str, Any]:
    return {"type": "array", "items": _object(**fields)}


def _numbers(names: str) -> dict[str, Any]:
    return _object(**dict.fromkeys(names, _NUMBER))


_NUMBER, _INTEGER, _TEXT, _FLAG = ({"type": name} for name in ("number", "integer", "string", "boolean"))
_TIME = {**_object(sec=_INTEGER, nsec=_INTEGER), "title": "time"}
_LASTING = {**_object(sec=_INTEGER, nsec=_INTEGER), "title": "duration"}
_VECTOR, _TURN, _COLOUR = _numbers("xyz"), _numbers("xyzw"), _numbers("rgba")
_POSE = _object(position=_VECTOR, orientation=_TURN)
_LINES = _objects(
    type=_INTEGER, pose=_POSE, thickness=_NUMBER, scale_invariant=_FLAG, color=_COLOUR,
    points=_objects(x=_NUMBER, y=_NUMBER, z=_NUMBER), colors={"type": "array", "items": _COLOUR},
    indices={"type": "array", "items": _INTEGER},
)  # fmt: skip
_ENTITY: dict[str, Any] = {
    **dict.fromkeys(SHAPES, _objects()),
    **{"timestamp": _TIME, "frame_id": _TEXT, "id": _TEXT, "lifetime": _LASTING, "frame_locked": _FLAG},
    "metadata": _objects(key=_TEXT, value=_TEXT),
    "spheres": _objects(pose=_POSE, size=_VECTOR, color=_COLOUR),
    "cylinders": _objects(pose=_POSE, size=_VECTOR, bottom_scale=_NUMBER, top_scale=_NUMBER, color=_COLOUR),
    "lines": _LINES,
}
VIEWER_SCHEMAS: dict[str, tuple[str, dict[str, Any]]] = {  # by topic: name and JSON schema
    SCENE: (
        "foxglove.SceneUpdate",
        _object(deletions=_objects(timestamp=_TIME, type=_INTEGER, id=_TEXT), entities=_objects(**_ENTITY)),
    ),
    FRAMES: (
        "foxglove.FrameTransform",
        _object(timestamp=_TIME, parent_frame_id=_TEXT, child_frame_id=_TEXT, translation=_VECTOR, rotation=_TURN),
    ),
    BALL: ("foxglove.PoseInFrame", _object(timestamp=_TIME, frame_id=_TEXT, pose=_POSE)),
    LOG: (
        "foxglove.Log",
        _object(timestamp=_TIME, level=_INTEGER, message=_TEXT, name=_TEXT, file=_TEXT, line=_INTEGER),
    ),
}


@dataclass(frozen=True)
class MazeShape:
    """What viewers draw of a maze. walls: closed outlines, (N, 2) each, m; wall_height, ball_radius, rim_radius: m."""

    walls: Sequence[Array]
    wall_height: float
    ball_radius: float
    rim_radius: float


class ViewerTopics:
    """Turns the messages of a run, a chunk at a time, into messages for viewers. shape: None draws no maze."""

    def __init__(self, shape: MazeShape | None) -> None:
        self._ticks = 0
        self._height = 0.0 if shape is None else shape.ball_radius  # of the ball's centre above the plate, m
        self._radius: float | None = None  # of the ball's centre when it was seen last, m

    def of(self, messages: Sequence[tuple[str, int, Mapping[str, Any]]]) -> Iterator[Message]:
        """The messages for viewers that follow from messages of a log (topic, rig time in ns, document). Raises
        KeyError, TypeError, ValueError or AttributeError for documents that no run writes."""
        plan = None
        for topic, ns, document in messages:
            if topic == "/tick":
                yield from self._tick(ns, document)
            elif topic == "/plan":
                plan = ns, document
            elif topic == "/event":
                yield LOG, ns, _event(ns, document)
            elif topic == "/result":
                yield LOG, ns, _result(ns, document)
        if plan is not None and self._radius is not None and plan[1].get("theta"):
            yield SCENE, plan[0], _plan(*plan, self._radius, self._height)

    def _tick(self, ns: int, tick: Mapping[str, Any]) -> Iterator[Message]:
        self._ticks += 1
        if self._ticks % EVERY != 1:
            return
        # text instead of documents, which would take three times as long
        stamp = f'{{"timestamp":{{"sec":{ns // NS},"nsec":{ns % NS}}},'
        beta, gamma, x, y = tick.get("beta"), tick.get("gamma"), tick.get("x"), tick.get("y")
        if beta is not None and gamma is not None and math.isfinite(beta + gamma):
            # the plate's rotation is Ry(beta) Rx(gamma)
            cb, sb, cg, sg = math.cos(0.5 * beta), math.sin(0.5 * beta), math.cos(0.5 * gamma), math.sin(0.5 * gamma)
            text = (
                f'{stamp}"parent_frame_id":"world","child_frame_id":"plate","translation":{{"x":0.0,"y":0.0,"z":0.0}},'
                f'"rotation":{{"x":{cb * sg:.7f},"y":{sb * cg:.7f},"z":{-sb * sg:.7f},"w":{cb * cg:.7f}}}}}'
            )
            yield FRAMES, ns, text.encode()
        if x is not None and y is not None and math.isfinite(x + y):
            self._radius = math.hypot(x, y)
            place = f'{{"x":{x:.6f},"y":{y:.6f},"z":{self._height:.6f}}}'
            text = (
                f'{stamp}"parent_frame_id":"plate","child_frame_id":"ball","translation":{place},'
                '"rotation":{"x":0.0,"y":0.0,"z":0.0,"w":1.0}}'
            )
            yield FRAMES, ns, text.encode()
            text = f'{stamp}"frame_id":"plate","pose":{{"position":{place},"orientation":{_UPRIGHT}}}}}'
            yield BALL, ns, text.encode()


def scene(shape: MazeShape) -> bytes:
    """Plate, walls and ball, for the beginning of a log; the ball then moves with its frame."""
    height, rim, ball = shape.wall_height, 2.0 * shape.rim_radius, 2.0 * shape.ball_radius
    plate = {
        "pose": _pose(z=-0.5 * PLATE_THICKNESS), "size": {"x": rim, "y": rim, "z": PLATE_THICKNESS},
        "bottom_scale": 1.0, "top_scale": 1.0, "color": _colour(FLOOR),
    }  # fmt: skip
    lines = [_line(LINE_LOOP, [(x, y, height) for x, y in wall], WALL) for wall in shape.walls]
    sphere = {"pose": _pose(), "size": {"x": ball, "y": ball, "z": ball}, "color": _colour(STEEL)}
    maze = _entity("maze", "plate", 0, cylinders=[plate], lines=lines)
    return _encoded({"deletions": [], "entities": [maze, _entity("ball", "ball", 0, spheres=[sphere])]})


def _plan(ns: int, plan: Mapping[str, Any], radius: float, height: float) -> bytes:
    angles = plan["theta"][:: max(1, math.ceil(len(plan["theta"]) / PLAN_POINTS))]
    points = [(radius * math.cos(a), radius * math.sin(a), height) for a in angles]
    line = _line(LINE_STRIP, points, PLAN)
    return _encoded({"deletions": [], "entities": [_entity("plan", "plate", ns, lines=[line])]})


def _event(ns: int, document: Mapping[str, Any]) -> bytes:
    kind, detail = str(document["kind"]), document["detail"]
    said = ", ".join(f"{name} {value}" for name, value in detail.items() if value not in ("", None, []))
    level = ERROR if detail.get("kind") == "rig_failed" else LEVELS.get(kind, INFO)
    return _log(ns, level, kind, f"{kind}: {said}" if said else kind)


def _result(ns: int, document: Mapping[str, Any]) -> bytes:
    return _log(ns, INFO if document.get("success") else ERROR, "result", f"ended: {document.get('reason', '')}")


def _log(ns: int, level: int, name: str, message: str) -> bytes:
    return _encoded({"timestamp": _time(ns), "level": level, "message": message, "name": name, "file": "", "line": 0})


_UPRIGHT = '{"x":0.0,"y":0.0,"z":0.0,"w":1.0}'


def _time(ns: int) -> dict[str, int]:
    return {"sec": ns // NS, "nsec": ns % NS}


def _colour(rgba: tuple[float, float, float, float]) -> dict[str, float]:
    return dict(zip("rgba", rgba, strict=True))


def _pose(z: float = 0.0) -> dict[str, Any]:
    return {"position": {"x": 0.0, "y": 0.0, "z": z}, "orientation": json.loads(_UPRIGHT)}


def _line(
    kind: int, points: Sequence[tuple[float, float, float]], rgba: tuple[float, float, float, float]
) -> dict[str, Any]:
    places = [{"x": round(float(x), 4), "y": round(float(y), 4), "z": round(float(z), 4)} for x, y, z in points]
    return {
        "type": kind, "pose": _pose(), "thickness": 2.0, "scale_invariant": True, "points": places,
        "color": _colour(rgba), "colors": [], "indices": [],
    }  # fmt: skip


def _entity(name: str, frame: str, ns: int, **shapes: Any) -> dict[str, Any]:
    """An entity that stays until another one of its name comes."""
    facts = {"timestamp": _time(ns), "frame_id": frame, "id": name, "lifetime": _time(0), "frame_locked": True}
    return {**facts, "metadata": [], **{shape: shapes.get(shape, []) for shape in SHAPES}}


def _encoded(document: dict[str, Any]) -> bytes:
    return json.dumps(document, separators=(",", ":")).encode()
