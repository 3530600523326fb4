"""The maze in 3D as it tilts: ball and trail, the plan ahead with its errors, and the openings.

opening   grey: untried. Otherwise the chance of getting through, which is the mean of its Beta posterior, gives a
          colour from `bad` over `unsure` to `good`; a label shows this mean and its 90 % bounds.
          Red plug: closed. Bright frame: the next opening
goal      the floor of the goal ring is green; before a run a line shows the route from the start of the ball
plan      a line on the track of the ring, in a band of 2 rms errors of earlier plans to either side
tilt      drawn larger than it is; a slider sets the factor
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from mazeplan.apps.view.camera import around, pointed_place
from mazeplan.apps.view.meshes import Mesh, gap_box, posts, radial_mesh, ribbon, ring_floor, strip, wall_mesh
from mazeplan.apps.view.moment import Moment, OpeningShown, PlanShown
from mazeplan.core.palette import rgb
from mazeplan.core.records import Array
from mazeplan.maze.geometry import Maze, Opening

if TYPE_CHECKING:
    from viser import ViserServer

UNIT = 10.0  # lengths in the scene are dm, because viser's cameras and lights suit things of a size near 1
TRAIL_S, TRAIL_POINTS = 3.0, 90
PLAN_POINTS = 64
ROUTE_POINTS = 400
WIDEST = 0.015  # m; maximum half width of the band, because a lost estimate makes errors larger than the maze
TILT_SHOWN = 3.0  # drawn tilt over true tilt
WALLS_SHOWN = 0.5  # drawn height of the walls over true height, so that the ball is visible behind them
WALL, TABLE = (178, 184, 192), (205, 208, 212)
FLOORS = (238, 240, 242), (250, 250, 248)  # of even and odd rings
GOAL_FLOOR = (172, 222, 190)
PUSH_PER_S = 4.0  # speed of a push, m/s, for each m that a person drags the ball
SHADE = (222, 225, 229)
SHADE_BELOW, RAISED = 0.3, 0.15  # depth of the plate's shade and usual height of its raised edge, in radii of the rim
LABELS_AT = -60.0  # deg, where rings have their numbers
Colour = tuple[int, int, int]


class Scene:
    """The scene of a maze on a page. A page may have two of them side by side.

    name: of the scene in viser's tree
    at: place of the maze, x, y in m
    on_ring, on_opening: called with the number or name at a click; None: no clicks
    on_push: called with the velocity x, y, m/s, at the end of a drag of the ball; None: no drags"""

    def __init__(
        self, server: ViserServer, maze: Maze, name: str = "/maze", at: tuple[float, float] = (0.0, 0.0), *,
        on_ring: Callable[[int], None] | None = None, on_opening: Callable[[str], None] | None = None,
        on_push: Callable[[float, float], None] | None = None,
    ) -> None:  # fmt: skip
        self._server, self._maze, self._name = server, maze, name
        self.tilt_shown = TILT_SHOWN
        scene = server.scene
        scene.add_frame(name, show_axes=False, position=(UNIT * at[0], UNIT * at[1], 0.0))
        self._plate = scene.add_frame(f"{name}/plate", show_axes=False)
        rim = maze.walls[0].outer_radius
        scene.add_cylinder(
            f"{name}/shade", UNIT * 0.99 * rim, 0.01, SHADE, radial_segments=96,
            position=(0.0, 0.0, -UNIT * SHADE_BELOW * rim),
        )  # fmt: skip
        self._build_plate(on_ring)
        self._openings = {o.name: _OpeningMark(self, o, on_opening) for o in maze.openings}
        self._build_ball(on_push)
        self._build_planned()
        self._shown: tuple[Any, ...] = ()

    def _mesh(self, name: str, mesh: Mesh, colour: Colour, **more: Any) -> Any:
        return add_mesh(self._server, f"{self._name}/plate/{name}", mesh, colour, **more)

    def _build_plate(self, on_ring: Callable[[int], None] | None) -> None:
        maze, plate = self._maze, f"{self._name}/plate"
        for name, mesh in wall_meshes(maze).items():
            self._mesh(name, mesh, WALL, flat_shading=False)
        self._floors: dict[int, Any] = {}
        for ring in maze.rings:
            floor = self._floors[ring.number] = self._mesh(
                f"ring{ring.number}", ring_floor(maze, ring.number), FLOORS[ring.number % 2]
            )
            if on_ring is not None:
                floor.on_click(lambda _, number=ring.number: on_ring(number))
                out = 0.5 * (ring.inner_radius + ring.outer_radius) if ring.inner_radius else 0.0
                along = math.radians(LABELS_AT)
                self._server.scene.add_label(
                    f"{plate}/ring{ring.number}/number", str(ring.number), font_screen_scale=0.7,
                    position=(UNIT * out * math.cos(along), UNIT * out * math.sin(along), UNIT * 0.001),
                )  # fmt: skip
        self._server.scene.add_cylinder(
            f"{plate}/base", UNIT * maze.walls[0].outer_radius, UNIT * 0.003, TABLE, radial_segments=96,
            position=(0.0, 0.0, -UNIT * 0.002),
        )  # fmt: skip

    def _build_ball(self, on_push: Callable[[float, float], None] | None) -> None:
        scene, plate, radius = self._server.scene, f"{self._name}/plate", UNIT * self._maze.ball.radius
        self._ball = scene.add_icosphere(f"{plate}/ball", radius, rgb("real"), subdivisions=3, visible=False)
        self._second = scene.add_icosphere(f"{plate}/ball2", radius, rgb("second"), subdivisions=3, visible=False)
        if on_push is not None:
            self._ball.on_drag(partial(_push, on_push))
        nothing = np.zeros((TRAIL_POINTS - 1, 2, 3), dtype=np.float32)
        fade = np.linspace(0.0, 1.0, TRAIL_POINTS)[:, None]
        colours = (1.0 - fade) * np.array([215, 222, 230]) + fade * np.array(rgb("real"))
        pairs = np.stack([colours[:-1], colours[1:]], axis=1).astype(np.uint8)
        self._trail = scene.add_line_segments(f"{plate}/trail", nothing, pairs, thickness=0.02)
        line = np.zeros((PLAN_POINTS - 1, 2, 3), dtype=np.float32)
        self._plan = scene.add_line_segments(f"{plate}/plan", line, rgb("planned"), thickness=0.022, visible=False)
        band = strip(np.zeros((PLAN_POINTS, 3)), np.zeros((PLAN_POINTS, 3)))
        self._band = scene.add_mesh_simple(
            f"{plate}/errors", *band, color=rgb("planned"), opacity=0.28, side="double", visible=False,
        )  # fmt: skip

    def _build_planned(self) -> None:
        """Add the route of the next run and the start of its ball, invisible at first."""
        scene, plate, nothing = self._server.scene, f"{self._name}/plate", np.zeros((ROUTE_POINTS - 1, 2, 3))
        self._route = scene.add_line_segments(
            f"{plate}/route", nothing.astype(np.float32), rgb("planned"), thickness=0.016, visible=False
        )
        self._start = scene.add_label(
            f"{plate}/start", "start", visible=False, anchor="bottom-center", font_screen_scale=0.8
        )
        self._goal: int | None = None
        self._planned: dict[str, Any] | None = None

    # -- what changes -----------------------------------------------------------------------------------------------

    def show(self, moment: Moment) -> None:
        """Draw a moment of a run in this maze; only changes are sent."""
        shown = (moment.run, moment.tick, moment.openings, self.tilt_shown, moment.result is None)
        if shown == self._shown:
            return
        self._shown = shown
        beta, gamma = (self.tilt_shown * angle for angle in moment.tilt)
        self._plate.wxyz = attitude(beta, gamma)
        for drawn, ball, colour in ((self._ball, moment.ball, "real"), (self._second, moment.second, "second")):
            drawn.visible = ball is not None
            if ball is not None:
                drawn.position = (UNIT * ball.x, UNIT * ball.y, UNIT * self._maze.ball.radius)
                drawn.color = rgb(colour) if ball.seen else rgb("neutral")
        trail = moment.trail(TRAIL_S)
        self._trail.visible = len(trail) > 1
        if len(trail) > 1:
            self._trail.points = segments(resampled(trail, TRAIL_POINTS), UNIT * 0.001)
        self._show_plan(moment.plan)
        for opening in moment.openings:
            if opening.name in self._openings:
                self._openings[opening.name].show(opening)

    def show_goal(self, ring: int | None) -> None:
        """Colour the floor of the goal ring."""
        if ring != self._goal:
            for number, colour in ((self._goal, None), (ring, GOAL_FLOOR)):
                if number in self._floors:
                    self._floors[number].color = colour or FLOORS[number % 2]
            self._goal = ring

    def show_planned(self, plan: dict[str, Any] | None) -> None:
        """Draw what the next run will do (`PageLink.show_planned`); None: nothing."""
        if plan is self._planned:
            return
        self._planned = plan
        points = [] if plan is None else plan["points"]
        self._route.visible, self._start.visible = len(points) > 1, plan is not None
        if len(points) > 1:
            self._route.points = segments(resampled(np.array(points, dtype=float), ROUTE_POINTS), UNIT * 0.0018)
        if plan is not None:
            x, y = plan["ball"]
            self._start.position = (UNIT * x, UNIT * y, UNIT * 0.002)

    def _show_plan(self, plan: PlanShown | None) -> None:
        self._plan.visible = self._band.visible = plan is not None
        if plan is None:
            return
        places = resampled(plan.places, PLAN_POINTS)
        errors = resampled(plan.errors[:, None], PLAN_POINTS)[:, 0]
        self._plan.points = segments(places, UNIT * 0.0015)
        self._band.vertices = (UNIT * ribbon(places, np.minimum(2.0 * errors, WIDEST), 0.0012)[0]).astype(np.float32)


class _OpeningMark:
    """The drawing of an opening: a mark on its floor, a frame while it is the next opening, a plug while it is closed.

    A label shows that it is closed, or its chance of getting through once it was tried."""

    def __init__(self, scene: Scene, opening: Opening, on_click: Callable[[str], None] | None) -> None:
        maze, name = scene._maze, f"opening/{opening.name}"
        self._floor = scene._mesh(f"{name}/floor", gap_box(maze, opening, 0.0, 4e-4), rgb("idle"))
        self._plug = scene._mesh(
            f"{name}/plug", gap_box(maze, opening, 0.0, WALLS_SHOWN * maze.wall_height), rgb("bad"), visible=False
        )
        self._frame = scene._mesh(
            f"{name}/frame",
            posts(maze, opening, 0.0025, 1.15 * WALLS_SHOWN * maze.wall_height),
            rgb("planned"),
            visible=False,
        )
        middle, high = UNIT * maze.threshold_radius(opening), UNIT * 1.25 * WALLS_SHOWN * maze.wall_height
        self._add_label = partial(
            scene._server.scene.add_label, f"{scene._name}/plate/{name}/label", anchor="bottom-center",
            position=(middle * math.cos(opening.angle), middle * math.sin(opening.angle), high), font_screen_scale=0.8,
        )  # fmt: skip
        self._label: Any = None
        self._before: tuple[Any, ...] = ()
        if on_click is not None:
            for mesh in (self._floor, self._plug):
                mesh.on_click(lambda _: on_click(opening.name))

    def show(self, known: OpeningShown) -> None:
        text = f"{100 * known.chance:.0f} % ({100 * known.low:.0f}–{100 * known.high:.0f})" if known.tried else ""
        text = "closed" if known.closed else text
        now = (opening_colour(known), known.closed, known.next and not known.closed, text)
        if now == self._before:
            return
        self._before = now
        self._floor.color, self._plug.visible, self._frame.visible, _ = now
        if text and self._label is not None:
            self._label.text = text
        elif text:
            self._label = self._add_label(text)
        elif self._label is not None:
            self._label.remove()
            self._label = None


async def _push(on_push: Callable[[float, float], None], event: Any) -> None:
    """At the end of a drag of the ball, push the ball with a speed in proportion to the length of the drag."""
    x, y, height = event.start_position
    to = pointed_place(event.client.camera.position, event.end_position, height)
    if event.phase == "end" and to is not None:
        on_push(PUSH_PER_S * (to[0] - x) / UNIT, PUSH_PER_S * (to[1] - y) / UNIT)


def outline(maze: Maze, at: tuple[float, float] = (0.0, 0.0)) -> Array:
    """Points, (N, 3), that enclose a maze while it tilts. at: place of the maze, x, y in m"""
    rim = UNIT * maze.walls[0].outer_radius
    return around(rim, (UNIT * at[0], UNIT * at[1]), -SHADE_BELOW * rim, RAISED * rim)


def add_mesh(server: ViserServer, name: str, mesh: Mesh, colour: Colour, **more: Any) -> Any:
    """Add a mesh, in m, to the scene."""
    vertices, faces = mesh
    return server.scene.add_mesh_simple(name, UNIT * vertices, faces, color=colour, side="double", **more)


def wall_meshes(maze: Maze) -> dict[str, Mesh]:
    """All walls with their drawn height, by their names in the scene."""
    height = WALLS_SHOWN * maze.wall_height
    found = {f"wall{wall.outer_ring}": wall_mesh(wall, height) for wall in maze.walls}
    return found | {f"radial{i}": radial_mesh(maze, wall, height) for i, wall in enumerate(maze.radial_walls)}


def opening_colour(known: OpeningShown) -> Colour:
    """Grey for an untried opening; otherwise the colour shows the chance of getting through."""
    if not known.tried:
        return rgb("skipped")
    share = min(max(known.chance, 0.0), 1.0)
    below, above, part = ("bad", "unsure", 2.0 * share) if share < 0.5 else ("unsure", "good", 2.0 * share - 1.0)
    mixed = [round((1.0 - part) * a + part * b) for a, b in zip(rgb(below), rgb(above), strict=True)]
    return mixed[0], mixed[1], mixed[2]


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
