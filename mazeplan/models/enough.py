"""Whether windows and blocks of time are enough to say how sure a score is.

A share of W windows goes in steps of 1 / W. Blocks drawn with replacement give 126 different draws where there are 5 of
them, 35 where there are 4: too few for the ends of a 95 % interval.
"""

from __future__ import annotations

WINDOWS, BLOCKS = 10, 5
TOO_FEW = "too few"


def enough(windows: int | None = None, blocks: int | None = None) -> bool:
    """Whether so many are enough; None: not known, or not what counts."""
    return (windows is None or windows >= WINDOWS) and (blocks is None or blocks >= BLOCKS)
