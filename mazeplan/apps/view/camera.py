"""Where the camera stands: as near as possible, with everything inside the picture between the panels.

    distance D:  |x| <= s tan(h/2) (D + z)  for every point, with x, z of it right of and behind the middle of the
                 picture, h the angle of view across and s the share of the picture that may be used; same for y

The middle is moved until there is as much room below as above. Each browser has its own window and its own camera.
The camera follows the size of the window until a person turns or moves the view; `Reset View` lets it follow again.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from mazeplan.core.records import Array

if TYPE_CHECKING:
    from viser import CameraHandle, ClientHandle, ViserServer

SHARE = 0.96  # of the picture
FOV = 0.75  # rad, up and down
KEPT = 8  # poses that a browser may still be telling us of
ROUNDS = 4  # in which the middle is found
SAME = 0.01  # of a pose, in the scene: less than a person moves a camera

Place = tuple[float, float, float]
ABOVE: Place = (0.0, -0.6, 1.0)  # from the operator's side


@dataclass(frozen=True)
class Layout:
    """A way in which things may stand. points: (N, 3), between which all of it lies; frames: where those frames of the
    scene are; side: the camera is in this direction from the middle."""

    points: Array
    frames: dict[str, Place] = field(default_factory=dict)
    side: Place = ABOVE


@dataclass(frozen=True)
class CameraPose:
    """A camera, and how far it is from the farthest point that it is to show."""

    position: Place
    look_at: Place
    farthest: float

    @property
    def pose(self) -> Array:
        """Both places in one, (6,)."""
        return np.array([*self.position, *self.look_at])


def fitted(layout: Layout, aspect: float) -> CameraPose:
    """From where all of a layout is seen; aspect: width of the picture in heights."""
    points, back = np.asarray(layout.points, dtype=float), np.asarray(layout.side, dtype=float)
    back /= np.linalg.norm(back)
    right = np.cross([0.0, 0.0, 1.0], back)
    right /= np.linalg.norm(right)
    up = np.cross(back, right)
    high = SHARE * math.tan(0.5 * FOV)
    middle, distance = points.mean(axis=0), 0.0
    for _ in range(ROUNDS):
        x, y, near = ((points - middle) @ axis for axis in (right, up, back))
        distance = float(np.max(np.maximum(abs(x) / (aspect * high), abs(y) / high) + near))
        depth = distance - near
        for axis, seen in ((right, x / depth), (up, y / depth)):
            middle = middle + 0.5 * (seen.max() + seen.min()) * distance * axis
    x, y, near = ((points - middle) @ axis for axis in (right, up, back))
    distance = float(np.max(np.maximum(abs(x) / (aspect * high), abs(y) / high) + near))
    return CameraPose(_place(middle + distance * back), _place(middle), distance - float(near.min()))


def _place(point: Array) -> Place:
    x, y, z = point
    return float(x), float(y), float(z)


def around(radius: float, at: tuple[float, float] = (0.0, 0.0), low: float = 0.0, high: float = 0.0) -> Array:
    """Points on the rim of a plate that lies at a place, from a height to another, in the units of the scene."""
    angles = np.linspace(0.0, 2.0 * np.pi, 36, endpoint=False)
    rim = np.column_stack([at[0] + radius * np.cos(angles), at[1] + radius * np.sin(angles)])
    return np.vstack([np.column_stack([rim, np.full(len(rim), z)]) for z in (low, high)])


def pointed_place(camera: Any, pointer: Any, height: float) -> tuple[float, float] | None:
    """x, y where the ray from the camera through `pointer` meets the plane z = `height`; None where it does not."""
    eye, ray = np.asarray(camera, dtype=float), np.asarray(pointer, dtype=float) - np.asarray(camera, dtype=float)
    if abs(ray[2]) < 1e-9 or (height - eye[2]) / ray[2] <= 0.0:
        return None
    x, y, _ = eye + (height - eye[2]) / ray[2] * ray
    return float(x), float(y)


class Framing:
    """Keeps the layout inside the picture of every browser."""

    def __init__(self, server: ViserServer) -> None:
        self._server = server
        self._layouts: Sequence[Layout] = ()
        self._browsers: dict[int, _Browser] = {}
        server.on_client_connect(self._joined)
        server.on_client_disconnect(self._left)

    def show(self, *layouts: Layout) -> None:
        """What is to be seen: a window gets the layout that is largest in it. The first is that of the page."""
        self._layouts, camera, view = layouts, self._server.initial_camera, fitted(layouts[0], 1.0)
        camera.position, camera.look_at, camera.fov = view.position, view.look_at, FOV
        for client in self._server.get_clients().values():
            self._fit(client.camera, anew=True)

    async def _joined(self, client: ClientHandle) -> None:
        self._browsers[client.client_id] = _Browser()
        client.camera.on_update(self._looked)
        self._fit(client.camera, anew=True)

    async def _left(self, client: ClientHandle) -> None:
        self._browsers.pop(client.client_id, None)

    async def _looked(self, camera: CameraHandle) -> None:  # async: one after another
        self._fit(camera)

    def _fit(self, camera: CameraHandle, *, anew: bool = False) -> None:
        """Set the camera for a new window size, or after `Reset View`, unless a person has moved it."""
        browser, size = self._browsers.get(camera.client.client_id), (camera.image_width, camera.image_height)
        if browser is None or not self._layouts or min(size) < 1:
            return
        first, pose = self._server.initial_camera, np.concatenate([camera.position, camera.look_at])
        given_back = same(pose, np.concatenate([first.position, first.look_at]))
        if not (given_back or (anew and not browser.poses) or (browser.ours(pose) and (anew or size != browser.size))):
            return
        views = [fitted(layout, size[0] / size[1]) for layout in self._layouts]
        best = min(range(len(views)), key=lambda i: views[i].farthest)
        browser.size, browser.poses = size, [*browser.poses[1 - KEPT :], views[best].pose]
        with camera.client.atomic():
            if best != browser.layout:
                browser.layout = best
                for name, place in self._layouts[best].frames.items():
                    camera.client.scene.add_frame(name, show_axes=False, position=place)  # instead of the page's
            camera.position = views[best].position
            camera.look_at = views[best].look_at


@dataclass
class _Browser:
    """A browser: the size of its picture, its layout, the last poses that the page gave its camera."""

    size: tuple[int, int] = (0, 0)
    layout: int = 0
    poses: list[Array] = field(default_factory=list)

    def ours(self, pose: Array) -> bool:
        return any(same(pose, known) for known in self.poses)


def same(a: Array, b: Array) -> bool:
    """Whether two poses are one."""
    return bool(np.allclose(a, b, rtol=0.0, atol=SAME))
