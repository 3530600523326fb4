"""Where the camera stands: as near as possible, with everything inside the picture between the panels.

    distance D:  |x| <= s tan(h/2) (D + z)  for every point

    x    how far the point is to the right of the middle of the picture; the same holds for y, upwards
    z    how far the point is behind the middle of the picture
    h    angle of view across
    s    share of the picture that may be used

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

SHARE = 0.96  # of the picture that may be used
FOV = 0.75  # rad, angle of view up and down
KEPT = 8  # last poses set by the page, which a browser may report later
ROUNDS = 4  # iterations that find the middle
SAME = 0.01  # tolerance of equal poses, in units of the scene: less than a person moves a camera

Place = tuple[float, float, float]
ABOVE: Place = (0.0, -0.6, 1.0)  # from the operator's side


@dataclass(frozen=True)
class Layout:
    """An arrangement of the things in the scene.

    points: (N, 3), they enclose everything
    frames: places of frames of the scene, by name
    side: direction from the middle to the camera"""

    points: Array
    frames: dict[str, Place] = field(default_factory=dict)
    side: Place = ABOVE


@dataclass(frozen=True)
class CameraPose:
    """A camera, and its distance from the farthest point of the layout along the view."""

    position: Place
    look_at: Place
    farthest: float

    @property
    def pose(self) -> Array:
        """Both places in one array, (6,)."""
        return np.array([*self.position, *self.look_at])


def fitted(layout: Layout, aspect: float) -> CameraPose:
    """The nearest camera that sees all of a layout. aspect: width over height of the picture"""
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
    """Points on the rim of a plate at two heights, (72, 3), in units of the scene. at: x, y of the plate's middle"""
    angles = np.linspace(0.0, 2.0 * np.pi, 36, endpoint=False)
    rim = np.column_stack([at[0] + radius * np.cos(angles), at[1] + radius * np.sin(angles)])
    return np.vstack([np.column_stack([rim, np.full(len(rim), z)]) for z in (low, high)])


def pointed_place(camera: Any, pointer: Any, height: float) -> tuple[float, float] | None:
    """x, y where the ray from the camera through `pointer` meets the plane z = `height`; None if it does not."""
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
        """Set the layouts. Each window gets the layout that appears largest in it; the page begins with the first."""
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
    """A browser.

    size: of its picture, pixels
    layout: number of its layout
    poses: the last poses that the page gave to its camera"""

    size: tuple[int, int] = (0, 0)
    layout: int = 0
    poses: list[Array] = field(default_factory=list)

    def ours(self, pose: Array) -> bool:
        return any(same(pose, known) for known in self.poses)


def same(a: Array, b: Array) -> bool:
    """Whether two poses are equal within SAME."""
    return bool(np.allclose(a, b, rtol=0.0, atol=SAME))
