"""Records of both machines as they really are: `python record.py` writes cart.csv and ball.csv.

The hinge of the pendulum has friction; the plate of the ball is not level.
"""

import numpy as np
from scipy.integrate import solve_ivp

G, RATE, SECONDS = 9.81, 50.0, 30.0  # m/s^2, Hz, s
SHARE, LENGTH, HINGE = 0.25, 0.5, 0.3  # pendulum's over cart's mass, m, 1/s
SLOPE = 0.004  # rad, of the plate along y


def cart():
    """t, z, theta, push in rows."""

    def push(t):
        return 1.5 * np.sin(2.1 * t) + 1.0 * np.sin(5.3 * t + 1.0)

    def motion(t, state):
        _, angle, speed, rate = state
        # mass matrix of (z, theta), over the mass of the cart; friction of the hinge as an acceleration of the angle
        matrix = np.array([[1.0 + SHARE, SHARE * LENGTH * np.cos(angle)], [np.cos(angle), LENGTH]])
        forces = np.array([push(t) + SHARE * LENGTH * rate**2 * np.sin(angle), -G * np.sin(angle)])
        z, theta = np.linalg.solve(matrix, forces)
        return speed, rate, z, theta - HINGE * rate

    t = np.arange(round(SECONDS * RATE)) / RATE
    z, theta = solve_ivp(motion, (0.0, SECONDS), (0.0, 0.6, 0.0, 0.0), t_eval=t, rtol=1e-9, atol=1e-9).y[:2]
    rng = np.random.default_rng(1)
    return np.column_stack(
        [t, z + 5e-4 * rng.standard_normal(len(t)), theta + 1e-3 * rng.standard_normal(len(t)), push(t)]
    )


def ball():
    """t, x, y, alpha, beta in rows."""

    def tilts(t):
        return 0.03 * np.sin(2.9 * t), 0.03 * np.sin(3.7 * t + 0.5) - SLOPE * 0.9

    def motion(t, state):
        alpha, beta = tilts(t)
        return state[2], state[3], 5.0 / 7.0 * G * np.sin(alpha), 5.0 / 7.0 * G * np.sin(beta + SLOPE)

    t = np.arange(round(SECONDS * RATE)) / RATE
    x, y = solve_ivp(motion, (0.0, SECONDS), (0.0, 0.0, -0.07, -0.02), t_eval=t, rtol=1e-9, atol=1e-9).y[:2]
    seen = np.column_stack([x, y]) + 3e-4 * np.random.default_rng(2).standard_normal((len(t), 2))
    return np.column_stack([t, seen, *tilts(t)])


if __name__ == "__main__":
    np.savetxt("cart.csv", cart(), fmt="%.6g", delimiter=",", header="t,z,theta,push", comments="")
    np.savetxt("ball.csv", ball(), fmt="%.6g", delimiter=",", header="t,x,y,alpha,beta", comments="")
