"""A map in 3D while it is edited: its walls, and a mark for each opening and radial wall, which a pointer drags.

opening       a coloured floor between the ends of the wall; a closed opening has a grey block in it
radial wall   a grey block over it
ring          a click on the floor chooses the ring
colours       `bad`: a part with an error; `planned`: the chosen part

A drag turns the mark; the walls follow as soon as the map has no error.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from mazeplan.apps.view.camera import Layout, around, pointed_place
from mazeplan.apps.view.editor.mapeditor import MapEditor
from mazeplan.apps.view.meshes import Mesh, gap_box, radial_mesh, ring_floor, wall_mesh
from mazeplan.apps.view.scene import FLOORS, TABLE, UNIT, WALL, WALLS_SHOWN, add_mesh, segments, wall_meshes
from mazeplan.core.maths.angles import difference
from mazeplan.core.palette import rgb
from mazeplan.core.records import Array
from mazeplan.maze.geometry import Maze, Opening, RadialWall
from mazeplan.maze.mapedit import Section, Written

if TYPE_CHECKING:
    from viser import ViserServer

    from mazeplan.apps.view.page import Page

Phase = Literal["start", "update", "end"]
Key = tuple[Section, int]  # section and index of a piece
Dragged = Callable[[Key, float, Phase], None]  # the dragged piece, the angle to which it is dragged in deg, the phase
ABOVE = 1.15  # height of a block over height of the wall; the part above the wall can be grabbed
FLAT = 0.001  # m, height of the mark in an opening, so low that the opening looks open
CHOSEN = 0.25  # share of the colour `planned` in the floor of the chosen ring
PATH_AT = 0.003  # m, height of the path above the floor
NEAR = 0.016  # m; a pointer nearer than this grabs an opening or a radial wall
FROM = (0.0, -0.25, 1.0)  # direction of the camera: from above, where dragging is easiest


class EditScene:
    """Draws an editor's map. dragged, clicked: called with the part that a person drags or clicks"""

    def __init__(self, page: Page, dragged: Dragged, clicked: Callable[[Key], None]) -> None:
        self._page, self._dragged, self.clicked = page, dragged, clicked
        self._maze: Maze | None = None
        self._walls: dict[str, Mesh] = {}
        self._floors: dict[int, Any] = {}
        self._blocks: list[_Block] = []
        self._pieces: tuple[Written, ...] = ()
        self._path: Any = None
        self._grips: dict[int, _Grip | None] = {}  # by browser, while it drags

    def show(self, editor: MapEditor, chosen: Key | None) -> None:
        """Draw what has changed."""
        if editor.maze is None:
            return
        last = len(editor.maze.rings)  # further rings of a text with errors are not drawn yet
        pieces = tuple(p for p in editor.pieces if p.section != "rings" and p.inner <= last)
        self._pieces = pieces
        if editor.maze != self._maze:
            self._show_walls(editor.maze)
            self._maze = editor.maze
        for number, floor in self._floors.items():
            shade = _floor(number, chosen == ("rings", number - 1))
            if tuple(floor.color) != shade:
                floor.color = shade
        for extra in self._blocks[len(pieces) :]:
            extra.remove()
        del self._blocks[len(pieces) :]
        for place, piece in enumerate(pieces):
            if place == len(self._blocks):
                self._blocks.append(_Block(self._page.server, place, self))
            key = (piece.section, piece.index)
            colour = "bad" if key in editor.wrong else "planned" if key == chosen else "running"
            self._blocks[place].show(editor.maze, piece, colour, chosen == key)

    def show_path(self, path: Array) -> None:
        """Draw a path of the ball in the maze, (N, 2), m. Fewer than two places draw nothing."""
        if self._path is not None:
            self._path.remove()
        self._path = None
        if len(path) > 1:
            line = segments(path, UNIT * PATH_AT)
            self._path = self._page.server.scene.add_line_segments("/map/path", line, rgb("real"), thickness=0.02)

    def _show_walls(self, maze: Maze) -> None:
        """Draw walls and floors; for a changed maze only the changed parts."""
        before, server = self._maze, self._page.server
        if before is None or before.rings != maze.rings or before.rim_thickness != maze.rim_thickness:
            rim = maze.walls[0].outer_radius
            self._page.framing.show(Layout(outline(maze), side=FROM))
            server.scene.add_cylinder("/map/table", UNIT * 1.3 * rim, 0.02, TABLE, radial_segments=96,
                                      position=(0, 0, -0.04))  # fmt: skip
            for ring in before.rings[len(maze.rings) :] if before else ():
                for name in (f"ring{ring.number}", f"grip{ring.number - 1}"):
                    server.scene.remove_by_name(f"/map/{name}")
            self._floors = {ring.number: self._add_floor(maze, ring.number) for ring in maze.rings}
            for wall in maze.walls:  # transparent walls for the pointer, because a drag replaces the visible walls
                form = wall_mesh(replace(wall, openings=()), 1.02 * WALLS_SHOWN * maze.wall_height)
                grip = add_mesh(server, f"/map/grip{wall.outer_ring}", form, WALL, opacity=0.0, cast_shadow=False)
                grip.on_drag(self._drag)
                grip.on_click(self._click)
        walls = wall_meshes(maze)
        for name in set(self._walls) - set(walls):
            server.scene.remove_by_name(f"/map/{name}")
        for name, mesh in walls.items():
            old = self._walls.get(name)
            if old is None or not np.array_equal(old[0], mesh[0]):
                add_mesh(server, f"/map/{name}", mesh, WALL, flat_shading=False)
        self._walls = walls

    def _add_floor(self, maze: Maze, number: int) -> Any:
        floor = add_mesh(self._page.server, f"/map/ring{number}", ring_floor(maze, number), _floor(number, False))
        floor.on_drag(self._drag)

        @floor.on_click
        async def _(event: Any) -> None:
            self.clicked(("rings", number - 1))

        return floor

    async def _click(self, event: Any) -> None:
        """Choose the opening or radial wall on the floor behind the transparent wall that was clicked."""
        eye = np.asarray(event.ray_origin)
        place = pointed_place(eye, eye + np.asarray(event.ray_direction), 0.0)
        near = None if place is None else self._near(*place)
        if near is not None:
            self.clicked(near)

    async def _drag(self, event: Any) -> None:
        self.drag(event, None)

    def drag(self, event: Any, key: Key | None) -> None:
        """Handle a drag. key: the dragged block; None: the drag grabs the part nearest to where it begins"""
        x, y, height = event.start_position
        if event.phase == "start":
            near = self._near(x, y) if key is None else key
            start = next((p.angle_deg for p in self._pieces if (p.section, p.index) == near), None)
            grip = None if near is None or start is None else _Grip(near, start, math.atan2(y, x))
            self._grips[event.client.client_id] = grip
        grip = self._grips.get(event.client.client_id)
        angle = pointed_angle(event.client.camera.position, event.end_position, height)
        if grip is not None and angle is not None:
            self._dragged(grip.key, grip.start_deg + math.degrees(difference(angle, grip.grabbed)), event.phase)
        if event.phase == "end":
            self._grips.pop(event.client.client_id, None)

    def _near(self, x: float, y: float) -> Key | None:
        """The opening or radial wall nearest to a place in the scene; None if none is within NEAR."""
        maze = self._maze
        if maze is None or not self._pieces:
            return None
        at: dict[Key, complex] = {
            (p.section, p.index): UNIT * 0.5 * sum(_sides(maze, p)) * np.exp(1j * math.radians(p.angle_deg))
            for p in self._pieces
        }
        nearest = min(at, key=lambda key: abs(at[key] - complex(x, y)))
        return nearest if abs(at[nearest] - complex(x, y)) < UNIT * NEAR else None


