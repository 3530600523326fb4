"""A map in 3D while it is edited: its walls, and in every opening a block that a pointer drags along the wall.

A drag turns the block; the walls follow as soon as the map has no error. Colours of blocks: `bad` for an opening with
an error, `planned` for the chosen one, grey for a closed one.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from mazeplan.apps.view.camera import Layout, around, pointed_place
from mazeplan.apps.view.editor.mapeditor import MapEditor
from mazeplan.apps.view.meshes import Mesh, gap_box, ring_floor, wall_mesh
from mazeplan.apps.view.scene import FLOORS, TABLE, UNIT, WALL, WALLS_SHOWN, add_mesh, wall_meshes
from mazeplan.core.maths.angles import difference
from mazeplan.core.palette import rgb
from mazeplan.core.records import Array
from mazeplan.maze.geometry import Maze, Opening
from mazeplan.maze.mapedit import Written

if TYPE_CHECKING:
    from viser import ViserServer

    from mazeplan.apps.view.page import Page

Phase = Literal["start", "update", "end"]
Dragged = Callable[[int, float, Phase], None]  # index of the opening, degrees where it is dragged to
ABOVE = 1.15  # height of a block in heights of the wall: it can be grabbed above it
OPACITY = 0.75
NEAR = 0.016  # m; so far beside an opening it is still grabbed
FROM = (0.0, -0.25, 1.0)  # the camera: from above, there one drags best


class EditScene:
    """Draws an editor's map. dragged, clicked: called with the index of the opening that a person drags or clicks."""

    def __init__(self, page: Page, dragged: Dragged, clicked: Callable[[int], None]) -> None:
        self._page, self._dragged, self.clicked = page, dragged, clicked
        self._maze: Maze | None = None
        self._walls: dict[str, Mesh] = {}
        self._blocks: list[_Block] = []
        self._openings: tuple[Written, ...] = ()
        self._grips: dict[int, _Grip | None] = {}  # by browser, while it drags

    def show(self, editor: MapEditor, chosen: int | None) -> None:
        """Draw what has changed."""
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
                self._blocks.append(_Block(self._page.server, place, self))
            colour = "bad" if opening.index in editor.wrong else "planned" if opening.index == chosen else "running"
            self._blocks[place].show(editor.maze, opening, colour, chosen == opening.index)

    def _show_walls(self, maze: Maze) -> None:
        """Walls and floors; of a changed maze only what is changed."""
        before, server = self._maze, self._page.server
        if before is None or before.rings != maze.rings or before.rim_thickness != maze.rim_thickness:
            rim = maze.walls[0].outer_radius
            self._page.framing.show(Layout(outline(maze), side=FROM))
            server.scene.add_cylinder("/map/table", UNIT * 1.3 * rim, 0.02, TABLE, radial_segments=96,
                                      position=(0, 0, -0.04))  # fmt: skip
            for ring in before.rings[len(maze.rings) :] if before else ():
                for name in (f"ring{ring.number}", f"grip{ring.number - 1}"):
                    server.scene.remove_by_name(f"/map/{name}")
            for ring in maze.rings:
                form = ring_floor(maze, ring.number)
                add_mesh(server, f"/map/ring{ring.number}", form, FLOORS[ring.number % 2]).on_drag(self._drag)
            for wall in maze.walls:  # transparent, for the pointer: a drag makes the walls themselves anew
                form = wall_mesh(replace(wall, openings=()), 1.02 * WALLS_SHOWN * maze.wall_height)
                grip = add_mesh(server, f"/map/grip{wall.outer_ring}", form, WALL, opacity=0.0, cast_shadow=False)
                grip.on_drag(self._drag)
        walls = wall_meshes(maze)
        for name in set(self._walls) - set(walls):
            server.scene.remove_by_name(f"/map/{name}")
        for name, mesh in walls.items():
            old = self._walls.get(name)
            if old is None or not np.array_equal(old[0], mesh[0]):
                add_mesh(server, f"/map/{name}", mesh, WALL, flat_shading=False)
        self._walls = walls

    async def _drag(self, event: Any) -> None:
        self.drag(event, None)

    def drag(self, event: Any, index: int | None) -> None:
        """A drag of a block, or (index None) one that begins elsewhere in the maze and grabs an opening near there."""
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
        """The opening nearest to a place in the scene; None without one near."""
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
    """The block of an opening. place: its number in the scene."""

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
        box = gap_box(maze, at_zero, 2e-4, ABOVE * WALLS_SHOWN * maze.wall_height)
        self._turned = None
        self._mesh = add_mesh(self._server, self._name, box, (0, 0, 0), opacity=OPACITY)
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
    """The angle, rad, where the ray from the camera through `pointer` meets the plane z = `height`; None where it does
    not, or in the middle."""
    place = pointed_place(camera, pointer, height)
    return None if place is None or math.hypot(*place) < 1e-6 else math.atan2(place[1], place[0])
