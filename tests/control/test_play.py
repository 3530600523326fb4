"""Commands for servos with play."""

from __future__ import annotations

import numpy as np
import pytest

from mazeplan.control.backlash import BacklashCompensator
from mazeplan.core.records import Command
from mazeplan.physics.rig.stage import StageAxis, StageModel
from mazeplan.physics.rig.stage_simulation import apply_backlash

LIMIT = 0.087


def test_what_is_wished_is_passed_on_and_the_axis_without_play_is_left_alone():
    gears = BacklashCompensator(StageModel(StageAxis(backlash=0.02), StageAxis()), LIMIT)
    assert gears.has_backlash
    rng, sent, passed = np.random.default_rng(0), [], []
    wishes = np.cumsum(rng.normal(0.0, 0.004, (60, 2)), axis=0).clip(-0.07, 0.07)
    for wish in wishes:
        command = gears.lead(Command(*wish))
        through = gears.sent(command)
        sent.append([command.u_beta, command.u_gamma])
        passed.append([through.u_beta, through.u_gamma])
    assert np.array(passed) == pytest.approx(wishes)
    assert np.array(sent)[:, 1] == pytest.approx(wishes[:, 1])
    assert apply_backlash(np.array(sent)[:, 0], 0.02, start=0.0) == pytest.approx(wishes[:, 0]), "as real gears do"


def test_the_limit_holds():
    gears = BacklashCompensator(StageModel(StageAxis(backlash=0.02), StageAxis()), LIMIT)
    command = gears.lead(Command(LIMIT, 0.0))
    assert command.u_beta == LIMIT
    assert gears.sent(command).u_beta == pytest.approx(LIMIT - 0.01)
