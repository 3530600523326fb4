"""Commands for servos with play."""

from __future__ import annotations

import numpy as np
import pytest

from mazeplan.control.command_chain import CommandChain, Gears
from mazeplan.core.records import LEVEL, Command, State
from mazeplan.physics.rig.stage import StageAxis, StageModel, actuator_output

LIMIT = 0.087


def test_gears_pass_on_the_wanted_command():
    gears = Gears(StageModel(StageAxis(backlash=0.02), StageAxis()), LIMIT)
    rng, sent, passed = np.random.default_rng(0), [], []
    wishes = np.cumsum(rng.normal(0.0, 0.004, (60, 2)), axis=0).clip(-0.07, 0.07)
    for wish in wishes:
        command = gears.lead(Command(*wish))
        through = gears.pass_on(command)
        sent.append([command.u_beta, command.u_gamma])
        passed.append([through.u_beta, through.u_gamma])
    assert np.array(passed) == pytest.approx(wishes)
    assert np.array(sent)[:, 1] == pytest.approx(wishes[:, 1])
    turned = actuator_output(np.array([0.0, *np.array(sent)[:, 0]]), StageAxis(backlash=0.02))  # level before
    assert turned[1:] == pytest.approx(wishes[:, 0]), "as real gears do"


def test_the_limit_holds():
    gears = Gears(StageModel(StageAxis(backlash=0.02), StageAxis()), LIMIT)
    command = gears.lead(Command(LIMIT, 0.0))
    assert command.u_beta == LIMIT
    assert gears.pass_on(command).u_beta == pytest.approx(LIMIT - 0.01)


CENTRE = State(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 5)


class Keeper:
    def command(self, wanted, kept, led):
        return Command(0.01, 0.0)


def test_commands_are_filtered_and_limited_in_their_change():
    chain = CommandChain(30.0, slew=1.5)
    chain.adopt(StageModel(), LIMIT, Keeper())
    first = chain.limited(Command(0.2, -0.01))
    assert first == Command(0.05, -0.01)
    assert chain.send(first, lead=True) == chain.sent == first
    assert chain.limited(Command(0.06, -0.01)) == Command(0.06, -0.01)
    assert chain.limited(Command(0.05, 0.05), [CENTRE], CENTRE) == Command(0.01, 0.0)
    assert chain.limited(None, [CENTRE], CENTRE) == LEVEL


def test_the_gears_are_led_only_when_asked():
    chain = CommandChain(30.0)
    chain.adopt(StageModel(StageAxis(backlash=0.02), StageAxis()), LIMIT, None)
    assert chain.send(Command(0.03, 0.0), lead=True).u_beta == pytest.approx(0.03)
    assert chain.sent.u_beta == pytest.approx(0.04)
    chain.send(Command(0.0, 0.0), lead=False)
    assert (chain.sent, chain.wanted) == (LEVEL, LEVEL)
