"""The maze in a film: drawn from above, or as a picture of the tilting plate."""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np

from mazeplan.apps.view.moment import Moment
from mazeplan.core.palette import COLOURS
from mazeplan.core.records import Array
from mazeplan.maze.drawing import draw_maze
from mazeplan.maze.geometry import Maze

MM = 1000.0
HIGH = 0.62  # m, height of the camera
WALL = (158, 152, 146)  # blue, green, red of the walls; differs from ball and lines
PIXELS = 520  # side of a picture
MARGIN = 1.12  # half the side of a picture, in radii of the rim
BALLS = ("real", "second")  # colours of the balls


class Plate(Protocol):
    """The part of a frame that shows the maze. moving: its artists."""

    moving: tuple[Any, ...]

    def show(self, moment: Moment) -> None:
        """Show balls and tilt of a moment."""
        ...

    def at(self, points: Array, moment: Moment) -> Array:
        """Places in the axes, (N, 2), of points (N, 2) on the floor, m."""
        ...


class DrawnPlate:
    """The maze from above, without tilt."""

    def __init__(self, axes: Any, maze: Maze) -> None:
        from matplotlib.patches import Circle

        draw_maze(maze, axes, labels=False, ball=False)
        radius = MM * maze.ball.radius
        self.moving = tuple(Circle((0.0, 0.0), radius, color=COLOURS[name], zorder=8) for name in BALLS)
        for circle in self.moving:
            axes.add_patch(circle)

    def show(self, moment: Moment) -> None:
        """See `Plate`."""
        for name, circle, ball in zip(BALLS, self.moving, (moment.ball, moment.second), strict=True):
            circle.set_visible(ball is not None)
            if ball is not None:
                circle.set_center((MM * ball.x, MM * ball.y))
                circle.set_color(COLOURS[name if ball.seen else "neutral"])

    def at(self, points: Array, moment: Moment) -> Array:
        """See `Plate`. The axes are in mm."""
        return MM * points


class RenderedPlate:
    """The plate as a camera above it would see it, tilted, with shadows. Raises ImportError without OpenCV.

    The picture leaves out a ball that the camera did not see. A second ball has a circle around it."""

    def __init__(self, axes: Any, maze: Maze) -> None:
        from mazeplan.rigs.camera.look import Look
        from mazeplan.rigs.camera.markers import Markers
        from mazeplan.rigs.camera.pinhole import CameraModel
        from mazeplan.rigs.camera.render import Overhead

        self._maze, reach = maze, maze.walls[0].outer_radius * MARGIN
        focal = 0.5 * PIXELS / reach * HIGH
        middle = 0.5 * (PIXELS - 1)
        matrix = np.array([[focal, 0.0, middle], [0.0, focal, middle], [0.0, 0.0, 1.0]])
        above = np.array([0.0, 0.0, HIGH])
        self._camera = CameraModel(matrix, np.zeros(5), np.diag([1.0, -1.0, -1.0]), above, (PIXELS, PIXELS))
        look = Look(ball="blue", noise=0.0, flicker=0.0, blur=0.3, gloss=0.2, wall=WALL)
        self._eye = Overhead(maze, self._camera, look, Markers({}, 0.0))
        self._rng = np.random.default_rng(0)
        axes.set_axis_off()
        self._image = axes.imshow(np.zeros((PIXELS, PIXELS, 3), np.uint8), interpolation="nearest", zorder=0)
        (self._second,) = axes.plot([], [], "o", color=COLOURS["second"], fillstyle="none", markersize=18, zorder=8)
        self._second.set_markeredgewidth(3.0)
        self.moving = (self._image, self._second)

    def show(self, moment: Moment) -> None:
        """See `Plate`."""
        seen = [ball for ball in (moment.ball, moment.second) if ball is not None and ball.seen]
        balls = tuple(np.array([ball.x, ball.y, self._maze.ball.radius]) for ball in seen)
        beta, gamma = moment.tilt
        picture = self._eye.render(None, beta, gamma, self._rng, others=balls)
        self._image.set_data(picture[..., ::-1])
        second = moment.second
        place = np.empty((0, 2)) if second is None else self.at(np.array([[second.x, second.y]]), moment)
        self._second.set_data(place[:, 0], place[:, 1])

    def at(self, points: Array, moment: Moment) -> Array:
        """See `Plate`. The axes are in pixels; the points are taken at the height of the ball's centre."""
        on = np.column_stack([points, np.full(len(points), self._maze.ball.radius)])
        return self._camera.project(on, *moment.tilt)


def plate_of(axes: Any, maze: Maze) -> Plate:
    """The rendered plate, or the drawn plate if OpenCV is missing."""
    try:
        return RenderedPlate(axes, maze)
    except ImportError:
        return DrawnPlate(axes, maze)
