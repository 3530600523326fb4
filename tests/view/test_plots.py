"""What the live curves show."""

from __future__ import annotations

import numpy as np
import pytest

from mazeplan.view.plots import turn_of

NAN = float("nan")


@pytest.mark.parametrize(
    ("theta", "axis"),
    [([], (0.0, 45.0)), ([NAN, NAN], (0.0, 45.0)), ([NAN, 10.0, 50.0], (0.0, 90.0)), ([-100.0, 44.0], (-135.0, 45.0))],
)
def test_the_axis_of_theta_holds_all_that_is_known(theta, axis):
    assert turn_of(np.array(theta)) == axis


def test_it_seldom_changes():
    axes = {turn_of(np.linspace(0.0, end, 50)) for end in np.linspace(1.0, 89.0, 80)}
    assert len(axes) == 2