@dataclass(frozen=True)
class _Grip:
    """A part that a person drags.

    start_deg: angle of the part before the drag, deg
    grabbed: angle at which the pointer grabbed it, rad"""

    key: Key
    start_deg: float
    grabbed: float


class _Block:
    """The mark of an opening or a radial wall. place: number of the mark in the scene"""

    def __init__(self, server: ViserServer, place: int, scene: EditScene) -> None:
        self._server, self._name, self._scene = server, f"/map/block{place}", scene
        self._mesh: Any = None
        self._form: tuple[Any, ...] | None = None
        self._key: Key = ("openings", 0)
        self._turned: float | None = None
        self._label: Any = None

    def show(self, maze: Maze, opening: Written, colour: str, chosen: bool) -> None:
        self._key = (opening.section, opening.index)
        wall, across = _sides(maze, opening), opening.section == "radial_walls"
        form = (*wall, opening.width_mm, maze.wall_height, opening.closed, across)
        if form != self._form:
            self._form = form
            self._build(maze, opening)
        if opening.angle_deg != self._turned:
            self._turned = opening.angle_deg
            self._mesh.wxyz = about_z(math.radians(opening.angle_deg))
        shade = rgb("neutral") if (opening.closed or across) and colour == "running" else rgb(colour)
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
        """Make the block at angle 0; `show` turns it to its place."""
        width, high = max(opening.width_mm / 1000.0, 1e-3), ABOVE * WALLS_SHOWN * maze.wall_height
        if opening.section == "radial_walls":
            thickest = 1.9 * maze.rings[opening.outer - 1].inner_radius  # a thicker wall is an error
            box = radial_mesh(maze, RadialWall("", opening.outer, 0.0, min(width, thickest)), high)
        else:
            at_zero = Opening("", opening.outer, opening.inner, 0.0, width)
            box = gap_box(maze, at_zero, 2e-4, high if opening.closed else FLAT)
        self._turned = None
        self._mesh = add_mesh(self._server, self._name, box, (0, 0, 0))
        if self._label is None:
            self._label = self._server.scene.add_label(f"{self._name}-name", "", visible=False, anchor="bottom-center")

        @self._mesh.on_click
        async def _(event: Any) -> None:
            self._scene.clicked(self._key)

        @self._mesh.on_drag
        async def _(event: Any) -> None:  # async: the events come one after another
            self._scene.drag(event, self._key)

    def remove(self) -> None:
        self._mesh.remove()
        self._label.remove()


