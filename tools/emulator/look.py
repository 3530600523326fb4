"""Appearance of rendered pictures: colours, lamp, lens, sensor. Colours are blue, green, red from 0 to 255."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import cv2
import numpy as np

Colour = tuple[int, int, int]
SPRITE = 96  # px, side of the ball's own picture
EDGE = 0.05  # width of the ball's soft edge, as a share of its radius
SHADE = 0.55  # share of the light in the ball's shadow
GAP, TALL = 1.2, 3.0  # distance and height of a wall beside the ball, in radii of the ball


@dataclass(frozen=True)
class Look:
    """Appearance of rendered pictures.

    ball: steel, orange or blue.
    blur: standard deviation of the blur, px.
    noise: standard deviation of the sensor's noise, grey levels.
    exposure: factor of the light; 1 is right.
    flicker: standard deviation of the light from picture to picture, as a share.
    slope: change of the light across the picture, as a share.
    gloss: strength of the lamp's reflection in the floor, 0 to 1.
    lamp: place of the lamp in the room, m.
    sharp: draw at twice the size, and let the shadows of walls follow the tilt; takes twice as long.
    floor, wall, table: colours."""

    ball: str = "steel"
    blur: float = 0.7
    noise: float = 2.5
    exposure: float = 1.0
    flicker: float = 0.02
    slope: float = 0.15
    gloss: float = 0.5
    lamp: tuple[float, float, float] = (-0.2, 0.15, 0.9)
    sharp: bool = True
    floor: Colour = (206, 218, 224)
    wall: Colour = (176, 148, 118)
    table: Colour = (62, 84, 104)

    def __post_init__(self) -> None:
        if self.ball not in BALLS:
            raise ValueError(f"ball: got {self.ball!r}, expected one of {', '.join(BALLS)}")


def steel(look: Look, normal: np.ndarray, to_lamp: np.ndarray, across: np.ndarray) -> np.ndarray:
    """Colour of a ball of polished steel, from above.

    The ball mirrors the ceiling in its middle, then room and walls; at its rim it mirrors the floor with its shadow."""
    ray = 2.0 * normal[..., 2:] * normal - np.array([0.0, 0.0, 1.0])
    level = np.maximum(np.hypot(ray[..., 0], ray[..., 1]), 1e-6)
    rho = np.hypot(normal[..., 0], normal[..., 1])
    slope = ray[..., 2] / level
    start = 1.0 + normal[..., 2]  # lengths in radii of the ball
    aside = np.abs(normal[..., 0] * across[0] + normal[..., 1] * across[1]) / np.maximum(rho, 1e-6)
    to_wall = GAP / np.maximum(aside, 0.05) - rho
    at_wall = start + slope * to_wall
    room = np.interp(ray[..., 2], [-1.0, 0.05, 0.35, 0.75, 1.0], [36, 36, 66, 104, 122])[..., None]
    shadow = np.clip(0.5 - 1.2 * (normal[..., 0] * to_lamp[0] + normal[..., 1] * to_lamp[1]), 0.0, 1.0) * (1.0 - SHADE)
    floor = np.array(look.floor) * (0.58 * (1.0 - shadow))[..., None]
    wall = np.array(look.wall, dtype=float) * 0.33
    return np.where((at_wall < 0.0)[..., None], floor, np.where((at_wall < TALL)[..., None], wall, room))


def painted(colour: Colour, look: Look, normal: np.ndarray, to_lamp: np.ndarray, across: np.ndarray) -> np.ndarray:
    """Colour of a matt ball that is painted in one colour."""
    light = 0.42 + 0.68 * np.clip((normal * to_lamp).sum(axis=2), 0.0, 1.0)
    return np.array(colour, dtype=float) * light[..., None]


BALLS = {
    "steel": steel,
    "orange": partial(painted, (24, 104, 246)),
    "blue": partial(painted, (190, 96, 30)),
}


def sprite(look: Look, to_lamp: np.ndarray, across: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Picture of the ball (SPRITE, SPRITE, 3) and the ball's share of each pixel (SPRITE, SPRITE), float32.

    The ball's disc fills 0.8 of the side; x is to the right, y up.
    to_lamp: unit vector (3,) from the ball to the lamp.
    across: unit vector (2,) towards the walls."""
    at = (np.arange(SPRITE) + 0.5) / SPRITE * 2.5 - 1.25
    x, y = np.meshgrid(at, -at)
    rho = np.hypot(x, y)
    inside = np.minimum(rho, 0.999)
    shrink = inside / np.maximum(rho, 1e-9)
    normal = np.stack([x * shrink, y * shrink, np.sqrt(1.0 - inside**2)], axis=2)
    colour = BALLS[look.ball](look, normal, to_lamp, across)
    half = to_lamp + np.array([0.0, 0.0, 1.0])
    shine = np.clip((normal * (half / np.linalg.norm(half))).sum(axis=2), 0.0, 1.0)
    shine = 255.0 * shine ** (260 if look.ball == "steel" else 60) * (1.0 if look.ball == "steel" else 0.5)
    cover = np.clip((1.0 - rho) / EDGE + 0.5, 0.0, 1.0)
    return np.clip(colour + shine[..., None], 0, 255).astype(np.float32), cover.astype(np.float32)


def grain(shape: tuple[int, int], scale: float, seed: int) -> np.ndarray:
    """A smooth random pattern with standard deviation 1, float32."""
    noise = np.random.default_rng(seed).standard_normal(shape).astype(np.float32)
    smooth = cv2.GaussianBlur(noise, (0, 0), scale)
    return smooth / smooth.std()
