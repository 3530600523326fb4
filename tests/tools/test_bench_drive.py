"""The bench of navigation: what it changes is allowed."""

from __future__ import annotations

import bench_drive
import pytest


def test_each_part_that_is_left_out_has_settings_that_are_allowed(monkeypatch):
    asked = []
    monkeypatch.setattr(bench_drive, "runs_on", lambda rig, runs, **how: asked.append((rig, runs, how["settings"])))
    for _, _, outcomes in bench_drive.parts(3):
        outcomes()
    assert {(rig, runs) for rig, runs, _ in asked} == {("toy", 3)}
    assert len({settings.text() for _, _, settings in asked}) >= 4, "the parts differ in their settings"


def test_a_part_with_a_value_out_of_its_limits_shows_at_once(monkeypatch):
    class Refusing:
        def with_values(self, sections):
            raise ValueError("out of limits")

    monkeypatch.setattr(bench_drive, "load_settings", Refusing)
    with pytest.raises(ValueError, match="out of limits"):
        bench_drive.parts(3)