def _sides(maze: Maze, piece: Written) -> tuple[float, float]:
    """Radii, m, between which an opening breaks its wall, or a radial wall stands."""
    return maze.rings[piece.outer - 1].inner_radius, maze.rings[piece.inner - 1].outer_radius


def _floor(number: int, chosen: bool) -> tuple[int, int, int]:
    """The colour of a ring's floor."""
    plain, share = FLOORS[number % 2], CHOSEN if chosen else 0.0
    red, green, blue = (round((1 - share) * a + share * b) for a, b in zip(plain, rgb("planned"), strict=True))
    return red, green, blue


def outline(maze: Maze) -> Array:
    """Points, (N, 3), that enclose the maze with its blocks."""
    return around(UNIT * maze.walls[0].outer_radius, high=UNIT * ABOVE * WALLS_SHOWN * maze.wall_height)


def about_z(angle: float) -> tuple[float, float, float, float]:
    """Quaternion w, x, y, z of a turn about the vertical, rad."""
    return math.cos(0.5 * angle), 0.0, 0.0, math.sin(0.5 * angle)


def pointed_angle(camera: Any, pointer: Any, height: float) -> float | None:
    """The angle, rad, where the ray from the camera through `pointer` meets the plane z = `height`.

    None if the ray does not meet the plane, or meets it in the middle of the maze."""
    place = pointed_place(camera, pointer, height)
    return None if place is None or math.hypot(*place) < 1e-6 else math.atan2(place[1], place[0])
