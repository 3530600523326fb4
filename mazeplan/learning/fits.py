"""Whether a model fits the machine that it was learned from at all: rms over the noise, by part, in one line."""

from __future__ import annotations

from mazeplan.learning.rig_model import RigModel

FITS = 1.3  # times the noise up to which a description fits a record
SLIDING, SMOOTH = 0.8, 0.02  # factor of gravity that no rolling ball has; friction of a wall that hardly has any


def fits_words(model: RigModel) -> str:
    """One line about stage and ball; empty for a model that does not know how well it fits."""
    fits: dict[str, float] = model.scores.get("fits") or {}
    words = [
        f"the {part} {'fits' if times <= FITS else 'does not fit'} ({times:.1f} times its noise)"
        for part, times in fits.items()
    ]
    hints = ["a servo of another kind?"] if fits.get("stage", 0.0) > FITS else []
    hints += [_hint(model)] if fits.get("ball", 0.0) > FITS else []
    return ", ".join(words) + (": " + " ".join(hints) if hints else "")


def _hint(model: RigModel) -> str:
    """What a ball that does not fit may be."""
    factors = [ball.parameter("rolling_inertia", "factor", 0.0) for ball in model.balls.values()]
    wall = model.body.values.get("wall", 0.0) if model.body is not None else 1.0
    return f"{kind_of_ball(max(factors, default=0.0) > SLIDING, wall)}?"


def kind_of_ball(slides: bool, wall: float) -> str:
    """What a ball that does not fit may be, by its numbers. wall: friction coefficient at a wall"""
    if slides:
        return "a ball that slides"
    return "walls without friction" if wall < SMOOTH else "an unbalanced ball, or soft walls"
