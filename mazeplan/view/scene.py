"""The maze in 3D as it tilts: ball and trail, the plan ahead with its doubt, openings and what is known of them.

opening   grey: not tried yet; otherwise from `bad` over `unsure` to `good` by the chance of getting through, the mean
          of its Beta posterior, which a label tells with its 90 % bounds; a red plug: closed; a bright frame: the
          ball is brought there
plan      a line on the track of the ring; beside it a band 2 rms wide either way of how far off earlier plans were
tilt      drawn larger than it is, by a factor that the page tells and a slider sets
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from mazeplan.maze.geometry import Maze, Opening
from mazeplan.palette import rgb
from mazeplan.records import Array
from mazeplan.view.camera import around
from mazeplan.view.meshes import gap_box, joined, radial_mesh, ribbon, ring_floor, strip, wall_mesh
from mazeplan.view.moment import Ahead, Gate, Moment

if TYPE_CHECKING:
    from viser import ViserServer

UNIT = 10.0  # lengths in the scene are dm: cameras and lights of viser are made for things about as large as 1
TRAIL_S, TRAIL_POINTS = 3.0, 90
PLAN_POINTS = 64
TILT_SHOWN = 3.0  # times as large as it is
WALLS_SHOWN = 0.5  # of their height: the ball is to be seen behind them
WALL, FLOOR, FLOOR_2, TABLE = (178, 184, 192), (250, 250, 248), (238, 240, 242), (205, 208, 212)
SHADE = (222, 225, 229)
SHADE_BELOW, RAISED = 0.3, 0.15  # of the rim's radius: the shade of the plate, and how high its edge comes as a rule
LABELS_AT = -60.0  # deg, where rings have their numbers
Colour = tuple[int, int, int]


class Scene:
    """The scene of a page, under `name` in viser's tree: two of them may stand side by side (`at`: x, y in m).

    on_ring, on_opening: called with number or name when somebody clicks there; None: nothing can be clicked."""

    def __init__(
        self, server: ViserServer, maze: Maze, name: str = "/maze", at: tuple[float, float] = (0.0, 0.0), *,
        on_ring: Callable[[int], object] | None = None, on_opening: Callable[[str], object] | None = None,
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
        self._gates = {o.name: _GateMark(self, o, on_opening) for o in maze.openings}
        self._build_ball()
        self._shown: tuple[Any, ...] = ()

    def _mesh(self, name: str, mesh: tuple[Array, Any], colour: Colour, **more: Any) -> Any:
        vertices, faces = mesh
        return self._server.scene.add_mesh_simple(
            f"{self._name}/plate/{name}", UNIT * vertices, faces, color=colour, side="double", **more
        )

    def _build_plate(self, on_ring: Callable[[int], object] | None) -> None:
        maze = self._maze
        for wall in maze.walls:
            self._mesh(
                f"wall{wall.outer_ring}", wall_mesh(wall, WALLS_SHOWN * maze.wall_height), WALL, flat_shading=False
            )
        for i, wall in enumerate(maze.radial_walls):
            self._mesh(f"radial{i}", radial_mesh(maze, wall, WALLS_SHOWN * maze.wall_height), WALL, flat_shading=False)
        for ring in maze.rings:
            colour = FLOOR if ring.number % 2 else FLOOR_2
            floor = self._mesh(f"ring{ring.number}", ring_floor(maze, ring.number), colour)
            if on_ring is not None:
                floor.on_click(_calling(on_ring, ring.number))
                out = 0.5 * (ring.inner_radius + ring.outer_radius) if ring.inner_radius else 0.0
                along = math.radians(LABELS_AT)
                self._server.scene.add_label(
                    f"{self._name}/plate/ring{ring.number}/number", str(ring.number), font_screen_scale=0.7,
                    position=(UNIT * out * math.cos(along), UNIT * out * math.sin(along), UNIT * 0.001),
                )  # fmt: skip
        self._server.scene.add_cylinder(
            f"{self._name}/plate/base", UNIT * maze.walls[0].outer_radius, UNIT * 0.003, TABLE, radial_segments=96,
            position=(0.0, 0.0, -UNIT * 0.002),
        )  # fmt: skip

    def _build_ball(self) -> None:
        scene, plate, radius = self._server.scene, f"{self._name}/plate", UNIT * self._maze.ball.radius
        self._ball = scene.add_icosphere(f"{plate}/ball", radius, rgb("real"), subdivisions=3, visible=False)
        nothing = np.zeros((TRAIL_POINTS - 1, 2, 3), dtype=np.float32)
        fade = np.linspace(0.0, 1.0, TRAIL_POINTS)[:, None]
        colours = (1.0 - fade) * np.array([215, 222, 230]) + fade * np.array(rgb("real"))
        pairs = np.stack([colours[:-1], colours[1:]], axis=1).astype(np.uint8)
        self._trail = scene.add_line_segments(f"{plate}/trail", nothing, pairs, thickness=0.02)
        line = np.zeros((PLAN_POINTS - 1, 2, 3), dtype=np.float32)
        self._plan = scene.add_line_segments(f"{plate}/plan", line, rgb("planned"), thickness=0.022, visible=False)
        band = strip(np.zeros((PLAN_POINTS, 3)), np.zeros((PLAN_POINTS, 3)))
        self._band = scene.add_mesh_simple(
            f"{plate}/doubt", *band, color=rgb("planned"), opacity=0.28, side="double", visible=False,
        )  # fmt: skip

    # -- what changes -----------------------------------------------------------------------------------------------

    def show(self, moment: Moment) -> None:
        """Draw a moment of a run in this maze; what is as it was is not sent again."""
        shown = (moment.run, moment.tick, moment.tree, moment.gates, self.tilt_shown, moment.result is None)
        if shown == self._shown:
            return
        self._shown = shown
        beta, gamma = (self.tilt_shown * angle for angle in moment.tilt)
        self._plate.wxyz = attitude(beta, gamma)
        self._ball.visible = moment.ball is not None
        if moment.ball is not None:
            self._ball.position = (UNIT * moment.ball[0], UNIT * moment.ball[1], UNIT * self._maze.ball.radius)
            self._ball.color = rgb("real") if moment.seen else rgb("neutral")
        trail = moment.trail(TRAIL_S)
        self._trail.visible = len(trail) > 1
        if len(trail) > 1:
            self._trail.points = segments(resampled(trail, TRAIL_POINTS), UNIT * 0.001)
        self._show_plan(moment.plan)
        for gate in moment.gates:
            if gate.name in self._gates:
                self._gates[gate.name].show(gate)

    def _show_plan(self, plan: Ahead | None) -> None:
        self._plan.visible = self._band.visible = plan is not None
        if plan is None:
            return
        places = resampled(plan.places, PLAN_POINTS)
        doubt = resampled(plan.doubt[:, None], PLAN_POINTS)[:, 0]
        self._plan.points = segments(places, UNIT * 0.0015)
        self._band.vertices = (UNIT * ribbon(places, 2.0 * doubt, 0.0012)[0]).astype(np.float32)


class _GateMark:
    """An opening: a mark on its floor, a frame while it is next, a plug while it is closed, a label once tried."""

    def __init__(self, scene: Scene, opening: Opening, on_click: Callable[[str], object] | None) -> None:
        maze, name = scene._maze, f"gate/{opening.name}"
        self._floor = scene._mesh(f"{name}/floor", gap_box(maze, opening, 0.0, 4e-4), rgb("idle"))
        self._plug = scene._mesh(
            f"{name}/plug", gap_box(maze, opening, 0.0, WALLS_SHOWN * maze.wall_height), rgb("bad"), visible=False
        )
        self._frame = scene._mesh(f"{name}/frame", _posts(maze, opening), rgb("planned"), visible=False)
        middle, high = UNIT * maze.threshold_radius(opening), UNIT * 1.25 * WALLS_SHOWN * maze.wall_height
        self._add_label = partial(
            scene._server.scene.add_label, f"{scene._name}/plate/{name}/label", anchor="bottom-center",
            position=(middle * math.cos(opening.angle), middle * math.sin(opening.angle), high), font_screen_scale=0.8,
        )  # fmt: skip
        self._label: Any = None
        self._before: tuple[Any, ...] = ()
        if on_click is not None:
            for mesh in (self._floor, self._plug):
                mesh.on_click(_calling(on_click, opening.name))

    def show(self, gate: Gate) -> None:
        text = f"{100 * gate.chance:.0f} % ({100 * gate.low:.0f}–{100 * gate.high:.0f})" if gate.tried else ""
        if gate.closed:
            text = "closed"
        now = (gate_colour(gate), gate.closed, gate.next and not gate.closed, text)
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


def outline(maze: Maze, at: tuple[float, float] = (0.0, 0.0)) -> Array:
    """Points, (N, 3), between which a maze lies that stands at a place, m, and tilts."""
    rim = UNIT * maze.walls[0].outer_radius
    return around(rim, (UNIT * at[0], UNIT * at[1]), -SHADE_BELOW * rim, RAISED * rim)


def _calling(what: Callable[[Any], object], with_: Any) -> Callable[[Any], None]:
    def call(event: Any) -> None:
        what(with_)

    return call


def _posts(maze: Maze, opening: Opening) -> tuple[Array, Any]:
    """Two posts beside an opening, a little higher than its wall."""
    inner, outer = maze.ring(opening.inner).outer_radius, maze.ring(opening.outer).inner_radius
    along = np.array([math.cos(opening.angle), math.sin(opening.angle), 0.0])
    across = np.array([-along[1], along[0], 0.0])
    posts = []
    for side in (-1.0, 1.0):
        near, far = (side * (0.5 * opening.width + beside) * across for beside in (0.0, 0.0025))
        feet = np.array([inner * along + near, outer * along + near, outer * along + far, inner * along + far])
        heads = feet + np.array([0.0, 0.0, 1.15 * WALLS_SHOWN * maze.wall_height])
        sides = [strip(heads[[i, (i + 1) % 4]], feet[[i, (i + 1) % 4]]) for i in range(4)]
        posts.append(joined([strip(heads[[0, 1]], heads[[3, 2]]), *sides]))
    return joined(posts)


def gate_colour(gate: Gate) -> Colour:
    """By what is known of it."""
    if not gate.tried:
        return rgb("skipped")
    share = min(max(gate.chance, 0.0), 1.0)
    below, above, part = ("bad", "unsure", 2.0 * share) if share < 0.5 else ("unsure", "good", 2.0 * share - 1.0)
    mixed = [round((1.0 - part) * a + part * b) for a, b in zip(rgb(below), rgb(above), strict=True)]
    return mixed[0], mixed[1], mixed[2]


def attitude(beta: float, gamma: float) -> tuple[float, float, float, float]:
    """Quaternion w, x, y, z of the plate, Ry(beta) Rx(gamma)."""
    cb, sb, cg, sg = math.cos(0.5 * beta), math.sin(0.5 * beta), math.cos(0.5 * gamma), math.sin(0.5 * gamma)
    return cb * cg, cb * sg, sb * cg, -sb * sg


def resampled(points: Array, count: int) -> Array:
    """`count` rows from (N, k) rows evenly by number; the whole, however many there are."""
    at = np.linspace(0.0, len(points) - 1.0, count)
    return np.column_stack([np.interp(at, np.arange(len(points)), column) for column in points.T])


def segments(places: Array, z: float) -> Any:
    """(N, 2) places in m as (N - 1, 2, 3) pieces of a line in the scene; a piece without both ends has no length."""
    points = np.column_stack([UNIT * places, np.full(len(places), z)])
    pairs = np.stack([points[:-1], points[1:]], axis=1)
    pairs[~np.isfinite(pairs).all(axis=(1, 2))] = (0.0, 0.0, -1.0)
    return pairs.astype(np.float32)
