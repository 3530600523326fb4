"""Schedules of faults: what a file means, and one line with file and line for what it must not say."""

from __future__ import annotations

import pytest

from mazeplan.core.errors import SettingsError
from mazeplan.rigs.faults.kinds import AT_S, KINDS
from mazeplan.rigs.faults.schedule import load_schedule


def written(tmp_path, text):
    path = tmp_path / "faults.yaml"
    path.write_text(text)
    return path


def test_what_a_file_means(tmp_path):
    text = """# what is to go wrong
faults:
  - kind: frames_lost
    at_s: [0.5, 0.75]
  - {kind: servo_slow, at_s: 1, duration_s: 2, size: 10, axis: both, name: tired}
  - {kind: commands_late, name: tired}
  - {kind: frames_lost, at_s: 2, duration_s: 0.1}
"""
    trials = load_schedule(written(tmp_path, text))
    assert [trial.name for trial in trials] == ["frames_lost", "tired", "frames_lost 2"]
    (lost,) = trials[0].draw(4)
    assert lost.kind is KINDS["frames_lost"]
    assert 0.5 <= lost.at_s <= 0.75
    assert 0.6 <= lost.until_s - lost.at_s <= 1.5
    slow, late = trials[1].draw(4)
    assert (slow.at_s, slow.until_s, slow.size, slow.axes) == (1.0, 3.0, 10.0, (0, 1))
    assert AT_S[0] <= late.at_s <= AT_S[1]
    assert [len({trial.draw(seed)[0].at_s for seed in range(20)}) for trial in trials] == [20, 1, 1]


def test_one_number_in_a_file_does_not_shift_the_others(tmp_path):
    free, fixed = (
        load_schedule(written(tmp_path, f"faults:\n  - {{kind: servo_slow{more}}}\n"))[0].draw(3)[0]
        for more in ("", ", at_s: 0.9")
    )
    assert fixed.at_s == 0.9
    assert free.at_s != 0.9
    assert (fixed.size, fixed.axes, fixed.seed) == (free.size, free.axes, free.seed)
    assert fixed.until_s - fixed.at_s == pytest.approx(free.until_s - free.at_s)


@pytest.mark.parametrize(
    ("text", "line", "said"),
    [
        ("faults:\n  - {kind: explosion}\n", 2, "faults[0].kind: got 'explosion'"),
        ("faults:\n  - kind: tilt_nan\n    size: 3\n", 3, "faults[0].size: tilt_nan has no size"),
        ("faults:\n  - {at_s: 1}\n", 2, "faults[0].kind: is missing"),
    ],
)
def test_mistakes_are_one_line_with_place(tmp_path, text, line, said):
    path = written(tmp_path, text)
    with pytest.raises(SettingsError) as caught:
        load_schedule(path)
    message = str(caught.value)
    assert message.startswith(f"{path}:{line}: "), message
    assert said in message
    assert "\n" not in message
