"""Gaussian processes for tests: plain hyperparameters, likelihood, derivatives."""

from __future__ import annotations

import numpy as np
from scipy.stats import multivariate_normal

from mazeplan.learning.gaussian_process import Hyperparameters, KernelTerm, kernel


def plain(lengthscales, amplitude, noise, weight_sigma=None, family="rbf"):
    """One term on all inputs."""
    term = KernelTerm(tuple(range(len(lengthscales))), lengthscales, amplitude)
    return Hyperparameters((term,), noise, np.zeros(0) if weight_sigma is None else weight_sigma, family)


def log_likelihood(hyper, x, phi, y):
    """Log marginal likelihood of values (N,) at inputs (N, D) with features (N, M)."""
    covariance = kernel(x, x, hyper) + (phi * hyper.weight_sigma**2) @ phi.T + hyper.noise**2 * np.eye(len(y))
    return float(multivariate_normal.logpdf(y, np.zeros(len(y)), covariance))  # pyright: ignore


def state_gradient(gp, states):
    """Derivatives (N, 6) of the mean of a plain rbf process by the states (N, 6): theta, its rate, beta, ..."""
    term, (theta, _, beta, _, gamma, _) = gp.hyper.only, states.T
    x, rows = state_inputs(states)[:, term.columns], gp.inputs[:, term.columns]
    weights = kernel(state_inputs(states), gp.inputs, gp.hyper) * gp.alpha
    slope = np.zeros((len(states), 9))
    slope[:, term.columns] = np.einsum("nk,nkc->nc", weights, rows[None] - x[:, None]) / term.lengthscales**2
    out = np.empty((len(states), 6))
    for i, angle in enumerate((theta, beta, gamma)):
        out[:, 2 * i] = slope[:, 3 + 2 * i] * np.cos(angle) - slope[:, 4 + 2 * i] * np.sin(angle)
        out[:, 2 * i + 1] = slope[:, i]
    return out


def state_inputs(states):
    """Inputs (N, 9) of the kernel at states (N, 6)."""
    theta, theta_dot, beta, beta_dot, gamma, gamma_dot = states.T
    angles = [f(angle) for angle in (theta, beta, gamma) for f in (np.sin, np.cos)]
    return np.stack([theta_dot, beta_dot, gamma_dot, *angles], axis=1)
