"""Networks for one ring of a rig's model: in place of the effects (nn), or beside them and trained with them (spnn)."""

from __future__ import annotations

import numpy as np

from mazeplan.core.progress import Advance, Words
from mazeplan.learning.fitting import FitOptions
from mazeplan.learning.network_training import train_networks
from mazeplan.learning.networks import Networks
from mazeplan.learning.samples import RingSamples
from mazeplan.physics.ball_model import BallModel
from mazeplan.physics.effect import OPENING
from mazeplan.physics.formulas.arrays import NO_GRAVITY


def learn_networks(
    samples: RingSamples, ball: BallModel, kind: str, options: FitOptions, progress: Words, advance: Advance
) -> tuple[BallModel, Networks, tuple[float, float]]:
    """The ball with its effects trained (spnn), the networks, and nRMSE of theta_dd by effects alone and with networks.

    For the score, each member predicts the blocks that it has left out. The effects stay within about the standard
    errors of their identification, which contains no impacts."""
    rows = np.flatnonzero(samples.good)
    trained = tuple(term for term in ball.planned if term.effect.acts != OPENING) if kind == "spnn" else (NO_GRAVITY,)
    found, networks = train_networks(
        samples, rows, trained, options.networks, fitted=kind == "spnn", known=ball.stderr, seed=options.seed,
        progress=progress, advance=advance,
    )  # fmt: skip
    target = samples.theta_ddot[rows]
    before = float(np.sqrt(np.mean((target - ball.acceleration(samples.at(rows))) ** 2)))
    spread = max(float(np.std(target)), 1e-12)
    if kind == "spnn":
        by_name = {term.name: term for term in found}
        ball = BallModel(tuple(by_name.get(term.name, term) for term in ball.effects), ball.stderr)
    return ball, networks, (before / spread, networks.noise / spread)
