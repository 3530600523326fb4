"""Records whose tilts are exchanged or turned round, or whose ball does not follow the tilt: one line, no diagnosis."""

from __future__ import annotations

import numpy as np
import pytest
from plant import play

import mazeplan
from mazeplan.core.errors import TableError
from mazeplan.core.logs.table import as_table
from mazeplan.learning.identification import check_record


@pytest.fixture(scope="module")
def columns():
    """A minute of a ball in ring 1."""
    radius = mazeplan.load_map("cme").track_radius(1)
    played = play(seed=3, seconds=60.0, radius=radius)
    x, y = radius * np.cos(played["theta"]), radius * np.sin(played["theta"])
    return {"x": x, "y": y, **{name: played[name] for name in ("t", "beta", "gamma", "u_beta", "u_gamma")}}


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        (lambda c: {"beta": c["gamma"], "gamma": c["beta"]}, "are the two measured tilts exchanged"),
        (lambda c: {"gamma": -c["gamma"]}, "tilt of gamma has the opposite sign of its command"),
        (lambda c: {name: -c[name] for name in ("beta", "u_beta", "gamma", "u_gamma")}, "does not follow the tilt"),
    ],
)
@pytest.mark.parametrize("command", ["learn", "diagnose"])
def test_a_record_with_wrong_wiring_is_refused(columns, command, wrong, words):
    with pytest.raises(TableError, match=words):
        getattr(mazeplan, command)(columns | wrong(columns), **({"kind": "pi"} if command == "learn" else {}))


def test_a_sine_that_follows_its_command_is_not_turned_round():
    t = np.arange(900) / 30.0
    u, tilt = (np.sin(np.pi * 30.0 / 9.5 * (t - late)) for late in (0.0, 0.05))  # or 11 samples, turned
    table = as_table({"t": t, "beta": tilt, "gamma": tilt, "u_beta": u, "u_gamma": u, "theta": t})
    check_record(table, None)


def test_the_record_itself_is_not_refused(columns):
    assert mazeplan.learn(columns, kind="p").model is not None
