"""Evidence for a rig's verdict as plain data: `evidence.json` beside `report.json`. A report draws it."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from mazeplan.control.estimation.rigid_body_filter import BallPictures, BodyModel, Filtered
from mazeplan.control.estimation.rigid_body_fit import BLOCK_S, autocorrelation
from mazeplan.control.estimation.rigid_body_parameters import value_of
from mazeplan.core.records import Array
from mazeplan.diagnosis.rig.result import RigVerdict
from mazeplan.diagnosis.rig.verdict import AS_BEFORE, MEMORY
from mazeplan.maze.geometry import Maze

SECTORS = 24  # of each ring in the map of errors
FEWEST = 3  # minimum number of roll-outs in a sector that is drawn
MAPPED = 20  # samples ahead of the errors in the map
LAGS = 10  # pictures
FASTEST, BANDS = 8.0, 160  # Hz; bands of the spectrum
PARTS = ("before", "after")


def rig_evidence(done: RigVerdict, maze: Maze, map_text: str, title: str) -> dict[str, Any]:
    """Errors by samples ahead (rad) and by place (m), gain by blocks of time, correlations of the innovations."""
    found, pictures = done.searched, done.body.pictures
    parts = {"before": found.without.filtered, "after": found.fit.filtered}
    counted = max(int(np.isfinite(parts["after"].nu[:, 0]).sum()), 1)
    gain = done.held.gain.tolist()
    return {
        "kind": "rig", "title": title, "map": map_text,
        "ahead_s": (pictures.dt * np.arange(1, len(done.held.before) + 1)).round(4).tolist(),
        "error": {when: _rounded(np.nanmean(getattr(done.held, when), axis=1)) for when in PARTS},
        **{
            name: {when: _rounded(np.nanquantile(getattr(done.held, when), share, axis=1)) for when in PARTS}
            for name, share in (("low", 0.1), ("high", 0.9))
        },
        "block_s": BLOCK_S, "gain_t": _block_times(pictures, len(gain)),
        "gain": [round(float(g), 2) for g in gain] if any(gain) else [],
        "places": _by_place(done, maze), "marks": _marks(done.effects, found.fit.model),
        "correlation": {when: _rounded(autocorrelation(filtered, LAGS)) for when, filtered in parts.items()},
        "white": round(2.0 / math.sqrt(2.0 * counted), 5),
        "alike_from": round(max(MEMORY, AS_BEFORE * done.was.memory), 4),
        "spectrum": _spectra(done, parts),
        "remaining": {"then": round(done.was.remaining, 3), "after": round(done.remaining, 3)},
    }  # fmt: skip


def _rounded(values: Array) -> list[float | None]:
    return [round(float(v), 5) if math.isfinite(v) else None for v in values]


def _true_time(pictures: BallPictures) -> Array:
    """Time of each picture, s from the first one on."""
    t = pictures.t if pictures.clock is None else pictures.clock
    return np.asarray(t - t[0], dtype=float)


def _block_times(pictures: BallPictures, count: int) -> list[float]:
    """True time of the middle of each block, s."""
    t, each = _true_time(pictures), round(BLOCK_S / pictures.dt)
    return [round(float(t[min(i * each + each // 2, len(t) - 1)]), 2) for i in range(count)]


def _by_place(done: RigVerdict, maze: Maze) -> dict[str, Any]:
    """Mean error along the track (m), MAPPED samples ahead on held-out pictures, by sectors of the rings from -pi on.

    An error belongs to the sector in which the ball was after half of these samples."""
    held, rings = done.held, [ring for ring in maze.rings if ring.track_radius]
    x, y = done.searched.without.filtered.state[held.starts + MAPPED // 2, :2].T
    r, sector = np.hypot(x, y), ((np.arctan2(y, x) + math.pi) / (2.0 * math.pi) * SECTORS).astype(int) % SECTORS
    out: dict[str, Any] = {"ahead": MAPPED, "rings": [[ring.inner_radius, ring.outer_radius] for ring in rings]}
    for when in PARTS:
        error = getattr(held, when)[MAPPED - 1]
        out[when] = []
        for ring in rings:
            here = np.isfinite(error) & (r > ring.inner_radius) & (r < ring.outer_radius)
            counts = np.bincount(sector[here], minlength=SECTORS)
            sums = np.bincount(sector[here], weights=error[here], minlength=SECTORS)
            mean = maze.track_radius(ring.number) * sums / np.maximum(counts, 1)
            out[when].append(_rounded(np.where(counts >= FEWEST, mean, np.nan)))
    return out


def _marks(effects: tuple[dict[str, Any], ...], model: BodyModel) -> list[dict[str, Any]]:
    """Places of effects on the plate, m and rad: a spot has x, y, width; a sector centre, half, inner, outer."""
    terms = {
        "surface_bump": ("floor_bump", ("x", "y", "width")),
        "local_friction": ("floor_dirt", ("centre", "half", "inner", "outer")),
        "gate_loss": ("floor_kerb", ("centre", "inner", "outer")),
    }
    marks = []
    for name in (e["name"] for e in effects if e["name"] in terms):
        term, keys = terms[name]
        marks.append({"name": name, **{key: round(float(value_of(model, f"{term}.{key}")), 5) for key in keys}})
    return marks


def _spectra(done: RigVerdict, parts: dict[str, Filtered]) -> dict[str, list[float]] | None:
    """Spectra of the innovations by true time, 1 on average for noise.

    None unless something unknown or a rocking table was found."""
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
    """Periodogram (F,), mean of both columns of e (K, 2), at uneven times t (K,); 1 for white noise."""
    power = np.zeros(len(hz))
    for start in range(0, len(hz), 200):
        turn = np.exp(-2j * math.pi * np.outer(hz[start : start + 200], t))
        power[start : start + 200] = np.mean(np.abs(turn @ e) ** 2, axis=1)
    return power / (len(t) * float(np.mean(e * e)))
