"""What a straight line through noisy pictures is off at its end: `tools/bench_taught.py`."""

import numpy as np
from bench_taught import line_covariance


def test_covariance_at_the_end_of_a_line_is_that_of_fits_to_noise():
    noise, dt, count = 0.02, 1.0 / 30.0, 20
    t = dt * (np.arange(count) - (count - 1))  # 0 at the last
    y = noise * np.random.default_rng(0).standard_normal((20000, count))
    slope, value = np.polyfit(t, y.T, 1)
    found = np.cov(np.stack([value, slope]))
    np.testing.assert_allclose(line_covariance(noise, dt, count), found, rtol=0.05)
