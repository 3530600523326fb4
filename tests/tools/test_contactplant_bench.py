"""How the bench over drawn rigs with contact counts verdicts."""

from __future__ import annotations

import pytest
from contact_outcomes import NULL, Job, Outcome


def outcome(effect, names=(), verdict="effect_found", alike=(), sizes=None, size=1):
    job = Job(0, effect, size, 0)
    return Outcome(job, verdict, list(names), [list(group) for group in alike], sizes or {}, 1.0, 0.3, 0.1, 40.0)


@pytest.mark.parametrize(
    ("done", "called"),
    [
        (outcome(NULL, verdict="nothing_missing"), "right"),
        (outcome(NULL, verdict="unknown_effect"), "unknown"),
        (outcome(NULL, ["deadband"]), "wrong names"),
        (outcome("lost_pictures", verdict="nothing_missing"), "right"),
        (outcome("dry_friction", ["dry_friction"]), "right"),
        (outcome("dry_friction", ["dry_friction", "deadband"]), "also wrong names"),
        (outcome("dry_friction", ["viscous_friction"]), "wrong names"),
        (outcome("dry_friction", ["viscous_friction"], alike=[("viscous_friction", "dry_friction")]), "right"),
        (outcome("dry_friction", verdict="nothing_missing"), "silent"),
        (outcome("dry_friction", verdict="unknown_effect"), "unknown"),
        (outcome("constant_force", ["tilt_offset"]), "right"),
        (outcome("servo_gain", ["servo_gain", "tilt_gain"]), "right"),
        (outcome("servo_gain", ["tilt_gain"]), "wrong names"),
    ],
)
def test_verdicts_are_counted_by_the_names_that_are_right(done, called):
    assert done.outcome == called


def test_sizes_are_right_within_a_share_of_the_change_or_standard_errors():
    assert outcome("dry_friction").size_right is None
    near = {"dry_friction.coefficient": [0.9, 0.99, 0.01, 0.3]}  # true, told, standard error, before
    assert outcome("dry_friction", sizes=near).size_right is True
    assert outcome("dry_friction", sizes=near).inside == [False]
    far = {"dry_friction.coefficient": [0.9, 1.1, 0.01, 0.3]}
    assert outcome("dry_friction", sizes=far).size_right is False
    unsure = {"dry_friction.coefficient": [0.9, 1.1, 0.11, 0.3]}
    assert outcome("dry_friction", sizes=unsure).size_right is True
    assert outcome("dry_friction", sizes=unsure).inside == [True]
