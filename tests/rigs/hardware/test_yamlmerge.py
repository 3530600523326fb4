"""A section is written into a file, and every comment of it is still there."""

from __future__ import annotations

import re

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mazeplan.core.errors import SettingsError
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


def test_a_file_without_keys_is_refused():
    with pytest.raises(SettingsError, match=r"f\.yaml"):
        put("[1, 2]\n", "b", 2)


words = st.text("abcdefgh_", min_size=1, max_size=5).filter(lambda w: w not in ("null", "true", "false"))
scalars = st.one_of(st.integers(-99, 99), st.floats(-9, 9).map(lambda v: round(v, 3)), words, st.booleans(), st.none())
values = st.recursive(
    scalars,
    lambda inner: st.one_of(st.lists(inner, max_size=3), st.dictionaries(words, inner, max_size=4)),
    max_leaves=8,
)
sections = st.dictionaries(words, st.dictionaries(words, values, min_size=1, max_size=4), min_size=1, max_size=4)


@st.composite
def texts(draw):
    """YAML with a comment behind or above many of its lines, blocks and flows by chance."""
    data, lines, number = draw(sections), [], 0

    def comment():
        nonlocal number
        number += 1
        return f"# c{number}{draw(st.sampled_from(['', ': x', ' - [', ' # y']))}"

    def add(line):
        if draw(st.booleans()):
            lines.append(" " * draw(st.integers(0, 4)) + comment())
        lines.append(line + (f"  {comment()}" if draw(st.booleans()) else ""))

    def flow(value):
        if isinstance(value, dict):
            return "{" + ", ".join(f"{k}: {flow(v)}" for k, v in value.items()) + "}"
        if isinstance(value, list):
            return "[" + ", ".join(map(flow, value)) + "]"
        return {True: "true", False: "false", None: "null"}[value] if isinstance(value, bool | None) else str(value)

    def walk(mapping, indent):
        for key, value in mapping.items():
            if isinstance(value, dict) and value and draw(st.booleans()):
                add(f"{' ' * indent}{key}:")
                walk(value, indent + 2)
            elif isinstance(value, list) and value and draw(st.booleans()):
                add(f"{' ' * indent}{key}:")
                for item in value:
                    add(f"{' ' * indent}- {flow(item)}")
            elif isinstance(value, list | dict) and value and draw(st.booleans()):
                first, *rest = re.split(r"(?<=,) ", flow(value))
                add(f"{' ' * indent}{key}: {first}")
                for part in rest:
                    add(f"{' ' * (indent + 4)}{part}")
            else:
                add(f"{' ' * indent}{key}: {flow(value)}")

    walk(data, 0)
    return "\n".join(lines) + "\n", number


@pytest.mark.slow
@settings(max_examples=150, deadline=None)
@given(texts(), sections)
def test_every_comment_is_kept_and_the_text_says_what_was_written(made, others):
    text, comments = made
    data = parse_yaml(text, file="f").data
    for key, value in others.items():
        text = put(text, key, value)
        data[key] = parse_yaml(put("x: 1\n", key, value), file="f").data[key]
    assert parse_yaml(text, file="f").data == data
    assert sorted(re.findall(r"# c(\d+)", text), key=int) == [str(i + 1) for i in range(comments)]


@pytest.mark.slow
@settings(max_examples=100, deadline=None)
@given(texts(), st.data())
def test_so_it_is_where_a_key_of_the_file_gets_a_part_of_its_value_anew(made, data):
    text, comments = made
    old = parse_yaml(text, file="f").data
    key = data.draw(st.sampled_from(sorted(old)))
    value = {k: v for k, v in old[key].items() if data.draw(st.booleans())} | data.draw(
        st.dictionaries(words, values, max_size=2)
    )
    new = put(text, key, value)
    assert parse_yaml(new, file="f").data == {**old, key: parse_yaml(put("x: 1\n", key, value), file="f").data[key]}
    assert sorted(re.findall(r"# c(\d+)", new), key=int) == [str(i + 1) for i in range(comments)]
