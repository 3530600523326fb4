"""Evidence for a rig's verdict as plain data: `evidence.json` beside `report.json`. A report draws it."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from mazeplan.core.records import Array
from mazeplan.diagnosis.rig.result import RigVerdict

PARTS = ("before", "after")


def rig_evidence(done: RigVerdict, title: str) -> dict[str, Any]:
    """Errors of roll-outs (rad) by the time ahead: their mean, and the range of four in five."""
    held, dt = done.held, done.body.pictures.dt
    ranges = (("low", 0.1), ("high", 0.9))
    return {
        "kind": "rig", "title": title, "ahead_s": (dt * np.arange(1, len(held.before) + 1)).round(4).tolist(),
        "error": {when: _rounded(np.nanmean(getattr(held, when), axis=1)) for when in PARTS},
        **{
            name: {when: _rounded(np.nanquantile(getattr(held, when), share, axis=1)) for when in PARTS}
            for name, share in ranges
        },
    }  # fmt: skip


def _rounded(values: Array) -> list[float | None]:
    return [round(float(v), 5) if math.isfinite(v) else None for v in values]
