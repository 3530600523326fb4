"""How things look in a rendered picture: colours, lamp, lens, sensor. Colours are blue, green, red from 0 to 255."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

Colour = tuple[int, int, int]
SPRITE = 96  # px, side of the ball's picture before it is put in its place
EDGE = 0.05  # of the radius, over which it ends


@dataclass(frozen=True)
class Look:
    """blur: px, 1 sigma; noise: grey levels, 1 sigma; exposure: 1 is right; flicker: 1 sigma of the light from picture
    to picture; slope: of the light from one side of the picture to the other; gloss: strength of the lamp's reflection
    in the floor, 0 to 1; veils: (x px, y px, radius px, strength 0 to 1) of light that lies over the picture; lamp: m,
    in the room; sharp: drawn at twice the size and wall shadows that go with the tilt, else half as dear."""

    ball: str = "steel"
    blur: float = 0.7
    noise: float = 2.5
    exposure: float = 1.0
    flicker: float = 0.02
    slope: float = 0.15
    gloss: float = 0.5
    veils: tuple[tuple[float, float, float, float], ...] = ()
    lamp: tuple[float, float, float] = (-0.45, 0.35, 0.9)
    sharp: bool = True
    floor: Colour = (206, 218, 224)
    wall: Colour = (176, 148, 118)
    table: Colour = (62, 84, 104)

    def __post_init__(self) -> None:
        if self.ball not in BALLS:
            raise ValueError(f"ball: got {self.ball!r}, expected one of {', '.join(BALLS)}")


def steel(normal: np.ndarray, to_lamp: np.ndarray) -> np.ndarray:
    """Grey of polished steel seen from above: its middle mirrors the ceiling, its sides the room, its rim the floor."""
    up = 2.0 * normal[..., 2] ** 2 - 1.0  # height of the mirrored ray
    room = np.interp(up, [-1.0, -0.5, -0.12, 0.05, 0.35, 0.75, 1.0], [150, 128, 58, 36, 66, 104, 122])
    side = 14.0 * (normal[..., 0] * to_lamp[0] + normal[..., 1] * to_lamp[1])
    return np.repeat((room + side)[..., None], 3, axis=2) * np.array([1.04, 1.0, 0.97])


def painted(colour: Colour, normal: np.ndarray, to_lamp: np.ndarray) -> np.ndarray:
    """A dull ball of one colour."""
    light = 0.42 + 0.68 * np.clip((normal * to_lamp).sum(axis=2), 0.0, 1.0)
    return np.array(colour, dtype=float) * light[..., None]


BALLS = {
    "steel": steel,
    "orange": lambda normal, lamp: painted((24, 104, 246), normal, lamp),
    "blue": lambda normal, lamp: painted((190, 96, 30), normal, lamp),
}


def sprite(look: Look, to_lamp: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Picture of the ball (SPRITE, SPRITE, 3) and how much of each pixel it covers (SPRITE, SPRITE), float32; its disc
    fills 0.8 of the side, x to the right, y up in the first row. to_lamp: unit vector (3,)."""
    at = (np.arange(SPRITE) + 0.5) / SPRITE * 2.5 - 1.25
    x, y = np.meshgrid(at, -at)
    rho = np.hypot(x, y)
    inside = np.minimum(rho, 0.999)
    shrink = inside / np.maximum(rho, 1e-9)
    normal = np.stack([x * shrink, y * shrink, np.sqrt(1.0 - inside**2)], axis=2)
    colour = BALLS[look.ball](normal, to_lamp)
    half = to_lamp + np.array([0.0, 0.0, 1.0])
    shine = np.clip((normal * (half / np.linalg.norm(half))).sum(axis=2), 0.0, 1.0)
    shine = 255.0 * shine ** (260 if look.ball == "steel" else 60) * (1.0 if look.ball == "steel" else 0.5)
    cover = np.clip((1.0 - rho) / EDGE + 0.5, 0.0, 1.0)
    return np.clip(colour + shine[..., None], 0, 255).astype(np.float32), cover.astype(np.float32)


def grain(shape: tuple[int, int], scale: float, seed: int) -> np.ndarray:
    """A quiet irregular pattern, 1 sigma 1, float32."""
    noise = np.random.default_rng(seed).standard_normal(shape).astype(np.float32)
    smooth = cv2.GaussianBlur(noise, (0, 0), scale)
    return smooth / smooth.std()
