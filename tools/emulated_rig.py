"""Calibrates the packaged emulated rig as a person would a real one, and writes tools/emulated.yaml and its
picture of the empty floor. Nothing of what its world is like is copied: readings of a clinometer and pictures are all
that is used. Usage: python tools/emulated_rig.py [-o FOLDER]   (two minutes, on a quiet machine)
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import date
from pathlib import Path
from typing import Any

import numpy as np
from chessboards import board_poses, draw_board
from emulator.settings import WorldSettings
from emulator.table import EmulatedTable
from emulator.truth import Truth

from mazeplan.maze.mapfile import load_map
from mazeplan.rigs.camera.calibration import calibrate_lens, calibrate_plate
from mazeplan.rigs.camera.pinhole import corner_markers
from mazeplan.rigs.files import validated
from mazeplan.rigs.hardware.settings import Servo, mapping, write_sections
from mazeplan.rigs.hardware.tiltcalibration import PulseHolder, TiltFit, fit_tilt, grid, take_readings
from mazeplan.rigs.link.board import Board, open_board

MAZE = load_map("cme")
WORLD: dict[str, Any] = {
    "seed": 1,
    "physics": {"rolling_friction_m": 5.0e-5, "wall_grip": 0.3, "table_x_deg": 0.3, "table_y_deg": 0.15},
    "camera_delay_ms": 50.0,
}
SEED = 5  # of the person's hand and eye
READ_DEG = 0.04  # 1 sigma of the clinometer, before it rounds to a tenth
RANGE_DEG = 6.5  # servo limits, about level
TILTS, BOARDS, PLATES, CORNERS, SQUARE = 7, 16, 8, (9, 6), 0.02
HEAD = """\
# The emulated rig: the firmware on a simulated chip behind a serial port, rendered pictures, and MuJoCo's plate and
# ball, in real time. Needs `make emulator`. world.seed draws the true servos, diodes and camera. Calibrations found
# the other values, as on a real rig: python tools/emulated_rig.py
class: emulator.rig:EmulatedRig
model: toy                     # what estimator and planner know of plate and ball
"""


@contextmanager
def opened(world: WorldSettings, servo: Servo | None = None) -> Iterator[tuple[EmulatedTable, Board]]:
    """A table and its board."""
    table = EmulatedTable(MAZE, world)
    try:
        board = open_board(table.port, (servo or Servo()).limits())
        try:
            yield table, board
        finally:
            board.close()
    finally:
        table.close()


def tilt_readings(table: EmulatedTable, board: Board, servo: Servo, count: int = TILTS) -> TiltFit:
    """Read the clinometer over a grid, and fit."""
    rng = np.random.default_rng(SEED)

    def ask(number: int, pulses: tuple[float, float]) -> tuple[float, float]:
        beta, gamma = (round(math.degrees(v) + rng.normal(0.0, READ_DEG), 1) for v in table.tilt())
        return beta, gamma

    return fit_tilt(take_readings(board, grid(servo, math.degrees(MAZE.tilt_limit), count), ask))


def wide(servo: Servo) -> Servo:
    """Limits as far as the board allows, for servos of which nothing is known yet."""
    return servo.model_copy(
        update={a: getattr(servo, a).model_copy(update={"min_us": 1200.0, "max_us": 1800.0}) for a in ("beta", "gamma")}
    )


def servo_section(fit: TiltFit) -> dict[str, Any]:
    """What was found, with limits around it."""
    out: dict[str, Any] = {}
    for axis, found in fit.servos.items():
        level, gain = found["level_us"], found["us_per_deg"]
        room = abs(gain) * RANGE_DEG
        out[axis] = {
            "level_us": round(level, 1), "us_per_deg": round(gain, 3), "min_us": round(level - room, 0),
            "max_us": round(level + room, 0),
        }  # fmt: skip
    return {**out, "slew_us_per_s": 6000.0}


def camera_section(table: EmulatedTable, truth: Truth, background: Path) -> dict[str, Any]:
    """Lens by chessboards that are held in front of the camera, pose and background by the level plate."""
    rng = np.random.default_rng(SEED)
    poses = board_poses(truth.camera, CORNERS, SQUARE, BOARDS, rng)
    boards = [(f"board {i}", draw_board(truth.camera, CORNERS, SQUARE, *pose, rng)) for i, pose in enumerate(poses)]
    lens = calibrate_lens(boards, CORNERS, SQUARE)
    plates = [(f"plate {i}", frame.image) for i in range(PLATES) if (frame := table.read()) is not None]
    markers = corner_markers(MAZE)
    found = calibrate_plate(lens, plates, MAZE, markers)
    found.background.write(background)
    print(f"lens {lens.error_px:.3f} px, plate {found.error_px:.3f} px, {found.error_mm:.3f} mm")
    return mapping(
        found.camera, markers, background=background.name, date=date.today().isoformat(),
        error_px=round(found.error_px, 3), error_mm=round(found.error_mm, 3),
    )  # fmt: skip


def calibrate(folder: Path) -> None:
    """Write emulated.yaml and emulated.png into a folder."""
    path, today = folder / "emulated.yaml", date.today().isoformat()
    world = validated(WorldSettings, WORLD)
    path.write_text(HEAD, encoding="utf-8")
    with opened(world, wide(Servo())) as (table, board):
        fit = tilt_readings(table, board, wide(Servo()))
    worst = max(fit.beta.left_out_deg, fit.gamma.left_out_deg)
    print(f"tilt: {worst:.3f} deg; left out: {fit.outliers}")
    servo = servo_section(fit)
    with opened(world, validated(Servo, servo)) as (table, board):
        level = servo["beta"]["level_us"], servo["gamma"]["level_us"]
        with PulseHolder(board, level):
            for _ in range(60):  # until it rests
                table.read()
            camera = camera_section(table, Truth.drawn(world.seed), folder / "emulated.png")
    tilt = {**fit.sensor.model_dump(mode="json"), "date": today}
    write_sections(path, {"servo": servo, "tilt": tilt, "camera": camera, "world": WORLD})


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("-o", "--output", type=Path, default=Path(__file__).resolve().parent)
    calibrate(parser.parse_args().output)
