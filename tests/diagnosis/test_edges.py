"""A ball sinks into an opening and meets its far edge: how much speed that takes, and that it is found."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numba import njit

from mazeplan.diagnosis.ring.fit import fit
from mazeplan.diagnosis.ring.scores import MATCHED
from mazeplan.diagnosis.ring.system import RingSystem, Tilt, ring_library
from mazeplan.diagnosis.ring.windows import WindowLikelihood
from mazeplan.learning.smoothing import derivatives
from mazeplan.physics.effects.openings import Openings, closer_library, wall_library
from mazeplan.physics.formulas.compiled import term_functions
from mazeplan.physics.formulas.symbols import INPUTS

RADIUS, DT = 0.0488, 1.0 / 30.0
PULL = 9.81 / RADIUS
STILL = Tilt(DT * np.arange(9.0), np.zeros((9, 6)), "level")
QUARTERS = tuple(0.5 * math.pi * i for i in range(4))


def struck(theta, rate, late_beta, late_gamma, sinking, side):
    """Share of its speed with which a ball runs against the far edge of an opening; side: 1 outer, -1 inner."""
    (_, edges) = closer_library(Openings(QUARTERS, ()) if side > 0.0 else Openings((), QUARTERS))
    told = {"radius": RADIUS, "late_beta": late_beta, "late_gamma": late_gamma}
    values = {"rotation": 0.0, "loss": 1.0, "reach": 0.02, "sinking": sinking}
    loss = term_functions(edges).vectorised(np)["loss"]
    return loss(theta, rate, 0.0, [told.get(name, 0.0) for name in INPUTS], list(values.values()))


def test_an_edge_takes_more_the_deeper_a_ball_has_sunk():
    by_turning = struck(0.3, 2.0, 0.0, 0.0, 0.2, 1.0)
    assert by_turning == pytest.approx(1.0 - 0.8**2)
    assert struck(0.3, -5.0, 0.0, 0.0, 0.2, 1.0) == pytest.approx(by_turning)  # a faster one has less time to sink
    assert struck(0.3, 2.0, 0.0, 0.0, 0.2, -1.0) == 0.0  # nothing presses it inwards
    outwards = 0.05 * math.cos(0.3), -0.05 * math.sin(0.3)
    depth = 0.2 * (1.0 + 5.0 / 7.0 * PULL * 0.05 / 4.0)
    assert struck(0.3, 2.0, *outwards, 0.2, 1.0) == pytest.approx(1.0 - (1.0 - depth) ** 2, rel=1e-3)
    assert struck(0.3, 0.1, *outwards, 0.2, 1.0) == 1.0  # sunk in by its radius
    inwards = -outwards[0], -outwards[1]
    assert struck(0.3, 0.1, *inwards, 0.2, 1.0) == 0.0
    assert struck(0.3, 0.1, *inwards, 0.2, -1.0) == 1.0


def test_edges_and_gates_of_a_wall_exclude_each_other():
    gates = Openings(outer=QUARTERS, inner=(1.0,))
    closer = closer_library(gates)
    for plain, same, edge in zip(wall_library(gates), closer[::2], closer[1::2], strict=True):
        assert (same.name, list(same.parameters)) == (plain.name, ["rotation", "loss", "width"])
        assert (edge.name in plain.rivals, plain.name in edge.rivals) == (True, True)
        assert (edge.side, edge.pattern) == (plain.side, plain.pattern)
        assert list(edge.parameters) == ["rotation", "loss", "reach", "sinking"]
    assert closer_library(Openings()) == []


@njit
def rolled(theta, beta, gamma, rotation, losses, reach, sinking, factor):
    """A ball in a ring, 40 steps a sample, that meets the far edges of four outer gates; written anew."""
    x, v, fine, mean_b, mean_g = theta[0], 0.0, 40, beta[0], gamma[0]
    h = DT / fine
    for k in range(1, len(theta)):
        keep = math.exp(-DT / 0.05)
        mean_b, mean_g = keep * mean_b + (1 - keep) * beta[k - 1], keep * mean_g + (1 - keep) * gamma[k - 1]
        for i in range(fine):
            b = beta[k - 1] + (beta[k] - beta[k - 1]) * (i + 0.5) / fine
            g = gamma[k - 1] + (gamma[k] - gamma[k - 1]) * (i + 0.5) / fine
            v -= h * (factor * PULL * (math.sin(b) * math.sin(x) + math.sin(g) * math.cos(x)) + 0.3 * v)
            new = x + h * v
            edge = rotation + math.copysign(reach, v)
            if math.floor((x - edge) / (math.pi / 2)) != math.floor((new - edge) / (math.pi / 2)):
                across = math.sin(mean_b) * math.cos(x) - math.sin(mean_g) * math.sin(x)
                d = min(max(sinking * (1.0 + 5.0 / 7.0 * PULL * across / (v * v)), 0.0), 1.0)
                which = math.floor((max(x, new) - edge) / (math.pi / 2)) % 4
                v *= 1.0 - losses[which] * (1.0 - (1.0 - d) ** 2)
            x = new
        theta[k] = x


def table(losses, noise=0.0):
    """Its record: rotation 0.4, reach 0.06, sinking 0.4, factor 0.6; noise: of its angles, rad."""
    t = np.asarray(DT * np.arange(6000), dtype=np.float64)
    rng = np.random.default_rng(2)
    tilts = []
    for _ in range(2):
        f, phase = rng.uniform(0.05, 0.6, 6), rng.uniform(0.0, 6.28, 6)
        tilts.append(0.022 * np.sum(np.sin(2.0 * math.pi * f * t[:, None] + phase), axis=1))
    beta, gamma = tilts
    theta = np.zeros(len(t))
    rolled(theta, beta, gamma, 0.4, np.array(losses), 0.06, 0.4, 0.6)
    first = np.arange(len(t)) == 0
    motion = np.column_stack(
        [f for tilt in tilts for f in (tilt, np.gradient(tilt, DT), np.gradient(np.gradient(tilt, DT), DT))]
    )
    theta = theta + noise * rng.standard_normal(len(t))
    target = derivatives(theta, DT, MATCHED).acceleration
    return RingSystem(t, theta, first, RADIUS, Tilt(t, motion, "known"), {}, target)


KNOWN = [c for c in ring_library() if c.name in ("rolling_inertia", "viscous_friction")]
START = {"rolling_inertia": {"factor": 0.65}, "viscous_friction": {"coefficient": 0.2}}


def found_in(system, *edges):
    """A likelihood with edges, the last of them fitted."""
    likelihood = WindowLikelihood(system, [*KNOWN, *edges], np.ones(len(system), dtype=bool), math.inf)
    (*_, c) = edges
    start = {**START, c.name: dict(zip(c.parameters, (0.36, 0.4, 0.03, 0.6), strict=False))}
    return likelihood, fit(likelihood, [*KNOWN, c], start)


def test_no_window_begins_behind_a_lost_picture():
    t = DT * np.arange(120.0)
    theta = np.sin(t)
    theta[40] = np.nan
    target = derivatives(np.sin(t), DT, MATCHED).acceleration
    target[40 - 3 : 40 + 4] = np.nan
    system = RingSystem(t, theta, t == 0.0, RADIUS, Tilt(t, np.zeros((len(t), 6)), "level"), {}, target)
    likelihood = WindowLikelihood(system, KNOWN, np.ones(len(t), dtype=bool))
    assert len(likelihood.windows) > 40
    assert np.isfinite(likelihood.residuals({c.name: START[c.name] for c in KNOWN})).all()


@pytest.mark.slow
def test_sizes_of_edges_are_found():
    (_, edges) = closer_library(Openings(outer=QUARTERS))
    _, found = found_in(table([0.6] * 4), edges)
    for name, value in {"rotation": 0.4, "loss": 0.6, "reach": 0.06, "sinking": 0.4}.items():
        near = 0.02 if name in ("rotation", "reach") else 0.06
        assert found.values[edges.name][name] == pytest.approx(value, abs=near)
    assert found.values["rolling_inertia"]["factor"] == pytest.approx(0.6, abs=0.01)


def test_gates_change_walls_as_sharply_as_they_are_told():
    """A ball that is pressed to the wall half as much as it takes to change walls lies against it by e / (1 + e)."""
    (plain,), (same, _) = wall_library(Openings(inner=(1.0,))), closer_library(Openings(inner=(1.0,)))
    pressed = 0.05  # m/s^2 inwards
    told = {"radius": RADIUS, "beta": -math.asin(pressed / 9.81 * 9.0 / 5.0)}

    def lost(c, **more):
        values = {"rotation": 0.2, "loss": 0.5, **more}
        w = [told.get(name, 0.0) for name in INPUTS]
        return term_functions(c).vectorised(np)["loss"](0.0, 0.0, 0.0, w, list(values.values()))

    assert lost(plain) == pytest.approx(0.5 / (1.0 + math.exp(-0.5)), rel=1e-9)
    assert lost(same, width=0.1) == lost(plain)
    assert lost(same, width=0.05) == pytest.approx(0.5 / (1.0 + math.exp(-1.0)), rel=1e-9)


def test_an_opening_stands_at_its_place_in_the_map_and_is_turned_with_it():
    system = RingSystem(DT * np.arange(9.0), np.zeros(9), np.arange(9) == 0, RADIUS, STILL, {})
    (same, edges) = closer_library(Openings(inner=(1.0, 2.5)))
    for c, values in ((same, (0.2, 0.5, 0.03)), (edges, (0.2, 0.5, 0.1, 0.4))):
        problem, p = system.build([c], {c.name: dict(zip(c.parameters, values, strict=True))})
        assert problem.opening_offsets.tolist() == [1.0, 2.5]
        for _, _, place in problem.openings:
            assert p[place : place + len(values)].tolist() == list(values)
