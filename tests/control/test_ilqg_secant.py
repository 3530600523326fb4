"""What a refused or taken candidate tells of the curvature of the dynamics."""

from __future__ import annotations

import numpy as np
import pytest

from mazeplan.control import ilqg_core as core
from mazeplan.control.ilqg_workspace import FRESH, SECANT, STALE, make_workspace

T, N = 3, 4


def bent(seed: int, sign: float):
    """A workspace after a candidate of dynamics whose rows are s' H s / 2, and the true V f_ss along the moves (T,)."""
    rng = np.random.default_rng(seed)
    w = make_workspace(T, N, np.full(2, -1.0), np.full(2, 1.0))
    H = rng.normal(size=(N, N, N))
    H = H + H.transpose(0, 2, 1)
    w.states[:], w.V[:] = rng.normal(size=(T + 1, N)), rng.normal(size=N)
    w.new_states[:] = w.states + 0.3 * rng.normal(size=(T + 1, N))
    along = w.new_states[:T] - w.states[:T]
    true = np.einsum("i,ijk,tj,tk->t", w.V, H, along, along)
    w.V[:] *= sign * np.sign(true[0])  # positive or negative along the first move, as wished
    w.A[:], w.new_a[:] = np.einsum("ijk,tk->tij", H, w.states[:T]), np.einsum("ijk,tk->tij", H, w.new_states[:T])
    core._secant(w)
    return w, along, true * sign * np.sign(true[0])


@pytest.mark.parametrize("seed", range(4))
def test_the_curvature_along_the_move_is_exact_for_quadratic_dynamics(seed):
    w, along, true = bent(seed, 1.0)
    assert w.numbers[SECANT] == 1.0
    before = np.diag([1.0, 2.0, 3.0, 4.0])
    w.Qxx[:] = before
    core._bend(w, 0)
    added = w.Qxx - before
    d = along[0]
    assert d @ added @ d == pytest.approx(true[0], rel=1e-9)
    np.testing.assert_allclose(added, added.T, atol=1e-12)
    assert np.linalg.matrix_rank(added, tol=1e-9) == 1
    across = np.linalg.svd(d[None])[2][1:]  # nothing is known of other directions
    np.testing.assert_allclose(across @ added, 0.0, atol=1e-9)


@pytest.mark.parametrize("seed", range(4))
def test_only_what_is_convex_counts(seed):
    w, _, true = bent(seed, -1.0)
    assert true[0] < 0.0
    w.Qxx[:] = np.eye(N)
    core._bend(w, 0)
    assert (w.Qxx == np.eye(N)).all()


def test_a_candidate_that_did_not_move_tells_nothing():
    w, _, _ = bent(0, 1.0)
    w.moved[:] = 0.0
    w.Qxx[:] = np.eye(N)
    core._bend(w, 0)
    assert (w.Qxx == np.eye(N)).all()


def test_what_is_taken_brings_its_derivatives_along():
    w, _, _ = bent(1, 1.0)
    w.numbers[STALE] = FRESH
    core._take(w, True)
    assert (w.states == w.new_states).all()
    assert (w.new_a == w.A).all()
    assert w.numbers[STALE] != FRESH, "those of the cost are still the old ones"
