"""A name that is nearly a known one is answered with that one."""

from __future__ import annotations

import pytest

from mazeplan.core.errors import nearest, one_of

NAMES = ("dry_friction", "viscous_friction", "servo_gain")


@pytest.mark.parametrize("got", ["dry-friction", "Dry Friction", "dry_fricton", "DRY_FRICTION"])
def test_a_slip_is_answered(got):
    assert nearest(got, NAMES) == "dry_friction"
    assert one_of(NAMES, got).endswith("servo_gain; did you mean dry_friction?")


@pytest.mark.parametrize("got", ["magnet", "", 3, None, "servo_gain"])
def test_what_is_no_slip_gets_the_names_alone(got):
    assert one_of(NAMES, got) == "one of dry_friction, viscous_friction, servo_gain"
