"""Draw the picture of docs/camera.md as the packaged camera takes it: `python tools/draw_camera.py`."""

from __future__ import annotations

import math
from pathlib import Path

import cv2
import numpy as np
from emulator.render import TRUE, Overhead, over

from mazeplan.maze.mapfile import load_map


def main() -> None:
    maze, at = load_map("cme"), math.radians(35.0)
    radius = maze.track_radius(1)
    ball = np.array([radius * math.cos(at), radius * math.sin(at), maze.ball.radius])
    eye = Overhead(maze, over(TRUE, maze))
    path = Path(__file__).resolve().parent.parent / "docs" / "camera.png"
    cv2.imwrite(str(path), eye.render(ball, math.radians(2.0), math.radians(-3.0), np.random.default_rng(0)))
    print(f"wrote {path}")


if __name__ == "__main__":
    main()
