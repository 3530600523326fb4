"""A map in 3D while it is edited: its walls, and a block in every opening by which it is dragged along its wall.

A block that is dragged only turns; the walls follow as soon as the map has no error. Blocks of openings that errors
name are in the colour of what is bad, that of the chosen one in the colour of what is planned, closed ones are dark.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from mazeplan.maths.angles import difference
from mazeplan.maze.geometry import Maze, Opening
from mazeplan.maze.mapedit import Written
from mazeplan.palette import rgb
from mazeplan.records import Array
from mazeplan.view.camera import Layout, around
from mazeplan.view.editor import MapEditor
from mazeplan.view.meshes import gap_box, radial_mesh, ring_floor, wall_mesh
from mazeplan.view.scene import FLOOR, FLOOR_2, TABLE, UNIT, WALL, WALLS_SHOWN

if TYPE_CHECKING:
    from viser import ViserServer

    from mazeplan.view.page import Page

Phase = Literal["start", "update", "end"]
Dragged = Callable[[int, float, Phase], None]  # index of the opening, degrees where it is dragged to
ABOVE = 1.15  # height of a block in heights of the wall: it can be grabbed above it
OPACITY = 0.75
NEAR = 0.016  # m; so far beside an opening it is still grabbed
FROM = (0.0, -0.25, 1.0)  # the camera: from above, there one drags best


class EditScene:
    """Draws what an editor has; tells what is dragged and what is clicked (index of the opening)."""

    def __init__(self, page: Page, dragged: Dragged, clicked: Callable[[int], None]) -> None:
        self._page, self._server, self._dragged, self._clicked = page, page.server, dragged, clicked
        self._maze: Maze | None = None
        self._blocks: list[_Block] = []
        self._openings: tuple[Written, ...] = ()
        self._grips: dict[int, _Grip | None] = {}  # by browser, while it drags

    def show(self, editor: MapEditor, chosen: int | None) -> None:
        """Bring it up to date; what is as it was is not sent again."""
        if editor.maze is None:
            return
        self._openings = editor.openings
        if editor.maze != self._maze:
            self._show_walls(editor.maze)
            self._maze = editor.maze
        for extra in self._blocks[len(editor.openings) :]:
            extra.remove()
        del self._blocks[len(editor.openings) :]
        for place, opening in enumerate(editor.openings):
            if place == len(self._blocks):
                self._blocks.append(_Block(self._server, place, self))
            colour = "bad" if opening.index in editor.wrong else "planned" if opening.index == chosen else "running"
            self._blocks[place].show(editor.maze, opening, colour, chosen == opening.index)

    def _show_walls(self, maze: Maze) -> None:
        scene, before = self._server.scene, self._maze
        if before is None or before.rings != maze.rings or before.rim_thickness != maze.rim_thickness:
            rim = maze.walls[0].outer_radius
            self._page.framing.show(Layout(outline(maze), side=FROM))
            scene.add_cylinder("/map/table", UNIT * 1.3 * rim, 0.02, TABLE, radial_segments=96, position=(0, 0, -0.04))
            for ring in before.rings[len(maze.rings) :] if before else ():
                scene.remove_by_name(f"/map/ring{ring.number}")
                scene.remove_by_name(f"/map/wall{ring.number - 1}")
                scene.remove_by_name(f"/map/grip{ring.number - 1}")
            for ring in maze.rings:
                colour = FLOOR if ring.number % 2 else FLOOR_2
                floor = self._mesh(f"ring{ring.number}", ring_floor(maze, ring.number), colour)
                floor.on_drag(self._drag)
            for wall in maze.walls:  # seen by the pointer alone: walls are made anew while something is dragged
                form = wall_mesh(replace(wall, openings=()), 1.02 * WALLS_SHOWN * maze.wall_height)
                grip = self._mesh(f"grip{wall.outer_ring}", form, WALL, opacity=0.0, cast_shadow=False)
                grip.on_drag(self._drag)
        walls = (
            {} if before is None or before.wall_height != maze.wall_height else {w.outer_ring: w for w in before.walls}
        )
        for wall in maze.walls:
            if walls.get(wall.outer_ring) != wall:
                self._mesh(
                    f"wall{wall.outer_ring}", wall_mesh(wall, WALLS_SHOWN * maze.wall_height), WALL, flat_shading=False
                )
        self._show_radial_walls(maze)

    def _show_radial_walls(self, maze: Maze) -> None:
        before = self._maze
        same = before is not None and before.rings == maze.rings and before.wall_height == maze.wall_height
        if same and before is not None and before.radial_walls == maze.radial_walls:
            return
        for i in range(len(maze.radial_walls), len(before.radial_walls) if before else 0):
            self._server.scene.remove_by_name(f"/map/radial{i}")
        for i, wall in enumerate(maze.radial_walls):
            self._mesh(f"radial{i}", radial_mesh(maze, wall, WALLS_SHOWN * maze.wall_height), WALL, flat_shading=False)

    def _mesh(self, name: str, mesh: tuple[Any, Any], colour: tuple[int, int, int], **more: Any) -> Any:
        vertices, faces = mesh
        return self._server.scene.add_mesh_simple(
            f"/map/{name}",
            UNIT * vertices,
            faces,
            color=colour,
            side="double",
            **more,
        )

    def clicked(self, index: int) -> None:
        """Somebody clicked a block."""
        self._clicked(index)

    async def _drag(self, event: Any) -> None:
        self.drag(event, None)

    def drag(self, event: Any, index: int | None) -> None:
        """Somebody drags a block, or, with index None, from some place in the maze: the opening that is grabbed there,
        if one is near. Whoever drags in the maze does not mean to turn the view."""
        x, y, height = event.start_position
        if event.phase == "start":
            near = self._near(x, y) if index is None else index
            start = next((o.angle_deg for o in self._openings if o.index == near), None)
            grip = None if near is None or start is None else _Grip(near, start, math.atan2(y, x))
            self._grips[event.client.client_id] = grip
        grip = self._grips.get(event.client.client_id)
        angle = pointed_angle(event.client.camera.position, event.end_position, height)
        if grip is not None and angle is not None:
            self._dragged(grip.index, grip.start_deg + math.degrees(difference(angle, grip.grabbed)), event.phase)
        if event.phase == "end":
            self._grips.pop(event.client.client_id, None)

    def _near(self, x: float, y: float) -> int | None:
        """The opening nearest to a place in the scene; None where none is near."""
        maze = self._maze
        if maze is None or not self._openings:
            return None
        at = {o.index: UNIT * _middle(maze, o) * np.exp(1j * math.radians(o.angle_deg)) for o in self._openings}
        nearest = min(at, key=lambda index: abs(at[index] - complex(x, y)))
        return nearest if abs(at[nearest] - complex(x, y)) < UNIT * NEAR else None


@dataclass(frozen=True)
class _Grip:
    """An opening that is dragged: where it was, deg, and at which angle it was grabbed, rad."""

    index: int
    start_deg: float
    grabbed: float


class _Block:
    """What an opening is grabbed by. `place`: its number in the scene."""

    def __init__(self, server: ViserServer, place: int, scene: EditScene) -> None:
        self._server, self._name, self._scene = server, f"/map/block{place}", scene
        self._mesh: Any = None
        self._form: tuple[float, ...] | None = None
        self._index = 0
        self._turned: float | None = None
        self._label: Any = None

    def show(self, maze: Maze, opening: Written, colour: str, chosen: bool) -> None:
        self._index = opening.index
        wall = _sides(maze, opening)
        form = (*wall, opening.width_mm, maze.wall_height)
        if form != self._form:
            self._form = form
            self._build(maze, opening)
        if opening.angle_deg != self._turned:
            self._turned = opening.angle_deg
            self._mesh.wxyz = about_z(math.radians(opening.angle_deg))
        shade = rgb("neutral") if opening.closed and colour == "running" else rgb(colour)
        if tuple(self._mesh.color) != shade:
            self._mesh.color = shade
        text = f"{opening.name}{', closed' if opening.closed else ''}" if chosen or colour == "bad" else ""
        angle, radius = math.radians(opening.angle_deg), UNIT * 0.5 * sum(wall)
        self._label.position = (
            radius * math.cos(angle),
            radius * math.sin(angle),
            UNIT * 2.0 * WALLS_SHOWN * maze.wall_height,
        )
        self._label.visible = bool(text)
        if text and self._label.text != text:
            self._label.text = text

    def _build(self, maze: Maze, opening: Written) -> None:
        """A box across the wall at angle 0, that is turned to where it belongs."""
        width = max(opening.width_mm / 1000.0, 1e-3)
        at_zero = Opening("", opening.outer, opening.inner, 0.0, width)
        vertices, faces = gap_box(maze, at_zero, 2e-4, ABOVE * WALLS_SHOWN * maze.wall_height)
        self._turned = None
        self._mesh = self._server.scene.add_mesh_simple(
            self._name, UNIT * vertices, faces, color=(0, 0, 0), side="double", opacity=OPACITY
        )
        if self._label is None:
            self._label = self._server.scene.add_label(f"{self._name}-name", "", visible=False, anchor="bottom-center")

        @self._mesh.on_click
        async def _(event: Any) -> None:
            self._scene.clicked(self._index)

        @self._mesh.on_drag
        async def _(event: Any) -> None:  # async: they come one after another
            self._scene.drag(event, self._index)

    def remove(self) -> None:
        self._mesh.remove()
        self._label.remove()


def _sides(maze: Maze, opening: Written) -> tuple[float, float]:
    """Radii of the wall that an opening breaks, m."""
    return maze.rings[opening.outer - 1].inner_radius, maze.rings[opening.inner - 1].outer_radius


def _middle(maze: Maze, opening: Written) -> float:
    return 0.5 * sum(_sides(maze, opening))


def outline(maze: Maze) -> Array:
    """Points, (N, 3), between which the maze lies with its blocks."""
    return around(UNIT * maze.walls[0].outer_radius, high=UNIT * ABOVE * WALLS_SHOWN * maze.wall_height)


def about_z(angle: float) -> tuple[float, float, float, float]:
    """Quaternion w, x, y, z of a turn about the vertical, rad."""
    return math.cos(0.5 * angle), 0.0, 0.0, math.sin(0.5 * angle)


def pointed_angle(camera: Any, pointer: Any, height: float) -> float | None:
    """The angle, rad, of the place in the plane z = `height` to which the ray from the camera through `pointer` goes;
    None where it does not meet it, or in the middle."""
    eye, ray = np.asarray(camera, dtype=float), np.asarray(pointer, dtype=float) - np.asarray(camera, dtype=float)
    if abs(ray[2]) < 1e-9 or (height - eye[2]) / ray[2] <= 0.0:
        return None
    x, y, _ = eye + (height - eye[2]) / ray[2] * ray
    return None if math.hypot(x, y) < 1e-6 else math.atan2(y, x)
