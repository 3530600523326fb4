"""The maze in 3D as it tilts: ball and trail, the plan ahead, and the openings.

opening   its floor is orange if the ball heads for it, else grey. Red plug: closed
goal      the floor of the goal ring is green
tilt      drawn larger than it is, TILT_SHOWN times
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import TYPE_CHECKING, Any

import numpy as np

from mazeplan.apps.view.story import Moment, arc
from mazeplan.core.palette import rgb
from mazeplan.core.records import Array, IntArray
from mazeplan.maze.drawing import radial_outline, wall_outlines
from mazeplan.maze.geometry import Maze, Opening, Wall

if TYPE_CHECKING:
    from viser import ViserServer

STEP = math.radians(3.0)  # angle between points of an arc
UNIT = 10.0  # lengths in the scene are dm, because viser's cameras and lights suit things of a size near 1
FOV = 0.75  # rad, angle of view up and down
ABOVE = (0.0, -0.6, 1.0)  # direction from the maze to the camera: from the operator's side
DISTANCE = 1.25  # of the camera, over the distance from which the rim just fills the picture
TRAIL_POINTS = 90
PLAN_POINTS = 64
TILT_SHOWN = 3.0  # drawn tilt over true tilt
WALLS_SHOWN = 0.5  # drawn height of the walls over true height, so that the ball is visible behind them
MARK = 4e-4  # m, height of the mark on the floor of an opening
WALL = (178, 184, 192)
FLOORS = (238, 240, 242), (250, 250, 248)  # of even and odd rings
GOAL_FLOOR = (172, 222, 190)
LABELS_AT = -60.0  # deg, where rings have their numbers
Colour = tuple[int, int, int]
Mesh = tuple[Array, IntArray]  # corners (N, 3), and the numbers of the corners of each triangle


def joined(meshes: Iterable[Mesh]) -> Mesh:
    """One mesh made of several meshes."""
    vertices, faces, count = [], [], 0
    for points, triangles in meshes:
        vertices.append(points)
        faces.append(triangles + count)
        count += len(points)
    return np.vstack(vertices), np.vstack(faces)


def strip(left: Array, right: Array) -> Mesh:
    """A band between two lines, (N, 3) each."""
    n = len(left)
    i = np.arange(n - 1)
    triangles = np.column_stack([i, i + n, i + 1]), np.column_stack([i + 1, i + n, i + n + 1])
    return np.vstack([left, right]), np.vstack(triangles)


def block(inner: Array, outer: Array, height: float) -> Mesh:
    """A solid of a height over two lines of as many points, (N, 2); without a bottom."""
    heads, feet = ([np.column_stack([line, np.full(len(line), z)]) for line in (inner, outer)] for z in (height, 0.0))
    sides = [strip(*heads), strip(heads[1], feet[1]), strip(feet[0], heads[0])]
    ends = [strip(np.stack([heads[0][k], heads[1][k]]), np.stack([feet[0][k], feet[1][k]])) for k in (0, -1)]
    return joined([*sides, *ends])


def wall_mesh(wall: Wall, height: float) -> Mesh:
    """The solid pieces of a wall between its openings."""
    if not wall.openings:
        around = np.linspace(0.0, math.tau, 181)
        return block(arc(wall.inner_radius, around), arc(wall.outer_radius, around), height)
    return joined(piece(outline, height) for outline in wall_outlines(wall, STEP))


def piece(outline: Array, height: float) -> Mesh:
    """A piece of a wall, whose outline (N, 2) goes along an inner circle, and back along an outer one."""
    radii = np.hypot(*outline.T)
    inside = radii < 0.5 * (radii.min() + radii.max())
    sides = outline[inside], outline[~inside][::-1]
    count = max(map(len, sides))  # the shorter side has its last corner several times
    inner, outer = (np.pad(side, ((0, count - len(side)), (0, 0)), mode="edge") for side in sides)
    return block(inner, outer, height)


def ring_floor(maze: Maze, ring: int) -> Mesh:
    """The floor of a ring. It reaches to the middle of the walls on both sides."""
    middles = [0.5 * (wall.inner_radius + wall.outer_radius) for wall in maze.walls]
    around = np.linspace(0.0, math.tau, 121)
    inner = middles[ring] if ring < len(maze.rings) else 0.0
    return block(arc(inner, around), arc(middles[ring - 1], around), 0.0)


def gap_mesh(maze: Maze, opening: Opening, height: float) -> Mesh:
    """A block in an opening, such as a mark on its floor or a plug."""
    along = np.array([math.cos(opening.angle), math.sin(opening.angle)])
    across = 0.5 * opening.width * np.array([-along[1], along[0]])
    inner, outer = (
        np.array([radius * along - across, radius * along + across])
        for radius in (maze.ring(opening.inner).outer_radius, maze.ring(opening.outer).inner_radius)
    )
    return block(inner, outer, height)


class Scene:
    """The scene of a maze on a page."""

    def __init__(self, server: ViserServer, maze: Maze) -> None:
        self._server, self._maze = server, maze
        self._plate = server.scene.add_frame("/plate", show_axes=False)
        self._build_plate()
        self._build_ball()
        self._shown: tuple[Any, ...] = ()
        self._coloured: tuple[Any, ...] = ()

    def _mesh(self, name: str, mesh: Mesh, colour: Colour, **more: Any) -> Any:
        """Add a mesh, in m, to the plate."""
        vertices, faces = mesh
        more = {"side": "double", **more}
        return self._server.scene.add_mesh_simple(f"/plate/{name}", UNIT * vertices, faces, color=colour, **more)

    def _build_plate(self) -> None:
        maze, scene, height = self._maze, self._server.scene, WALLS_SHOWN * self._maze.wall_height
        for wall in maze.walls:
            self._mesh(f"wall{wall.outer_ring}", wall_mesh(wall, height), WALL, flat_shading=False)
        for i, across in enumerate(maze.radial_walls):
            self._mesh(f"radial{i}", piece(radial_outline(maze, across), height), WALL, flat_shading=False)
        self._floors: dict[int, Any] = {}
        along = np.array([math.cos(math.radians(LABELS_AT)), math.sin(math.radians(LABELS_AT)), 0.0])
        for ring in maze.rings:
            name = f"ring{ring.number}"
            self._floors[ring.number] = self._mesh(name, ring_floor(maze, ring.number), FLOORS[ring.number % 2])
            out = 0.5 * (ring.inner_radius + ring.outer_radius) if ring.inner_radius else 0.0
            place = UNIT * (out * along + np.array([0.0, 0.0, 0.001]))
            scene.add_label(f"/plate/{name}/number", str(ring.number), font_screen_scale=0.7, position=tuple(place))
        self._openings: dict[str, tuple[Any, Any]] = {}  # a mark on the floor, and a plug while it is closed
        for opening in maze.openings:
            name, plug = f"opening/{opening.name}", gap_mesh(maze, opening, height)
            self._openings[opening.name] = (
                self._mesh(f"{name}/floor", gap_mesh(maze, opening, MARK), rgb("skipped")),
                self._mesh(f"{name}/plug", plug, rgb("bad"), visible=False),
            )

    def _build_ball(self) -> None:
        scene, radius = self._server.scene, UNIT * self._maze.ball.radius
        self._ball = scene.add_icosphere("/plate/ball", radius, rgb("real"), subdivisions=3, visible=False)
        self._second = scene.add_icosphere("/plate/ball2", radius, rgb("second"), subdivisions=3, visible=False)
        nothing = np.zeros((TRAIL_POINTS - 1, 2, 3), dtype=np.float32)
        fade = np.linspace(0.0, 1.0, TRAIL_POINTS)[:, None]
        colours = (1.0 - fade) * np.array([215, 222, 230]) + fade * np.array(rgb("real"))
        pairs = np.stack([colours[:-1], colours[1:]], axis=1).astype(np.uint8)
        self._trail = scene.add_line_segments("/plate/trail", nothing, pairs, thickness=0.02)
        line = np.zeros((PLAN_POINTS - 1, 2, 3), dtype=np.float32)
        self._plan = scene.add_line_segments("/plate/plan", line, rgb("planned"), thickness=0.022, visible=False)

    def show(self, moment: Moment) -> None:
        """Draw a moment of a run in this maze; only changes are sent."""
        shown = (moment.run, moment.tick, moment.closed, moment.goal, moment.result is None)
        if shown == self._shown:
            return
        self._shown = shown
        self._plate.wxyz = attitude(*(TILT_SHOWN * angle for angle in moment.tilt))
        for drawn, ball, colour in ((self._ball, moment.ball, "real"), (self._second, moment.second, "second")):
            drawn.visible = ball is not None
            if ball is not None:
                drawn.position = (UNIT * ball.x, UNIT * ball.y, UNIT * self._maze.ball.radius)
                drawn.color = rgb(colour) if ball.seen else rgb("neutral")
        trail = moment.trail
        self._trail.visible, self._plan.visible = len(trail) > 1, moment.plan is not None
        if len(trail) > 1:
            self._trail.points = segments(resampled(trail, TRAIL_POINTS), UNIT * 0.001)
        if moment.plan is not None:
            self._plan.points = segments(resampled(moment.plan, PLAN_POINTS), UNIT * 0.0015)
        coloured = (moment.goal, moment.opening, moment.closed)
        if coloured != self._coloured:
            self._coloured = coloured
            for number, floor in self._floors.items():
                floor.color = GOAL_FLOOR if number == moment.goal else FLOORS[number % 2]
            for name, (mark, plug) in self._openings.items():
                mark.color = rgb("planned" if name == moment.opening else "skipped")
                plug.visible = name in moment.closed


def look_from_above(server: ViserServer, maze: Maze) -> None:
    """Place the camera of each new browser so that the whole maze is in its picture (not upright)."""
    rim = DISTANCE * UNIT * maze.walls[0].outer_radius / math.tan(0.5 * FOV)
    back = rim * np.array(ABOVE) / np.linalg.norm(ABOVE)
    first = server.initial_camera
    first.position, first.look_at, first.fov = back, (0.0, 0.0, 0.0), FOV


def attitude(beta: float, gamma: float) -> tuple[float, float, float, float]:
    """Quaternion w, x, y, z of the plate, Ry(beta) Rx(gamma)."""
    cb, sb, cg, sg = math.cos(0.5 * beta), math.sin(0.5 * beta), math.cos(0.5 * gamma), math.sin(0.5 * gamma)
    return cb * cg, cb * sg, sb * cg, -sb * sg


def resampled(points: Array, count: int) -> Array:
    """`count` rows, interpolated at even steps from the first to the last of (N, k) rows."""
    at = np.linspace(0.0, len(points) - 1.0, count)
    return np.column_stack([np.interp(at, np.arange(len(points)), column) for column in points.T])


def segments(places: Array, z: float) -> Any:
    """(N, 2) places in m as (N - 1, 2, 3) pieces of a line in the scene; a piece without both ends has no length."""
    points = np.column_stack([UNIT * places, np.full(len(places), z)])
    pairs = np.stack([points[:-1], points[1:]], axis=1)
    pairs[~np.isfinite(pairs).all(axis=(1, 2))] = (0.0, 0.0, -1.0)
    return pairs.astype(np.float32)
