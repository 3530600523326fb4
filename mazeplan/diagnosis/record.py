"""From a table to a record that can be diagnosed: rows of one ring on a clock of their own, oddities named."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from mazeplan.data.table import Table, stretches
from mazeplan.errors import TableError
from mazeplan.models.samples import SampleOptions, orientation, ring_samples
from mazeplan.physics.sensors import Camera
from mazeplan.records import Array

FROZEN = 15  # equal measurements in a row that no ball and no camera give
FEWEST = 300  # samples of the ball
STILL = 3e-3  # rad; a plate that tilts by less tells nothing


@dataclass(frozen=True)
class Record:
    """One ring. t (N,): s, by counting samples; theta (unwrapped in each stretch), r: NaN where not seen, r None where
    not measured; first: a stretch begins; beta, gamma, and u (N, 2) or None; notes: what was found odd; theta_ddot
    (N,): the record's own, rad/s^2, None where it brings none."""

    t: Array
    dt: float
    theta: Array
    r: Array | None
    first: np.ndarray
    beta: Array
    gamma: Array
    u: Array | None
    segment: Array
    notes: tuple[str, ...] = ()
    theta_ddot: Array | None = None

    def __len__(self) -> int:
        return len(self.t)


def turned_round(table: Table, radius: float) -> tuple[Table, tuple[str, ...]]:
    """The table with beta and gamma counted as in the ball's equation, in which gravity pulls the ball downhill, and
    what was turned round, in words."""
    one = Table({name: column for name, column in table.columns.items() if name != "ring"})  # as if of one ring
    samples = ring_samples(one, None, None, SampleOptions(ring=1, radius=radius))
    columns, notes = dict(table.columns), []
    for axis, sign in zip(("beta", "gamma"), orientation(samples), strict=True):
        if sign < 0:
            notes.append(
                f"{axis} is counted the other way round in this record (gravity pulls uphill); it was turned round"
            )
            for name in (axis, f"{axis}_dot", f"{axis}_ddot", f"u_{axis}"):
                if name in columns:
                    columns[name] = -columns[name]
    return Table(columns, table.source), tuple(notes)


def centred(table: Table, camera: Camera) -> Table:
    """The table with what is known of the camera's offset, scale and lens taken off its positions; the camera's angle
    is an effect of its own."""
    known = replace(camera, angle=0.0)
    if "x" not in table or known == Camera():
        return table
    place: Any = known.true(table["x"], table["y"])  # pyright: ignore[reportArgumentType]
    x, y = place
    return Table({**table.columns, "x": x, "y": y, "theta": np.arctan2(y, x), "r": np.hypot(x, y)}, table.source)


def record_of(table: Table, rows: np.ndarray, notes: Sequence[str] = ()) -> Record:
    """The record of the rows (N,) in which the ball is in the ring; notes: what is known to be odd already. Raises
    TableError when nothing can be learned."""
    dt, notes = table.dt, list(notes)
    starts = np.zeros(len(table), dtype=bool)
    for part in stretches(table):
        starts[part.start] = True
    theta = np.where(rows, table["theta"], np.nan) if "theta" in table else np.full(len(table), np.nan)
    if not np.isfinite(theta).any() and "x" in table:
        theta = np.where(rows, np.arctan2(table["y"], table["x"]), np.nan)
    theta, frozen = _without_frozen(theta, starts)
    if frozen:
        notes.append(f"{frozen} samples repeat the one before for {FROZEN} samples or more and were left out")
    gone = ~np.isfinite(theta)
    if gone.any() and rows.all():
        notes.append(f"the ball was not seen in {int(gone.sum())} of {len(theta)} samples")
    starts |= _returns(rows)
    seen = int(np.isfinite(theta).sum())
    if seen < FEWEST:
        where = "" if rows.all() else " in this ring"
        problem = f"got {seen} samples of the ball{where}, expected at least {FEWEST}"
        raise TableError(problem, file=table.source.get("file"))
    if max(np.ptp(table["beta"][rows]), np.ptp(table["gamma"][rows])) < STILL:
        problem = "the plate hardly moves, so that nothing can be learned about the ball"
        raise TableError(problem, file=table.source.get("file"))
    u = np.column_stack([table["u_beta"], table["u_gamma"]]) if "u_beta" in table and "u_gamma" in table else None
    if u is None:
        notes.append(
            "no commands u_beta, u_gamma in this record: the stage cannot be checked, and the tilt is smoothed"
        )
    r = np.where(rows, table["r"], np.nan) if "r" in table else None
    if r is None:
        notes.append("no radius r in this record: the camera's offset cannot be checked")
    whole = Record(
        np.asarray(dt * np.arange(len(table)), dtype=np.float64),
        dt,
        theta,
        r,
        starts,
        table["beta"],
        table["gamma"],
        u,
        np.cumsum(starts),
        tuple(notes),
        np.where(rows, table["theta_ddot"], np.nan) if "theta_ddot" in table else None,
    )
    return replace(whole, theta=_unwrapped(theta, starts))


def _unwrapped(theta: Array, first: np.ndarray) -> Array:
    """theta without jumps of whole turns inside a stretch; NaN stays NaN."""
    out, begins = theta.copy(), np.flatnonzero(first)
    for a, b in zip(begins, [*begins[1:], len(theta)], strict=True):
        seen = np.flatnonzero(np.isfinite(theta[a:b])) + a
        out[seen] = np.unwrap(theta[seen])
    return out


def _without_frozen(theta: Array, starts: np.ndarray) -> tuple[Array, int]:
    """theta with runs of equal values taken out, and how many samples those were."""
    same = np.zeros(len(theta), dtype=bool)
    same[1:] = (theta[1:] == theta[:-1]) & ~starts[1:]
    out, i = theta.copy(), 0
    while i < len(theta):
        if not same[i]:
            i += 1
            continue
        j = i
        while j < len(theta) and same[j]:
            j += 1
        if j - i >= FROZEN:
            out[i:j] = np.nan
        i = j
    return out, int((np.isfinite(theta) & ~np.isfinite(out)).sum())


def _returns(rows: np.ndarray) -> np.ndarray:
    """Where the ball comes back into the ring, and where it leaves it."""
    change = np.zeros(len(rows), dtype=bool)
    change[1:] = rows[1:] != rows[:-1]
    return change
