"""Records for a diagnosis: the rows of a table in which the ball is in one ring, with notes on anything odd."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np

from mazeplan.core.errors import TableError
from mazeplan.core.logs.table import Table, stretches
from mazeplan.core.records import Array
from mazeplan.learning.samples import SampleOptions, orientation, ring_samples
from mazeplan.physics.rig.sensors import Camera

FROZEN = 15  # equal measurements in a row: no ball and no camera give so many
FEWEST = 300  # minimum number of samples of the ball
LONGER = "mazeplan collect --rig RIG --rings --seconds 300 -o LOG"
STILL = 3e-3  # rad; a plate with a smaller range of tilts shows nothing about the ball


@dataclass(frozen=True)
class RingRecord:
    """The ball in one ring, N samples."""

    t: Array  # number of the sample times dt, s
    dt: float
    theta: Array  # rad, unwrapped in each stretch, NaN if not seen
    r: Array | None  # m, None if not measured
    begins: np.ndarray  # True where a stretch begins
    beta: Array  # measured tilt, rad
    gamma: Array
    u: Array | None  # commands (N, 2), rad, None if unknown
    notes: tuple[str, ...] = ()  # anything odd
    theta_ddot: Array | None = None  # accelerations in the record's own column, rad/s^2

    def __len__(self) -> int:
        return len(self.t)

    def part(self, rows: np.ndarray) -> RingRecord:
        """The record of some rows (N,) alone. They keep their times."""
        columns = ("t", "theta", "r", "begins", "beta", "gamma", "u", "theta_ddot")
        known = {name: column for name in columns if (column := getattr(self, name)) is not None}
        return replace(self, **{name: column[rows] for name, column in known.items()})


def turned_round(table: Table, radius: float) -> tuple[Table, tuple[str, ...]]:
    """The table with the signs of beta and gamma that the ball's equation uses, and notes on each reversed axis.

    In the ball's equation, gravity pulls downhill. radius: of the track, m"""
    one = Table({name: column for name, column in table.columns.items() if name != "ring"})  # as if from one ring
    samples = ring_samples(one, None, None, SampleOptions(ring=1, radius=radius))
    columns, notes = dict(table.columns), []
    for axis, sign in zip(("beta", "gamma"), orientation(samples), strict=True):
        if sign < 0:
            turned = "is counted the other way round in this record (gravity pulls uphill); it was turned round"
            notes.append(f"{axis} {turned}")
            for name in (axis, f"{axis}_dot", f"{axis}_ddot", f"u_{axis}"):
                if name in columns:
                    columns[name] = -columns[name]
    return replace(table, columns=columns), tuple(notes)


def centred(table: Table, camera: Camera) -> Table:
    """The table with positions corrected by the camera's known offset, scale and lens.

    The camera's angle stays in the positions: it is a separate effect."""
    known = replace(camera, angle=0.0)
    if "x" not in table or known == Camera():
        return table
    place: Any = known.true(table["x"], table["y"])  # pyright: ignore[reportArgumentType]
    x, y = place
    seen = {"x": x, "y": y, "theta": np.arctan2(y, x), "r": np.hypot(x, y)}
    return replace(table, columns={**table.columns, **seen})


def record_of(
    table: Table, rows: np.ndarray | None = None, notes: Sequence[str] = (), ring: int | None = None
) -> RingRecord:
    """The record of the rows in which the ball is in the ring.

    rows: True (N,) for these rows; None: all rows
    notes: notes that exist already; ring: its number, for messages

    Raises TableError for a ball that is seldom in the ring, or a plate that does not move."""
    dt, notes = table.dt, list(notes)
    rows = np.ones(len(table), dtype=bool) if rows is None else rows
    starts = np.zeros(len(table), dtype=bool)
    for part in stretches(table):
        starts[part.start] = True
    theta = table["theta"] if "theta" in table else np.full(len(table), np.nan)
    if "x" in table and not np.isfinite(theta[rows]).any():
        theta = np.arctan2(table["y"], table["x"])
    theta, frozen = _without_frozen(np.where(rows, theta, np.nan), starts)
    if frozen:
        notes.append(f"{frozen} samples repeat the one before for {FROZEN} samples or more and were left out")
    gone = ~np.isfinite(theta)
    if gone.any() and rows.all():
        notes.append(f"the ball was not seen in {int(gone.sum())} of {len(theta)} samples")
    starts[1:] |= rows[1:] != rows[:-1]  # the ball comes back into the ring, or leaves it
    seen = int(np.isfinite(theta).sum())
    if seen < FEWEST:
        where = "" if ring is None else f" in ring {ring}"
        problem = f"got {seen} samples of the ball{where}, expected at least {FEWEST} ({FEWEST * dt:.0f} s)"
        raise TableError(f"{problem}: record for longer: {LONGER}", file=table.place)
    if max(np.ptp(table["beta"][rows]), np.ptp(table["gamma"][rows])) < STILL:
        raise TableError("the plate hardly moves, so that nothing can be learned about the ball", file=table.place)
    u = np.column_stack([table["u_beta"], table["u_gamma"]]) if "u_beta" in table and "u_gamma" in table else None
    if u is None:
        notes.append(
            "no commands u_beta, u_gamma in this record: the stage cannot be checked, and the tilt is smoothed"
        )
    r = np.where(rows, table["r"], np.nan) if "r" in table else None
    if r is None:
        notes.append("no radius r in this record: the camera's offset cannot be checked")
    own = np.where(rows, table["theta_ddot"], np.nan) if "theta_ddot" in table else None
    return RingRecord(
        t=np.asarray(dt * np.arange(len(table)), dtype=np.float64), dt=dt, theta=_unwrapped(theta, starts), r=r,
        begins=starts, beta=table["beta"], gamma=table["gamma"], u=u, notes=tuple(notes),
        theta_ddot=own,
    )  # fmt: skip


def _unwrapped(theta: Array, begins: np.ndarray) -> Array:
    """theta without jumps of whole turns inside a stretch; NaN stays NaN."""
    out = theta.copy()
    for a, b in pairwise([*np.flatnonzero(begins), len(theta)]):
        seen = np.flatnonzero(np.isfinite(theta[a:b])) + a
        out[seen] = np.unwrap(theta[seen])
    return out


def _without_frozen(theta: Array, starts: np.ndarray) -> tuple[Array, int]:
    """theta without runs of FROZEN repeated values, and the number of samples left out."""
    same = np.zeros(len(theta), dtype=bool)
    same[1:] = (theta[1:] == theta[:-1]) & ~starts[1:]
    out = theta.copy()
    for a, b in runs(same):
        if b - a >= FROZEN:
            out[a:b] = np.nan
    return out, int((np.isfinite(theta) & ~np.isfinite(out)).sum())


def runs(mask: np.ndarray) -> Iterator[tuple[int, int]]:
    """First row of each run of True, and the row behind the run."""
    edges = np.flatnonzero(np.diff(np.r_[False, mask, False].astype(np.int8)))
    return zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True)
