"""Calibrates the packaged camera (TRUE and FOUND of the tests) from rendered chessboards and plates, and prints
what was found beside what is true. Usage: python tools/calibrate_packaged.py
"""

from __future__ import annotations

import cv2
import numpy as np
from chessboards import board_poses, draw_board
from emulator.render import TRUE, Overhead

from mazeplan.maze.mapfile import load_map
from mazeplan.rigs.camera.calibration import Calibration, LensCalibration, calibrate_lens, calibrate_plate
from mazeplan.rigs.camera.pinhole import corner_markers
from mazeplan.rigs.hardware.settings import mapping

CORNERS, SQUARE, BOARDS, PLATES = (9, 6), 0.02, 16, 8


def calibrated(seed: int = 0, boards: int = BOARDS) -> tuple[LensCalibration, Calibration]:
    """The lens and the whole, from pictures with this seed."""
    rng = np.random.default_rng(seed)
    poses = board_poses(TRUE, CORNERS, SQUARE, boards, rng)
    pictures = [(f"board {i}", draw_board(TRUE, CORNERS, SQUARE, *pose, rng)) for i, pose in enumerate(poses)]
    lens = calibrate_lens(pictures, CORNERS, SQUARE)
    maze = load_map("cme")
    eye = Overhead(maze, TRUE)
    empty = [(f"plate {i}", eye.render(None, 0.0, 0.0, rng)) for i in range(PLATES)]
    return lens, calibrate_plate(lens, empty, maze, corner_markers(maze))


if __name__ == "__main__":
    cv2.setNumThreads(1)
    lens, done = calibrated()
    print(f"lens: {lens.error_px:.3f} px over {lens.used} pictures; left out: {lens.left_out}")
    print(f"plate: {done.error_px:.3f} px, {done.error_mm:.3f} mm")
    print("true ", mapping(TRUE, None))
    print("found", mapping(done.camera, None))
