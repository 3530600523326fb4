"""An ensemble of small networks for theta_dd, or for the residual of the effects: prediction without torch.

    f_e(x) = w . tanh(W2 tanh(W1 z + b1) + b2) + b      one member, z: `expanded` inputs
    f(x)   = mean of f_e,    variance = variance of f_e over the members + noise^2

The inputs come from those of a Gaussian process. The angle enters by sine and cosine of 1, 2, 4 and 8 times the angle,
because forces at openings are narrow. `network_training` trains the networks; the compiled functions are for control. A
packed ensemble begins with a negative number, a packed Gaussian process with a positive number (`learned_part`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numba import njit

from mazeplan.core.errors import ModelError
from mazeplan.core.records import Array
from mazeplan.physics.formulas.functions import tanh

KEPT = {"state": (0, 1, 2, 5, 7), "local": (0, 3, 4, 5, 6, 7, 8)}  # columns, by the name of the inputs
TURNED = {"state": (3, 4), "local": (1, 2)}  # columns of sine and cosine of the angle
HARMONICS = 4  # 1, 2, 4 and 8 times the angle
WIDTH = {name: len(columns) + 2 * HARMONICS for name, columns in KEPT.items()}
_MEMBERS, _HIDDEN, _WEIGHTS = 0, 1, 2
D = WIDTH["state"]
ARRAYS = ("first", "first_bias", "second", "second_bias", "last", "last_bias")


def expanded(x: Any, inputs: str, xp: Any = np) -> Any:
    """Inputs of the networks (..., D) from those of `features.INPUT_SETS` (..., 9 or 11); xp: numpy or torch."""
    columns = [x[..., i] for i in KEPT[inputs]]
    sine, cosine = (x[..., i] for i in TURNED[inputs])
    for _ in range(HARMONICS):
        columns += [sine, cosine]
        sine, cosine = 2.0 * sine * cosine, cosine * cosine - sine * sine
    return xp.stack(columns, -1)


@dataclass(frozen=True, eq=False)
class Networks:
    """E networks with H units in each of two layers. Raises ModelError for shapes that do not fit.

    first (E, D, H), first_bias (E, H):    weights of the first layer
    second (E, H, H), second_bias (E, H):  weights of the second layer
    last (E, H), last_bias (E,):           weights of the output, for rad/s^2
    noise:                                 standard deviation of a sample, rad/s^2
    rows:                                  number of training rows
    inputs:                                a name in INPUT_SETS"""

    first: Array
    first_bias: Array
    second: Array
    second_bias: Array
    last: Array
    last_bias: Array
    noise: float
    rows: int
    inputs: str = "state"

    def __post_init__(self) -> None:
        if self.inputs not in WIDTH:
            raise ModelError(f"got {self.inputs!r}, expected one of {', '.join(WIDTH)}", key="inputs")
        e, h = self.last.shape if self.last.ndim == 2 else (0, 0)
        shapes = ((e, WIDTH[self.inputs], h), (e, h), (e, h, h), (e, h), (e, h), (e,))
        for name, shape in zip(ARRAYS, shapes, strict=True):
            array = getattr(self, name)
            if array.shape != shape or not array.size or not np.isfinite(array).all():
                raise ModelError(f"got shape {array.shape}, expected {shape}, finite and not empty", key=name)
        if not 0.0 < self.noise < math.inf:
            raise ModelError(f"got {self.noise}, expected a number > 0", key="noise")

    def __len__(self) -> int:
        """Number of training rows, as for a Gaussian process."""
        return self.rows

    def told_as(self) -> tuple[str, dict[str, Any]]:
        """Name and fields for `maths.fingerprint`."""
        return "Networks", {f.name: getattr(self, f.name) for f in fields(self)}

    def each(self, x: Array) -> Array:
        """The value of each member (E, N) at inputs (N, 9 or 11), rad/s^2."""
        z = expanded(x, self.inputs)
        h = np.tanh(z @ self.first + self.first_bias[:, None])
        h = np.tanh(h @ self.second + self.second_bias[:, None])
        return np.einsum("enh,eh->en", h, self.last) + self.last_bias[:, None]

    def mean(self, x: Array, features: None = None) -> Array:
        """Mean of the members (N,) at inputs (N, 9 or 11), rad/s^2; features: unused, see `GaussianProcess.mean`."""
        return self.each(x).mean(axis=0)

    def variance(self, x: Array) -> Array:
        """Variance of a sample (N,), (rad/s^2)^2: variance over the members plus noise^2."""
        return self.each(x).var(axis=0) + self.noise**2


def pack(networks: Networks) -> Array:
    """The vector for the compiled functions. Raises ModelError for inputs other than the state."""
    if networks.inputs != "state":
        raise ModelError(f"got {networks.inputs!r}, expected state: planning knows nothing else", key="inputs")
    members, hidden = networks.last.shape
    arrays = [getattr(networks, name) for name in ARRAYS]
    by_member = [np.concatenate([array[e].ravel() for array in arrays]) for e in range(members)]
    return np.concatenate([[-float(members), float(hidden)], *by_member])


@njit(cache=True, error_model="numpy")
def _place(s, z):
    """Write the inputs of the state s (6,) into z (D,)."""
    z[0], z[1], z[2], z[3], z[4] = s[1], s[3], s[5], math.sin(s[2]), math.sin(s[4])
    sine, cosine = math.sin(s[0]), math.cos(s[0])
    for i in range(HARMONICS):
        z[5 + 2 * i], z[6 + 2 * i] = sine, cosine
        sine, cosine = 2.0 * sine * cosine, cosine * cosine - sine * sine


@njit(cache=True, error_model="numpy")
def _by_state(s, z, g, out):
    """Write the derivatives by the state into out (6,), from those by the inputs z (D,), g (D,)."""
    out[0] = 0.0
    for i in range(HARMONICS):
        out[0] += 2.0**i * (g[5 + 2 * i] * z[6 + 2 * i] - g[6 + 2 * i] * z[5 + 2 * i])
    out[1], out[3], out[5] = g[0], g[1], g[2]
    out[2], out[4] = g[3] * math.cos(s[2]), g[4] * math.cos(s[4])


@njit(cache=True, error_model="numpy", fastmath=True)
def _member(p, at, h, z, one, two, g, wanted):
    """Value of the member packed at `at`; if `wanted`, its derivatives by z into g (D,). one, two (H,): scratch."""
    first = p[at : at + D * h]
    second = p[at + D * h + h : at + D * h + h + h * h]
    b2 = at + D * h + h + h * h
    last, value = p[b2 + h : b2 + 2 * h], p[b2 + 2 * h]
    one[:] = p[at + D * h : at + D * h + h]
    two[:] = p[b2 : b2 + h]
    for d in range(D):
        row, scale = first[d * h : d * h + h], z[d]
        for j in range(h):
            one[j] += scale * row[j]
    for j in range(h):
        one[j] = tanh(one[j])
    for i in range(h):
        row, scale = second[i * h : i * h + h], one[i]
        for j in range(h):
            two[j] += scale * row[j]
    for j in range(h):
        two[j] = tanh(two[j])
        value += last[j] * two[j]
        two[j] = last[j] * (1.0 - two[j] * two[j])
    if wanted:
        for i in range(h):
            row, slope = second[i * h : i * h + h], 0.0
            for j in range(h):
                slope += row[j] * two[j]
            one[i] = slope * (1.0 - one[i] * one[i])
        for d in range(D):
            row, slope = first[d * h : d * h + h], 0.0
            for j in range(h):
                slope += row[j] * one[j]
            g[d] = slope
    return value


@njit(cache=True, error_model="numpy")
def members(p, at, s, values, slopes, wanted):
    """Each member at the state s (6,) into values (E,); if `wanted`, derivatives by s into slopes (E, 6)."""
    h = int(p[at + _HIDDEN])
    size = D * h + h + h * h + h + h + 1
    z, g, one, two = np.empty(D), np.empty(D), np.empty(h), np.empty(h)
    _place(s, z)
    for e in range(len(values)):
        values[e] = _member(p, at + _WEIGHTS + e * size, h, z, one, two, g, wanted)
        if wanted:
            _by_state(s, z, g, slopes[e])


@njit(cache=True, error_model="numpy")
def mean_and_gradient(p, at, s, by_state, wanted):
    """Mean of the members at the state s (6,); if `wanted`, its derivatives by s into by_state (6,)."""
    count = int(-p[at + _MEMBERS])
    values, slopes = np.empty(count), np.zeros((count, 6))
    members(p, at, s, values, slopes, wanted)
    if wanted:
        for j in range(6):
            by_state[j] = slopes[:, j].mean()
    return values.mean()


@njit(cache=True, error_model="numpy")
def variance_and_derivatives(p, at, s, by_state, bend):
    """Variance over the members at the state s (6,), (rad/s^2)^2.

    Writes its derivatives by s into by_state (6,), and the diagonal of its Gauss-Newton Hessian into bend (6,)."""
    count = int(-p[at + _MEMBERS])
    values, slopes = np.empty(count), np.zeros((count, 6))
    members(p, at, s, values, slopes, True)
    middle = values.mean()
    for j in range(6):
        slope = slopes[:, j].mean()
        by_state[j] = bend[j] = 0.0
        for e in range(count):
            by_state[j] += 2.0 * (values[e] - middle) * (slopes[e, j] - slope) / count
            bend[j] += 2.0 * (slopes[e, j] - slope) ** 2 / count
    return values.var()
