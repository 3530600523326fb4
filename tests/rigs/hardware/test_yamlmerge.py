"""A section is written into a file, and every comment of it is still there."""

from __future__ import annotations

from mazeplan.maze.yamltree import parse_yaml
from mazeplan.rigs.hardware.yamlmerge import merged

TEXT = """\
# mine
class: mazeplan.rigs.hardware:HardwareRig
port: /dev/ttyACM0   # the blue one

tilt:   # old
  # in V
  centre_v: [2.5, 2.5]   # of the middle
  beta_deg: {one: 1.0,   # at level
    a: 3.0}
  note: 'a # that is none'
  # of last year

# what follows is the camera
camera:
  source: 0
"""


def put(text, key, value):
    return merged(text, key, value, file="f.yaml")


def test_values_come_over_values_and_other_lines_stay():
    text = put(TEXT, "tilt", {"centre_v": [2.4, 2.6], "beta_deg": {"one": 2.0}, "date": "today"})
    assert "  centre_v: [2.4, 2.6]   # of the middle\n" in text
    assert "port: /dev/ttyACM0   # the blue one\n" in text
    assert parse_yaml(text, file="f").data["tilt"] == {
        "centre_v": [2.4, 2.6], "beta_deg": {"one": 2.0}, "date": "today",
    }  # fmt: skip
    assert put(TEXT, "latency", {"camera_ms": 5.0}).endswith("latency: {camera_ms: 5.0}\n")


def test_comments_of_what_leaves_and_of_what_follows_are_kept():
    text = put(TEXT, "tilt", {"centre_v": [2.4, 2.6]})
    assert parse_yaml(text, file="f").data["tilt"] == {"centre_v": [2.4, 2.6]}
    for comment in ("# old", "# in V", "# at level", "# of last year", "# what follows is the camera"):
        assert text.count(comment) == 1
    assert "# that is none" not in text
