"""Screening: how much one linear step of each candidate would lower the error of the windows that are fitted."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from mazeplan.core.records import Array
from mazeplan.diagnosis.effect_entry import Values
from mazeplan.diagnosis.engine.windows import Free, Windows

BEST = 3  # starts of a candidate that are fitted
PEAK = 18.0  # minimum peak of the periodogram over its mean: 1e-8 by chance in a frequency, 1e-4 in a record

if TYPE_CHECKING:
    from mazeplan.diagnosis.engine.search import Search, Trial


def forecast(search: Search, current: Trial, candidates: Sequence[str]) -> dict[str, float]:
    """The forecast gain of each candidate, over two levels."""
    search.tell("screening")
    gains: dict[str, list[Array]] = {name: [] for name in candidates}
    starts = {name: starts_of(search, current, name) for name in candidates}
    for level in sorted({0, len(search.levels) // 2}):
        windows, fit = search.levels[level].folds[0], current.fits[level][0]
        base = _Linear(windows, fit.values, fit.states, fit.free)
        for name, ways in starts.items():
            free = tuple(key for key in search.free([name]) if key not in fit.free)
            gains[name].append(np.array([base.gain({**fit.values, name: way}, free) for way in ways]))
    out = {}
    for name, ways in starts.items():
        total = np.sum(gains[name], axis=0) if ways else np.zeros(1)
        out[name] = float(total.max())
        if search.model.effects[name].places and ways:
            search.starts[name] = [ways[i] for i in np.argsort(-total)[:BEST]]
    return out


def starts_of(search: Search, current: Trial, name: str) -> list[dict[str, float]]:
    """Values of a candidate at each of its starts."""
    effect = search.model.effects[name]
    plain = search.values([name])[name]
    if not effect.places:
        return [plain]
    guesses = effect.first_guesses()
    if effect.places == ("frequency",):
        guesses = [(f,) for f in peaks(search, current)]
    return [plain | dict(zip(effect.parameters, s, strict=False)) for s in guesses]


def peaks(search: Search, current: Trial) -> list[float]:
    """Frequencies (Hz) of the highest peaks in the spectrum of the residual, one for each level."""
    t, out = search.model.record.t, []
    for one, two in current.fits:
        e = np.where(np.isfinite(one.residual), one.residual, two.residual)[:, 0]
        good = np.isfinite(e)
        power = np.abs(np.fft.rfft(np.where(good, e - np.mean(e[good]), 0.0)))[1:] ** 2
        if power.max() > PEAK * power.mean():
            out.append(float(np.fft.rfftfreq(len(e), float(np.median(np.diff(t))))[1 + int(np.argmax(power))]))
    return list(dict.fromkeys(out))


class _Linear:
    """The windows near a fit: residual and its derivatives."""

    def __init__(self, windows: Windows, values: Values, states: Array, free: Free) -> None:
        self.windows, self.states = windows, states
        self.r = windows.residual(values, states)
        self.by_p, self.by_s = windows.columns(values, states, self.r, free)
        self.cost = windows.sums(self.clean(self.r[:, None])[:, 0] ** 2)
        self.clean_p = self.clean(self.by_p)

    def clean(self, x: Array) -> Array:
        """Columns (K, P) without what initial states can copy."""
        (s,) = self.windows.eliminated(self.by_s, x)
        return x - np.einsum("ks,ksp->kp", self.by_s, s[self.windows.which])

    def gain(self, values: Values, free: Free) -> float:
        """The forecast gain of a candidate from its start."""
        r = self.windows.residual(values, self.states)
        by_p, _ = self.windows.columns(values, self.states, r, free, by_states=False)
        if not (np.isfinite(r).all() and np.isfinite(by_p).all()):
            return 0.0
        left = self.clean(r[:, None])[:, 0]
        columns = np.hstack([self.clean_p, self.clean(by_p)])
        columns /= np.maximum(np.linalg.norm(columns, axis=0), 1e-300)
        left = left - columns @ np.linalg.lstsq(columns, left, rcond=1e-10)[0]
        n = self.windows.count
        price = 0.5 * len(free) * np.log(len(n)) / len(n)  # more parameters always fit better
        return float(np.mean(0.5 * np.log((self.cost + n) / (self.windows.sums(left**2) + n)))) - price
