"""A policy made by hand, without any training: one linear layer that rolls the ball to its opening and pushes."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from mazeplan.control.policy import INPUTS, KNOWN, Policy

LIMIT = 0.0873


def hand_made(reach: float = 1e3, **rows: tuple[float, float]) -> Policy:
    """Tilts out and along as shares of the limit, for each input by its name; reach: scaled distance called 1."""
    rows = rows or {"near": (0.0, 0.8), "speed_along": (0.0, -12.0), "inwards": (-1.2, 0.0), "off": (-4.0, 0.0)}
    weights = np.zeros((2, len(INPUTS)), dtype=np.float32)
    for name, row in rows.items():
        weights[:, INPUTS.index(name)] = row
    bias = np.array([0.6, 0.0] if "inwards" in rows else [0.0, 0.0], dtype=np.float32)
    zero, one = np.zeros(len(INPUTS), dtype=np.float32), np.ones(len(INPUTS), dtype=np.float32)
    centres = np.zeros((1, KNOWN), dtype=np.float32)
    return Policy(((weights, bias),), zero, one, centres, reach, LIMIT, {"rig": "none"})


def drawn(seed: int, hidden: tuple[int, ...] = (16, 8), centres: int = 20) -> Policy:
    """A policy of random numbers."""
    rng, sizes = np.random.default_rng(seed), (len(INPUTS), *hidden, 2)

    def single(*shape: int) -> np.ndarray:
        return rng.normal(size=shape).astype(np.float32)

    layers = tuple((single(o, i) / np.float32(i**0.5), single(o)) for i, o in pairwise(sizes))
    scale = np.exp(single(len(INPUTS)))
    return Policy(layers, single(len(INPUTS)), scale, single(centres, KNOWN), 0.7, LIMIT, {"seed": seed})
