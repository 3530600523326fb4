"""Records of the ball in a ring that the tests' own plant makes, and their diagnosis."""

from __future__ import annotations

from plant import play

from mazeplan.core.logs.table import Table
from mazeplan.diagnosis.record import record_of
from mazeplan.diagnosis.ring.diagnose import diagnose

DECLARED = {"rolling_inertia": {"factor": 5 / 7}, "viscous_friction": {"coefficient": 0.35}}


def record(**what):
    return record_of(Table(play(**what)))


def found(**what):
    """The diagnosis of a record that the plant makes with these effects."""
    return diagnose(record(**what), what.get("radius", 0.0925), DECLARED)


def names(done):
    return sorted(e["name"] for e in done.effects)


def parameters(done, name):
    """Parameters of the one effect of that name."""
    (effect,) = (e for e in done.effects if e["name"] == name)
    return effect["parameters"]
