"""Scripts of mishaps: what is read, and where an error is said to be."""

from __future__ import annotations

import pytest

from mazeplan.apps.testing.mishapfile import (
    AxisDead,
    BallPushed,
    BallStuck,
    BallTeleported,
    CameraBlind,
    OpeningBlocked,
    read_mishaps,
)
from mazeplan.core.errors import SettingsError
from mazeplan.maze.mapfile import load_map

MAZE = load_map("cme")
ALL = """\
- ball_stuck: {theta_deg: 30, from_s: 2.0, to_s: 3.1}
- opening_blocked: {opening: 2-3@90}
- camera_blind: {from_s: 1.0, to_s: 1.4}
- ball_pushed: {at_s: 1.2, speed_m_s: 0.2, direction_deg: 90}
- ball_teleported: {ring: 1, theta_deg: 120, in_ring: 3}
- axis_dead: {axis: gamma, from_s: 1.0, to_s: 2.0}
"""
READ = (
    BallStuck(theta_deg=30, from_s=2.0, to_s=3.1),
    OpeningBlocked(opening="2-3@90"),
    CameraBlind(from_s=1.0, to_s=1.4),
    BallPushed(at_s=1.2, speed_m_s=0.2, direction_deg=90),
    BallTeleported(ring=1, theta_deg=120, in_ring=3),
    AxisDead(axis="gamma", from_s=1.0, to_s=2.0),
)


def test_text_file_and_list_say_the_same(tmp_path):
    path = tmp_path / "mishaps.yaml"
    path.write_text(ALL, encoding="utf-8")
    assert read_mishaps(ALL, MAZE) == READ
    assert read_mishaps(path, MAZE) == READ
    assert read_mishaps(str(path), MAZE) == READ
    assert read_mishaps([*READ[:1], {"opening_blocked": {"opening": "2-3@90"}}, *READ[2:]], MAZE) == READ


@pytest.mark.parametrize(
    ("text", "error"),
    [
        ("- camera_blind: {}\n- ball_stuk: {}\n", "2: [1].ball_stuk: unknown mishap, expected one of ball_stuck, open"),
        ("- ball_stuck: {from_s: -1}\n", "1: [0].ball_stuck.from_s: got -1, expected greater than or equal to 0"),
        ("- ball_stuck: {theta_deg: nan}\n", "1: [0].ball_stuck.theta_deg: got nan, expected "),
        ("- opening_blocked: {}\n", "1: [0].opening_blocked.opening: is missing"),
        ("- ball_teleported: {ring: 6}\n", "1: [0].ball_teleported.ring: got 6, expected 1 to 5"),
        ("- axis_dead: {axis: x}\n", "1: [0].axis_dead.axis: got 'x', expected 'beta', 'gamma' or 'both'"),
        ("- ball_stuck\n", "1: [0]: got 'ball_stuck', expected one of ball_stuck, opening_blocked"),
        ("- camera_blind: {to_s: 1, to_s: 2}\n", "1: not valid YAML: got the key to_s twice"),
    ],
)
def test_errors_name_file_line_and_key(text, error, tmp_path):
    path = tmp_path / "mishaps.yaml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(SettingsError) as caught:
        read_mishaps(path, MAZE)
    assert str(caught.value).startswith(f"{path}:{error}")
    assert "\n" not in str(caught.value)


def test_a_file_that_is_not_there_and_text_are_told_apart():
    with pytest.raises(SettingsError, match=r"^stuck.yaml: no such file"):
        read_mishaps("stuck.yaml", MAZE)
    with pytest.raises(SettingsError, match=r"^mishaps:1: \[0\].ball: unknown mishap"):
        read_mishaps("- ball: {}", MAZE)
