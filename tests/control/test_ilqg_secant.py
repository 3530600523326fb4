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
    w.A[:], w.new_a[:] = (
        np.einsum("ijk,tk->tij", H, w.states[:T]),
        np.einsum("ijk,tk->tij", H, w.new_states[:T]),
    )
    core._secant(w)
    return w, along, true * sign * np.sign(true[0])


def eigenvalues(M):
    return np.linalg.eigvalsh(M)


@pytest.mark.parametrize("seed", range(8))
def test_the_curvature_along_the_move_is_exact_for_quadratic_dynamics(seed):
    w, along, true = bent(seed, 1.0)
    assert w.numbers[SECANT] == 1.0
    core._learn_curvature(w, 0)
    M, d = w.curvature[0], along[0]
    assert d @ M @ d == pytest.approx(true[0], rel=1e-9)
    np.testing.assert_allclose(M, M.T, atol=1e-12)
    assert np.linalg.matrix_rank(M, tol=1e-9) == 1
    assert eigenvalues(M).min() > -1e-9


def test_the_secant_equation_holds_where_it_is_well_conditioned():
    held = 0
    for seed in range(8):
        w, along, _ = bent(seed, 1.0)
        y = np.einsum("i,ij->j", w.V, w.delta_a[0])
        core._learn_curvature(w, 0)
        d = along[0]
        if y @ d > core.ILL_CONDITIONED * np.linalg.norm(y) * np.linalg.norm(d):
            np.testing.assert_allclose(w.curvature[0] @ d, y, atol=1e-9)
            held += 1
        else:  # of rank one along the move alone: nothing is known of other directions
            across = np.linalg.svd(d[None])[2][1:]
            np.testing.assert_allclose(across @ w.curvature[0], 0.0, atol=1e-9)
    assert held >= 5


def test_what_earlier_moves_have_told_is_kept():
    """Convex dynamics, moves in as many directions as there are: the whole curvature is known."""
    rng = np.random.default_rng(9)
    w = make_workspace(T, N, np.full(2, -1.0), np.full(2, 1.0))
    root = rng.normal(size=(N, N))
    H = root @ root.T
    w.V[0] = 1.0
    for move in np.linalg.qr(rng.normal(size=(N, N)))[0]:
        w.delta_s[0] = move
        w.delta_a[0, 0] = H @ move
        core._learn_curvature(w, 0)
        assert eigenvalues(w.curvature[0]).min() > -1e-9
    np.testing.assert_allclose(w.curvature[0], H, atol=1e-9)


def test_knowledge_that_no_longer_holds_shrinks_to_what_the_move_shows():
    w = make_workspace(T, N, np.full(2, -1.0), np.full(2, 1.0))
    w.V[0], w.delta_s[0, 0] = 1.0, 0.5
    w.curvature[0] = 4.0 * np.eye(N)
    w.delta_a[0, 0, 0] = 1.0 * 0.5  # a curvature of one where four was believed
    core._learn_curvature(w, 0)
    np.testing.assert_allclose(w.curvature[0], np.eye(N), atol=1e-12)


@pytest.mark.parametrize("seed", range(4))
def test_only_what_is_convex_counts(seed):
    w, _, true = bent(seed, -1.0)
    assert true[0] < 0.0
    w.curvature[0] = np.eye(N)
    core._learn_curvature(w, 0)
    assert (w.curvature[0] == 0.0).all()


def test_a_candidate_that_did_not_move_tells_nothing():
    w, _, _ = bent(0, 1.0)
    w.delta_s[:] = 0.0
    w.curvature[0] = np.eye(N)
    core._learn_curvature(w, 0)
    assert (w.curvature[0] == np.eye(N)).all()


def test_what_is_taken_brings_its_derivatives_along():
    w, _, _ = bent(1, 1.0)
    w.numbers[STALE] = FRESH
    core._accept_candidate(w)
    assert (w.states == w.new_states).all()
    assert (w.new_a == w.A).all()
    assert w.numbers[STALE] != FRESH, "those of the cost are still the old ones"
