"""The motion of the plate that its commands tell of."""

from __future__ import annotations

import numpy as np
import pytest

from mazeplan.diagnosis.stage.plate_motion import FINE
from mazeplan.physics.rig.stage import StageAxis, fine_motion


def test_an_axis_begins_at_rest_and_settles_where_gain_and_offset_say():
    axis, dt = StageAxis(1.1, 24.0, 0.9, offset=0.01), 1.0 / 30.0
    u = np.repeat([-0.04, 0.05], 60)
    motion = fine_motion(axis, u, dt, FINE)
    assert motion.shape == (len(u) * FINE, 3)
    middle = len(motion) // 2
    assert np.allclose(motion[: middle - FINE], [1.1 * -0.04 + 0.01, 0.0, 0.0], atol=1e-12)
    assert motion[-1] == pytest.approx([1.1 * 0.05 + 0.01, 0.0, 0.0], abs=1e-6)
    step = motion[middle : middle + 30 * FINE, 1].sum() * dt / FINE  # the rate is that of the angle
    assert step == pytest.approx(1.1 * 0.09, rel=0.05)
