"""Episodes of N rigs side by side. The environments with one rig and with many rigs are built on them."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from gymnasium import spaces

from mazeplan.apps.environment.judging import Judge, Verdict
from mazeplan.apps.environment.senses import HIGH, LOW, Senses
from mazeplan.apps.environment.task import Task
from mazeplan.apps.environment.worlds import Samples, rigs_of
from mazeplan.core.errors import SettingsError
from mazeplan.core.name_hints import one_of
from mazeplan.core.records import Array, IntArray, Observation
from mazeplan.core.resources import to_install
from mazeplan.maze.geometry import Maze
from mazeplan.maze.mapfile import load_map

OPTIONS = ("start_ring", "start_angle_deg")  # options of reset()


def places(
    task: Task, maze: Maze, rngs: Sequence[np.random.Generator], options: Mapping[str, Any] | None
) -> tuple[list[int], list[float]]:
    """Rings and angles (rad) at which episodes begin. Raises SettingsError for an option that cannot be used.

    options: options of reset (OPTIONS), which replace those of the task."""
    if not isinstance(options, Mapping | None):
        raise SettingsError(f"got {options!r}, expected a dictionary or None", key="options")
    asked = dict(options or {})
    for name in asked:
        if name not in OPTIONS:
            raise SettingsError(f"unknown option of reset, expected {one_of(OPTIONS, name)}", key=name)
    starts = task.starts(maze, asked.get("start_ring"))
    degrees = asked.get("start_angle_deg", task.start_angle_deg)
    if degrees is not None and not (isinstance(degrees, int | float) and math.isfinite(degrees)):
        raise SettingsError(f"got {degrees!r}, expected a finite number", key="start_angle_deg")
    rings, thetas = [], []
    for rng in rngs:  # always draw both, so that a given value does not change the later random numbers
        ring, angle = int(rng.integers(len(starts))), float(rng.uniform(-math.pi, math.pi))
        rings.append(starts[ring])
        thetas.append(maze.clear_angle(rings[-1], angle if degrees is None else math.radians(degrees)))
    return rings, thetas


def commands_of(actions: Any, number: int, limit: float) -> Array:
    """Commands (number, 2), rad, from actions (number, 2), which are clipped to -1 to 1.

    limit: tilt limit, rad.

    Raises ValueError for actions of another shape, or that are not finite numbers."""
    try:
        given = np.asarray(actions, dtype=float)
    except (TypeError, ValueError):
        given = np.array(math.nan)
    if given.shape != (number, 2) or not np.all(np.isfinite(given)):
        what = actions.tolist() if isinstance(actions, np.ndarray) else actions
        raise ValueError(f"action: got {what!r}, expected two numbers from -1 to 1 for each rig")
    return np.clip(given, -1.0, 1.0) * limit


class Episodes:
    """N rigs with the same task. Calls reset or step some of them, `rows`; the results have one entry for each row."""

    def __init__(self, task: Task, number: int) -> None:
        self.task, self.maze = task, load_map(task.map)
        if self.maze.balls > 1:
            raise SettingsError(f"got a map with {self.maze.balls} balls, expected 1", key="map")
        task.starts(self.maze)
        self.world = rigs_of(task.rig, self.maze, number)
        self.rate_hz = self.world.rate_hz
        self._senses = Senses(self.maze, self.rate_hz, number)
        self._judge = Judge(task, self._senses, number)
        self._closed = False
        self._samples: list[Observation | None] = [None] * number
        self._light: list[np.random.Generator | None] = [None] * number
        self._pictures: Any = None
        self.action_space = spaces.Box(-1.0, 1.0, (2,), np.float32)
        self.observation_space: spaces.Box = (
            spaces.Box(0, 255, (task.size, task.size, 3), np.uint8)
            if task.observation == "pixels"
            else spaces.Box(LOW, HIGH, dtype=np.float32)
        )

    def close(self) -> None:
        """Release the rigs. May be called twice."""
        self._closed = True
        self.world.close()

    def reset(
        self, rows: IntArray, rngs: Sequence[np.random.Generator], options: Mapping[str, Any] | None = None
    ) -> tuple[np.ndarray, dict[str, np.ndarray]]:
        """Begin episodes of the rigs `rows`. Returns observations and info.

        options: options of reset (OPTIONS), which replace those of the task.

        Raises SettingsError for an option that cannot be used."""
        self._check_open()
        rings, thetas = places(self.task, self.maze, rngs, options)
        samples = self.world.reset(rows, rings, thetas, rngs)
        self._senses.reset(rows, samples, rings, thetas)
        self._judge.reset(rows)
        if self.task.observation == "pixels":  # a generator for pictures alone, so that the other noise stays the same
            for row, rng in zip(rows.tolist(), rngs, strict=True):
                self._light[row] = rng.spawn(1)[0]
        self._keep(rows, samples)
        radius, _ = self._senses.place(rows)
        nothing = np.zeros(len(rows), dtype=bool)
        return self._observed(rows), self._info(rows, self._senses.ring(radius), nothing, nothing.copy())

    def step(self, rows: IntArray, actions: np.ndarray) -> tuple[np.ndarray, Verdict, dict[str, np.ndarray]]:
        """Step the rigs `rows`. Returns observations, verdicts and info.

        actions: (len(rows), 2), clipped to -1 to 1.

        Raises ValueError for actions that are not finite numbers."""
        self._check_open()
        commands = commands_of(actions, len(rows), self.maze.tilt_limit)
        samples = self.world.step(rows, commands)
        self._senses.take(rows, samples, commands)
        verdict = self._judge.judge(rows)
        self._keep(rows, samples)
        self.world.rest(rows[verdict.arrived | verdict.out])
        return self._observed(rows), verdict, self._info(rows, verdict.ring, verdict.arrived, verdict.left)

    def _check_open(self) -> None:
        if self._closed:
            raise RuntimeError("the environment is closed: its rig was given back")

    def observation(self, row: int) -> Observation:
        """The last sample of the rig of this row."""
        found = self._samples[row]
        if found is None:
            raise RuntimeError("reset() comes first")
        return found

    def picture(self, row: int) -> np.ndarray:
        """A picture of the rig, (480, 640, 3). For a rig without `pictured`, shows the ball where it was seen last."""
        try:
            scene = self.world.pictured(row)
        except SettingsError:
            sample, (radius, theta) = self.observation(row), self._senses.place(np.array([row]))
            x, y = float(radius[0] * np.cos(theta[0])), float(radius[0] * np.sin(theta[0]))
            scene = np.array([x, y, self.maze.ball.radius, sample.beta, sample.gamma])
        return self._drawn().whole(scene, np.random.default_rng(0))

    def _keep(self, rows: IntArray, samples: Samples) -> None:
        table = np.column_stack([samples.t, samples.x, samples.y, samples.beta, samples.gamma])
        for row, (t, x, y, beta, gamma) in zip(rows.tolist(), table.tolist(), strict=True):
            lost = math.isnan(x)
            self._samples[row] = Observation(t, None if lost else x, None if lost else y, beta, gamma)

    def _drawn(self) -> Any:
        if self._pictures is None:
            try:
                from mazeplan.rigs.camera.sensing import RenderedPictures
            except ImportError:
                raise SettingsError(f"pictures need OpenCV: {to_install('gym')}") from None
            self._pictures = RenderedPictures(self.maze)
        return self._pictures

    def _observed(self, rows: IntArray) -> np.ndarray:
        if self.task.observation == "state":
            return self._senses.state(rows)
        light = [(row, self._light[row]) for row in rows.tolist()]
        pictures, size = self._drawn(), self.task.size
        drawn = [pictures.small(self.world.pictured(row), rng, size) for row, rng in light if rng is not None]
        return np.stack(drawn)

    def _info(self, rows: IntArray, ring: IntArray, arrived: np.ndarray, left: np.ndarray) -> dict[str, np.ndarray]:
        """The info of Gymnasium; each entry has shape (rows,).

        ring: ring in which the ball was seen last.
        time_s: time of the rig, s.
        seen: whether the last sample shows the ball.
        success: whether the ball has arrived.
        is_success: the same as success; some libraries expect this name.
        ball_out: whether the ball has left the maze."""
        seen = self._senses.unseen_s(rows) <= 0.0
        return {
            "ring": ring, "time_s": self._senses.t[rows], "seen": seen, "success": arrived,
            "is_success": arrived.copy(), "ball_out": left,
        }  # fmt: skip
