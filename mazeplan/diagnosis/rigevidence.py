"""What a report of a whole rig shows beside its document: plain data, as a file (evidence.json) beside report.json."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from mazeplan.diagnosis.bodyverdict import AS_BEFORE, MEMORY, BodyVerdict
from mazeplan.estimation.bodyfilter import BodyModel, Filtered, Pictures
from mazeplan.estimation.bodyfit import BLOCK_S, autocorrelation
from mazeplan.estimation.bodynumbers import value_of
from mazeplan.maze.geometry import Maze
from mazeplan.records import Array

CELLS = 40  # of the map of what is left, along each side
FEWEST = 4  # pictures in a cell that is drawn
LAGS = 10  # pictures
FASTEST, BANDS = 8.0, 160  # Hz; bands of the spectrum that are told
PARTS = ("before", "after")


def rig_evidence(done: BodyVerdict, maze: Maze, map_text: str, title: str) -> dict[str, Any]:
    """Errors by samples ahead (rad), gain by blocks of time, what is left by place and from picture to picture."""
    found, pictures = done.searched, done.body.pictures
    parts = {"before": found.first.filtered, "after": found.fit.filtered}
    reach = max(ring.outer_radius for ring in maze.rings)
    counted = max(int(np.isfinite(parts["after"].nu[:, 0]).sum()), 1)
    gain = done.held.gain.tolist()
    return {
        "kind": "rig", "title": title, "map": map_text, "reach": reach,
        "ahead_s": (pictures.dt * np.arange(1, len(done.held.before) + 1)).round(4).tolist(),
        "error": {when: _rounded(np.nanmean(getattr(done.held, when), axis=1)) for when in PARTS},
        **{
            name: {when: _rounded(np.nanquantile(getattr(done.held, when), share, axis=1)) for when in PARTS}
            for name, share in (("low", 0.25), ("quartile", 0.75))
        },
        "block_s": BLOCK_S, "gain_t": _block_times(pictures, len(gain)),
        "gain": [round(float(g), 2) for g in gain] if any(gain) else [],
        "left": {when: _by_place(filtered, reach) for when, filtered in parts.items()},
        "marks": _marks(done.effects, found.fit.model),
        "correlation": {when: _rounded(autocorrelation(filtered, LAGS)) for when, filtered in parts.items()},
        "white": round(2.0 / math.sqrt(2.0 * counted), 5),
        "alike_from": round(max(MEMORY, AS_BEFORE * done.was.memory), 4),
        "spectrum": _spectra(done, parts),
        "remaining": {"then": round(done.was.remaining, 3), "after": round(done.remaining, 3)},
    }  # fmt: skip


def _rounded(values: Array) -> list[float | None]:
    return [round(float(v), 5) if math.isfinite(v) else None for v in values]


def _true_time(pictures: Pictures) -> Array:
    """Of each picture, s from the first one on."""
    t = pictures.t if pictures.clock is None else pictures.clock
    return np.asarray(t - t[0], dtype=float)


def _block_times(pictures: Pictures, count: int) -> list[float]:
    """True time of the middle of each block, s."""
    t, each = _true_time(pictures), round(BLOCK_S / pictures.dt)
    return [round(float(t[min(i * each + each // 2, len(t) - 1)]), 2) for i in range(count)]


def _by_place(filtered: Filtered, reach: float) -> list[list[float | None]]:
    """How large what a filter did not expect was, in its standard deviations, root mean square in cells of the plate;
    rows are y, from -reach on."""
    keep = np.isfinite(filtered.nu[:, 0])
    size = np.mean(filtered.whitened() ** 2, axis=1)
    x, y = filtered.state[keep, :2].T
    edges = np.linspace(-reach, reach, CELLS + 1)
    counts, *_ = np.histogram2d(y, x, (edges, edges))
    sums, *_ = np.histogram2d(y, x, (edges, edges), weights=size)
    with np.errstate(invalid="ignore", divide="ignore"):
        mean = np.where(counts >= FEWEST, np.sqrt(sums / counts), np.nan)
    return [[round(float(v), 2) if math.isfinite(v) else None for v in row] for row in mean]


def _marks(effects: tuple[dict[str, Any], ...], model: BodyModel) -> list[dict[str, Any]]:
    """Where on the plate found effects are: m and rad. A spot has x, y, radius; a sector middle, half, inner, outer."""
    terms = {
        "surface_bump": ("floor_bump", ("x", "y", "width")),
        "local_friction": ("floor_dirt", ("centre", "half", "inner", "outer")),
        "gate_loss": ("floor_kerb", ("centre", "inner", "outer")),
    }  # fmt: skip
    marks = []
    for name in (e["name"] for e in effects if e["name"] in terms):
        term, keys = terms[name]
        marks.append({"name": name, **{key: round(float(value_of(model, f"{term}.{key}")), 5) for key in keys}})
    return marks


def _spectra(done: BodyVerdict, parts: dict[str, Filtered]) -> dict[str, list[float]] | None:
    """Of what was not expected, against true time; noise alone has 1 on average. None where nothing may swing."""
    if done.unknown is None and not any(e["name"] == "table_rocking" for e in done.effects):
        return None
    t = _true_time(done.body.pictures)
    span = float(t[-1] - t[0])
    tried = np.arange(1.0 / span, min(FASTEST, 0.45 / done.body.pictures.dt), 0.5 / span)
    bands = np.array_split(np.arange(len(tried)), min(BANDS, len(tried)))
    out = {"hz": [round(float(tried[band].mean()), 4) for band in bands]}
    for when, filtered in parts.items():
        power = _power(tried, t[np.isfinite(filtered.nu[:, 0])], filtered.whitened())
        out[when] = [round(float(power[band].max()), 2) for band in bands]
    return out


def _power(hz: Array, t: Array, e: Array) -> Array:
    """Periodogram (F,) of numbers e (K, 2) of variance 1 at uneven times t (K,), mean of both; 1 for white noise."""
    power = np.zeros(len(hz))
    for start in range(0, len(hz), 200):
        turn = np.exp(-2j * math.pi * np.outer(hz[start : start + 200], t))
        power[start : start + 200] = np.mean(np.abs(turn @ e) ** 2, axis=1)
    return power / (len(t) * float(np.mean(e * e)))
