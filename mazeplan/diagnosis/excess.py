"""Decides when an error is more than noise, and has the words for it. It imports nothing: reports need it, too."""

from __future__ import annotations

FAR_BEYOND = 2.0  # error over the noise floor; a larger error has further causes that were not found
TOO_SELDOM = "what causes the rest comes too seldom or too irregularly to be named: a longer record would tell more"


def more_than_noise(error: float, floor: float) -> bool:
    """Whether an error is far above the noise floor; False if either is not finite."""
    return error > FAR_BEYOND * floor
