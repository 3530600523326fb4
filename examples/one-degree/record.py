"""A record of the pendulum as it really is, with a paddle in the air: `python record.py > pendulum.csv`."""

import sys

import numpy as np
from scipy.integrate import solve_ivp

RATE, SECONDS, MASS, LENGTH = 50.0, 60.0, 0.25, 0.4  # Hz, s, kg, m
PADDLE = 0.15  # 1/rad, drag over the inertia
BLUR = 2e-3  # rad, noise of the camera


def torque(t):
    """N m, of the motor at times t."""
    return 0.3 * np.sin(4.0 * t + 4.0 * np.sin(0.31 * t)) + 0.1 * np.sin(1.3 * t)


def record():
    """(t, theta, torque) in rows."""

    def motion(t, state):
        theta, speed = state
        drive = torque(t) / (MASS * LENGTH**2) - 9.81 / LENGTH * np.sin(theta)
        return speed, drive - PADDLE * speed * abs(speed)

    t = np.arange(round(SECONDS * RATE)) / RATE
    theta = solve_ivp(motion, (0.0, SECONDS), (0.2, 0.0), t_eval=t, rtol=1e-9, atol=1e-9).y[0]
    seen = theta + BLUR * np.random.default_rng(1).standard_normal(len(t))
    return np.column_stack([t, seen, torque(t)])


if __name__ == "__main__":
    np.savetxt(sys.stdout, record(), fmt=["%.2f", "%.5f", "%.5f"], delimiter=",", header="t,theta,torque", comments="")
