"""The camera's picture of the ring: a circle that may be shifted.

    r = R + x_0 cos(theta) + y_0 sin(theta)     to first order in the offset

for a camera with the offset (x_0, y_0). The offset also distorts theta. Therefore theta is corrected before the
diagnosis of the ball. If r was not measured, the motion of the ball shows the offset, because the ball stays at the
track radius R. The camera sees the ball at the angle theta of (x_0 + R cos(phi), y_0 + R sin(phi)). Hence

    phi = theta + asin((x_0 sin(theta) - y_0 cos(theta)) / R)
"""

from __future__ import annotations

import numpy as np

from mazeplan.core.records import Array
from mazeplan.diagnosis.document import Entry, effect_entry
from mazeplan.physics.effects.rig import camera_offset
from mazeplan.physics.rig.sensors import Camera

FEWEST = 100
SMALLEST = 1e-4  # m; smallest offset to report
SURE = 15.0  # of -2 log L with its penalty
BLOCK = 30  # samples that count as one, because the ball stays at one wall of its channel for a while
Offset = tuple[float, float]  # x and y, m


def fit_circle(theta: Array, r: Array, rows: np.ndarray, known: Camera) -> tuple[Offset, Entry] | None:
    """The offset of the circle through measured (theta, r) of some rows, and the whole offset as an entry of the
    document: gain of -2 log L with its penalty, standard deviation of r without and with the offset, m.

    known: camera by which the positions of the circle are corrected already (`record.centred`)

    None if the offset is not significant or too small to report, if the rows are few, show only an arc, or have no
    scatter."""
    keep = rows & np.isfinite(theta) & np.isfinite(r)
    if keep.sum() < FEWEST:
        return None
    c, s, y = np.cos(theta[keep]), np.sin(theta[keep]), r[keep]
    X = np.column_stack([np.ones(len(y)), c, s])
    if np.linalg.cond(X) > 30.0:
        return None
    w, *_ = np.linalg.lstsq(X, y, rcond=None)
    left = y - X @ w
    before, after = float(np.std(y)), float(np.std(left))
    if not after > 0.0:  # these radii are nominal, not measured
        return None
    blocks = left[: len(left) // BLOCK * BLOCK].reshape(-1, BLOCK).mean(axis=1)
    together = float(np.var(blocks) * BLOCK / max(np.var(left), 1e-300)) if len(blocks) > 3 else 1.0
    share = max(1.0, together)  # neighbours are correlated: so many samples count as one
    n = len(y) / share
    evidence = n * float(np.log(before**2 / after**2)) - 2.0 * float(np.log(max(n, 2.0)))
    sigma = after * np.sqrt(share * np.diag(np.linalg.inv(X.T @ X)))
    offset, stderr = (float(w[1]), float(w[2])), (float(sigma[1]), float(sigma[2]))
    if not (evidence > SURE and float(np.hypot(*offset)) > max(SMALLEST, 3.0 * max(stderr))):
        return None
    had = {"x": known.offset_x, "y": known.offset_y}
    values = {axis: round(had[axis] + known.scale * v, 6) for axis, v in zip("xy", offset, strict=True)}
    errors = {axis: round(known.scale * v, 6) for axis, v in zip("xy", stderr, strict=True)}
    more = {"evidence": round(evidence, 1), "before": round(before, 6), "after": round(after, 6)}
    return offset, effect_entry(camera_offset, values, errors, had, **more)


def true_angle_at_radius(theta: Array, r: Array, offset: Offset) -> Array:
    """Angle about the true centre, on the same turn as theta."""
    x, y = r * np.cos(theta) - offset[0], r * np.sin(theta) - offset[1]
    turn = np.arctan2(y, x) - theta
    return theta + (turn + np.pi) % (2.0 * np.pi) - np.pi


def true_angle(theta: Array, radius: float, offset: Offset) -> Array:
    """Angle about the true centre, for a ball on a circle (radius, m) that a camera with an offset sees at theta."""
    return theta + np.arcsin(_sine(theta, radius, offset))


def seen_angle(phi: Array, radius: float, offset: Offset) -> Array:
    """Inverse of `true_angle`: the seen angle theta from the angle about the true centre, on the same turn."""
    x, y = offset
    c, s = np.cos(phi), np.sin(phi)
    return phi + np.arctan2(y * c - x * s, radius + x * c + y * s)


def true_angle_slope(theta: Array, radius: float, offset: Offset) -> Array:
    """Derivative of `true_angle` by theta."""
    x, y = offset
    sine = _sine(theta, radius, offset)
    return 1.0 + (x * np.cos(theta) + y * np.sin(theta)) / (radius * np.sqrt(1.0 - sine**2))


def _sine(theta: Array, radius: float, offset: Offset) -> Array:
    # only a search on its way tries offsets near the radius; the ball's circle then does not surround the camera
    return np.clip((offset[0] * np.sin(theta) - offset[1] * np.cos(theta)) / radius, -0.9, 0.9)
