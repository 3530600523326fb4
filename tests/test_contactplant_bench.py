"""How the bench over drawn rigs with contact counts verdicts, and that it goes on where it was interrupted."""

from __future__ import annotations

import json
from dataclasses import asdict

import bench_contactplant as bench
import pytest
from bench_contactplant import Job, Outcome, jobs_of, kept, report
from contacteffects import EFFECTS


def outcome(effect, names=(), verdict="effect_found", alike=(), sizes=None, size=1):
    job = Job(0, effect, size, 0)
    return Outcome(job, verdict, list(names), [list(group) for group in alike], sizes or {}, 1.0, 0.3, 0.1, 40.0)


@pytest.mark.parametrize(
    ("done", "called"),
    [
        (outcome(bench.NULL, verdict="nothing_missing"), "right"),
        (outcome(bench.NULL, verdict="unknown_effect"), "unknown"),
        (outcome(bench.NULL, ["deadband"]), "wrong names"),
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


def test_the_table_has_every_size_of_every_effect_on_different_rigs():
    jobs = jobs_of(4, 2, 3)
    assert len(jobs) == len(set(jobs)) == 4 * 3 + 2 * 3 * len(EFFECTS)
    for name in EFFECTS:
        assert len({job.rig for job in jobs if job.effect == name}) >= 3
    assert {job.effect for job in jobs_of(2, 1, 1, ["backlash"])} == {bench.NULL, "backlash"}


def test_what_is_in_the_file_is_not_done_again(tmp_path, monkeypatch):
    path, done = tmp_path / "kept.jsonl", []

    def played(jobs):
        for job in jobs:
            done.append(job)
            yield Outcome(job, "nothing_missing", [], [], {}, 1.0, 0.1, 0.1, 1.0)

    monkeypatch.setattr(bench, "of_rig", played)
    jobs = jobs_of(2, 1, 1, ["backlash"])
    first = Outcome(jobs[0], "effect_found", ["deadband"], [], {}, 1.0, 0.1, 0.1, 1.0)
    path.write_text(json.dumps(asdict(first)) + "\n" + '{"job": {"rig"')  # cut short while it was written
    assert kept(path) == {first.job: first}
    got = bench.run(jobs, path, 1)
    assert [o.job for o in got] == jobs
    assert sorted(map(str, done)) == sorted(map(str, jobs[1:]))
    assert bench.run(jobs, path, 1) == got
    assert len(done) == len(jobs) - 1
    assert any("alarms where nothing changed" in line for line in report(got))
