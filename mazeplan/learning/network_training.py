"""Train the networks of a ball model with torch, alone or together with the parameters of effects.

Training begins with single rows: the loss is the mean square error of the acceleration. With effects, roll-outs follow.
They begin at the measured state and go along the measured tilt, as in `rollout`; derivatives go through the whole
roll-out. The loss

    mean of sqrt(e^2 + d^2) - d over all samples of the windows,    e: error of the angle, d = ROUND

counts large errors by their size and not by their squares, because impacts at edges cannot be predicted. Each member
leaves out a different fold of the record. The errors on these folds choose the moment to stop and give the noise. No
test row takes part.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from mazeplan.core.errors import SettingsError, TableError
from mazeplan.core.progress import Advance, Words, no_advance, no_words
from mazeplan.core.records import Array, IntArray
from mazeplan.learning.features import DRY_WIDTH, INPUT_SETS
from mazeplan.learning.networks import ARRAYS, Networks, expanded
from mazeplan.learning.rollout import FASTEST, uninterrupted
from mazeplan.learning.samples import LAG, RingSamples, columns_of
from mazeplan.learning.torch_device import require_torch
from mazeplan.physics.effect import OPENING, Term
from mazeplan.physics.formulas.arrays import RingKinematics, acceleration
from mazeplan.physics.formulas.compiled import ring_functions

if TYPE_CHECKING:
    import torch

ROUND = 0.03  # rad; below it, errors of the angle count by their squares
FOLD = 150  # rows of a piece of a fold; 5 s, like the blocks of a comparison
ROWS, WINDOWS = 256, 48  # rows and windows of a batch, for each member
LOOK = 20  # number of evaluations on the folds left out, in each of the two parts of the training
WIDE = 10.0  # one unit of the step of a parameter stands for so many of its smallest sizes
DECAY = 1e-2  # of the weights, relative to the rate of learning
FEWEST = 10  # minimum number of windows of a fold to choose the moment to stop


@dataclass(frozen=True)
class NetworkOptions:
    """Settings of the training. Raises SettingsError.

    members:  number of networks; each leaves out a different fold
    hidden:   number of units of a layer
    updates:  number of updates by single rows
    rolled:   number of updates by roll-outs
    horizon:  samples of a roll-out
    single:   weight of single rows in the updates by roll-outs
    rate:     learning rate"""

    members: int = 10
    hidden: int = 16
    updates: int = 2000
    rolled: int = 300
    horizon: int = 30
    single: float = 0.02
    rate: float = 3e-3

    def __post_init__(self) -> None:
        for name, least in (("members", 2), ("hidden", 1), ("updates", 1), ("rolled", 0), ("horizon", 1)):
            if not (isinstance(getattr(self, name), int) and getattr(self, name) >= least):
                raise SettingsError(f"got {getattr(self, name)!r}, expected a whole number >= {least}", key=name)


def train_networks(
    samples: RingSamples,
    rows: IntArray,
    terms: tuple[Term, ...],
    options: NetworkOptions,
    *,
    fitted: bool,
    inputs: str = "state",
    rates: str = "smoothed",
    known: Mapping[str, Mapping[str, float]] | None = None,
    seed: int = 0,
    progress: Words = no_words,
    advance: Advance = no_advance,
) -> tuple[tuple[Term, ...], Networks]:
    """The effects, and networks for the part of theta_dd that the effects leave unexplained.

    rows:    training rows, indices in order of time
    fitted:  also train the parameters of the effects, and on roll-outs
    rates:   of the samples, see `samples`
    known:   standard errors of parameters, {effect: {parameter: value}}

    Raises InputError without torch, TableError with too few rows."""
    require_torch()
    import torch

    if len(rows) < 2 * options.members:
        raise TableError(f"got {len(rows)} rows to train networks on, expected at least {2 * options.members}")
    threads = torch.get_num_threads()
    with torch.random.fork_rng(devices=[]):
        torch.set_num_threads(1)  # the matrices are small
        torch.manual_seed(seed)
        try:
            learner = _Learner(samples, rows, terms, options, inputs, rates, known or {} if fitted else None)
            total = options.updates + (20 * options.rolled if fitted else 0)  # a roll-out takes so much longer
            progress("training on single rows")
            learner.descend(learner.single, options.updates, options.rate, lambda n: advance(n, total))
            if fitted and learner.rollable and options.rolled:
                progress("training on roll-outs")
                rate = 0.3 * options.rate
                learner.descend(learner.both, options.rolled, rate, lambda n: advance(options.updates + 20 * n, total))
        finally:
            torch.set_num_threads(threads)
    return learner.terms(), learner.networks()


class _Learner:
    """Rows, windows, parameters and losses.

    A loss gives one number for each member, (E,): on drawn rows or windows if `drawn`, else on those left out."""

    def __init__(
        self, samples: RingSamples, rows: IntArray, terms: tuple[Term, ...], o: NetworkOptions, inputs: str, rates: str,
        known: Mapping[str, Mapping[str, float]] | None,
    ) -> None:  # fmt: skip
        """known: see `train_networks`; None: the effects stay as they are."""
        import torch

        self.o, self._given, self._inputs, self._delayed = o, terms, inputs, rates == "delayed"
        self._dt, self._rows, self._fitted = samples.dt, len(rows), known is not None
        k, target = samples.at(rows), samples.theta_ddot[rows]
        rest = target - acceleration(terms, k, DRY_WIDTH)
        self._spread = max(float(np.std(rest)), 1e-6)
        x = expanded(INPUT_SETS[inputs](k), inputs)
        self._centre, scale = x.mean(axis=0), np.maximum(x.std(axis=0), 1e-6)
        self._scale, self._x = scale, _tensor((x - self._centre) / scale)
        self._centre_t, self._scale_t = _tensor(self._centre), _tensor(scale)
        self._k, self._target = _tensors(k), _tensor(target)
        fold = np.arange(len(rows)) // max(1, min(FOLD, len(rows) // (2 * o.members))) % o.members
        self._own = _numbers(fold, o.members)
        self._others = [np.flatnonzero(fold != e) for e in range(o.members)]
        self._fixed = _tensor(target - rest)
        self._start_windows(samples, rows, fold)
        e, d, h = o.members, x.shape[1], o.hidden
        first, second = torch.randn(e, d, h) / math.sqrt(d), torch.randn(e, h, h) / math.sqrt(h)
        weights = [
            first,
            torch.zeros(e, 1, h),
            second,
            torch.zeros(e, 1, h),
            torch.zeros(e, h, 1),
            torch.zeros(e, 1, 1),
        ]
        self.weights = [w.requires_grad_() for w in weights]
        self._start = [number for term in terms for number in term.numbers]
        each = [(p, (known or {}).get(t.name, {}).get(name)) for t in terms for name, p in t.effect.parameters.items()]
        free = [0.0 if known is None or p.fixed else WIDE * (p.smallest or p.step) for p, _ in each]
        self._sizes = [min(size, size if sigma is None else sigma) for size, (_, sigma) in zip(free, each, strict=True)]
        self._bounds = [(p.low, p.high) for p, _ in each]
        self.steps = torch.zeros(len(each), requires_grad=True)
        along = [term.effect for term in terms if term.effect.acts != OPENING]
        self._formulas = ring_functions(along).vectorised(torch)

    def _start_windows(self, samples: RingSamples, rows: IntArray, fold: IntArray) -> None:
        """Find the first rows of windows for each member: of windows outside its fold, and of windows inside it."""
        usable, number = np.zeros(len(samples), bool), np.full(len(samples), -1)
        usable[rows], number[rows] = True, fold
        span = self.o.horizon + 1
        first = uninterrupted(usable & samples.good, samples.segment, self.o.horizon)
        first = first[(first > LAG) & (samples.segment[first] == samples.segment[np.maximum(first - LAG - 1, 0)])]
        touched = number[first[:, None] + np.arange(span)] if len(first) else np.zeros((0, span))
        self._free = [first[(touched != e).all(axis=1)] for e in range(self.o.members)]
        inside = [first[(touched == e).all(axis=1)] for e in range(self.o.members)]
        self.rollable = min(map(len, self._free)) > 0 and min(map(len, inside)) >= FEWEST
        least = min(map(len, inside))
        spread = [some[np.linspace(0, len(some) - 1, min(least, 4 * WINDOWS)).astype(int)] for some in inside if least]
        self._inside = np.array(spread)
        self._samples = samples

    def numbers(self) -> list[Any]:
        """The parameters of the effects: tensors inside their bounds, or plain numbers if they are fixed."""
        bounded = zip(self._start, self._sizes, self._bounds, self.steps, strict=True)
        return [start if size == 0.0 else (start + size * z).clip(*b) for start, size, b, z in bounded]

    def _net(self, z: torch.Tensor) -> torch.Tensor:
        """Each member at scaled inputs (E, B, D), rad/s^2: (E, B)."""
        import torch

        w1, b1, w2, b2, w3, b3 = self.weights
        h = torch.baddbmm(b1, z, w1).tanh()
        h = torch.baddbmm(b2, h, w2).tanh()
        return torch.baddbmm(b3, h, w3)[..., 0] * self._spread

    def single(self, drawn: bool) -> torch.Tensor:
        """Mean square error of theta_dd in units of its spread, on drawn rows or on those left out."""
        which = _drawn(self._others, ROWS) if drawn else self._own
        there = which >= 0
        which = which.clip(min=0)
        base = self._fixed[which]
        if self._fitted:
            k: Any = _at(self._k, which)
            plate, p = self._plate(k)
            base = self._formulas["value"](k.theta, k.theta_dot, k.theta.sin(), k.theta.cos(), plate, p)
        error = (base + self._net(self._x[which]) - self._target[which]) / self._spread
        return (error**2 * there).sum(1) / there.sum(1)

    def _plate(self, k: RingKinematics) -> tuple[list[Any], list[Any]]:
        """Coefficients of the plate, and the parameters of the effects as the formulas take them."""
        p = [DRY_WIDTH, *self.numbers()]
        return self._formulas["plate"](0.0, k.plate, p), p

    def both(self, drawn: bool) -> torch.Tensor:
        """Error of roll-outs, rad; on drawn windows, with a small share of the error of single rows."""
        start = _drawn_rows(self._free, WINDOWS) if drawn else self._inside
        error = self.rolled(start)
        loss = ((error**2 + ROUND**2).sqrt() - ROUND).mean((1, 2))
        held = 1e-4 * (self.steps**2).sum()  # effects stay near their start unless data move them
        return loss + self.o.single * self.single(True) + held if drawn else loss

    def rolled(self, start: IntArray) -> torch.Tensor:
        """Errors of the angle (E, W, T), rad, in roll-outs from rows (E, W): see `rollout`."""
        import torch

        s, dt, span = self._samples, self._dt, np.arange(self.o.horizon + 1)
        at = start[..., None] + span
        k: Any = replace(s.k, **{name: _tensor(getattr(s.k, name)[at]) for name in columns_of(s.k)})
        plate, p = self._plate(k)

        def accelerate(i: int, theta: torch.Tensor, rate: torch.Tensor) -> torch.Tensor:
            now = replace(k, **{name: getattr(k, name)[..., i] for name in columns_of(k)})
            now = replace(now, theta=theta, theta_dot=rate)
            coefficients = [c[..., i] if isinstance(c, torch.Tensor) and c.ndim == 3 else c for c in plate]
            base = self._formulas["value"](theta, rate, theta.sin(), theta.cos(), coefficients, p)
            x = expanded(INPUT_SETS[self._inputs](now, torch), self._inputs, torch)
            return base + self._net((x - self._centre_t) / self._scale_t)

        if self._delayed:
            past = [_tensor(s.measured[start + j]) for j in range(-LAG - 1, 1)]
            rate = _tensor((s.measured[start + 1] - s.measured[start - 1]) / (2.0 * dt))
            angles = _late(accelerate, past, rate, self.o.horizon, dt)
        else:
            angles = _heun(accelerate, k.theta[..., 0], k.theta_dot[..., 0], self.o.horizon, dt)
        return torch.stack(angles, -1) - k.theta[..., 1:]

    def descend(self, loss: Callable[[bool], Any], updates: int, rate: float, advance: Callable[[float], None]) -> None:
        """Train by Adam with a falling rate. Keeps the parameters with the smallest loss on the rows left out."""
        import torch

        ways = [{"params": self.weights, "weight_decay": DECAY}, {"params": [self.steps], "weight_decay": 0.0}]
        adam = torch.optim.AdamW(ways, lr=rate)
        falling = torch.optim.lr_scheduler.CosineAnnealingLR(adam, updates, 0.02 * rate)
        every, best, kept = max(1, updates // LOOK), math.inf, []
        for n in range(updates + 1):
            if n % every == 0 or n == updates:
                with torch.no_grad():
                    now = float(loss(False).mean())
                if now < best:
                    best, kept = now, [w.detach().clone() for w in (*self.weights, self.steps)]
                advance(n)
            if n < updates:
                adam.zero_grad()
                loss(True).sum().backward()
                torch.nn.utils.clip_grad_norm_([*self.weights, self.steps], 1.0)
                adam.step()
                falling.step()
        with torch.no_grad():
            for w, good in zip((*self.weights, self.steps), kept, strict=bool(kept)):
                w.copy_(good)

    def terms(self) -> tuple[Term, ...]:
        """The effects with their trained parameters."""
        import torch

        with torch.no_grad():
            numbers = iter([float(number) for number in self.numbers()])
        return tuple(Term(term.effect, tuple(next(numbers) for _ in term.numbers)) for term in self._given)

    def networks(self) -> Networks:
        """The trained networks, for unscaled inputs; noise: of the rows that a member has left out."""
        import torch

        with torch.no_grad():
            noise = self._spread * math.sqrt(float(self.single(False).mean()))
        w1, b1, w2, b2, w3, b3 = (w.detach().numpy().astype(np.float64) for w in self.weights)
        first = w1 / self._scale[None, :, None]
        bias = b1[:, 0] - np.einsum("d,edh->eh", self._centre, first)
        last, end = w3[..., 0] * self._spread, b3[:, 0, 0] * self._spread
        arrays = dict(zip(ARRAYS, (first, bias, w2, b2[:, 0], last, end), strict=True))
        return Networks(**arrays, noise=max(noise, 1e-9), rows=self._rows, inputs=self._inputs)


def _heun(accelerate: Any, theta: Any, rate: Any, steps: int, dt: float) -> list[Any]:
    """Angles after 1 to `steps` samples, as in `rollout.roll_out`."""
    angles, before = [], accelerate(0, theta, rate)
    for i in range(1, steps + 1):
        after = accelerate(i, theta + dt * rate + 0.5 * dt * dt * before, rate + dt * before)
        theta = theta + dt * rate + dt * dt * (before / 3.0 + after / 6.0)
        rate = (rate + 0.5 * dt * (before + after)).clip(-FASTEST, FASTEST)
        angles.append(theta)
        before = accelerate(i, theta, rate) if i < steps else before
    return angles


def _late(accelerate: Any, past: list[Any], rate: Any, steps: int, dt: float) -> list[Any]:
    """Angles after 1 to `steps` samples, as in `rollout.roll_out_delayed`; past: LAG + 2 angles up to now."""
    angles = list(past)
    for i in range(steps):
        felt = accelerate(i, angles[-1], (angles[-1 - LAG] - angles[-2 - LAG]) / dt)
        rate = (rate + (0.5 if i == 0 else 1.0) * dt * felt).clip(-FASTEST, FASTEST)
        angles.append(angles[-1] + dt * rate)
    return angles[len(past) :]


def _tensor(values: Array) -> Any:
    import torch

    return torch.tensor(np.ascontiguousarray(values), dtype=torch.float32)


def _tensors(k: RingKinematics) -> RingKinematics:
    return replace(k, **{name: _tensor(getattr(k, name)) for name in columns_of(k)})


def _at(k: RingKinematics, which: torch.Tensor) -> RingKinematics:
    return replace(k, **{name: getattr(k, name)[which] for name in columns_of(k)})


def _numbers(fold: IntArray, members: int) -> torch.Tensor:
    """The rows of each fold (E, N), filled up with -1."""
    import torch

    found = [np.flatnonzero(fold == e) for e in range(members)]
    out = np.full((members, max(map(len, found))), -1)
    for e, some in enumerate(found):
        out[e, : len(some)] = some
    return torch.tensor(out)


def _drawn_rows(some: list[IntArray], count: int) -> IntArray:
    """`count` random rows of each of E lists, (E, count); drawn by torch, so that its seed decides."""
    import torch

    return np.stack([own[torch.randint(len(own), (count,)).numpy()] for own in some])


def _drawn(some: list[IntArray], count: int) -> torch.Tensor:
    import torch

    return torch.tensor(_drawn_rows(some, count))
