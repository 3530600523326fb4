from __future__ import annotations

import os
import time

import pytest

from mazeplan.core.errors import InputError, MapError
from mazeplan.maze.yamltree import MAX_BYTES, key_path, parse_yaml, plain_value, read_yaml

BOMB = "a: &a [x, x]\nb: &b [*a, *a]\nc: [*b, *b]\n"


def refused(text: str) -> InputError:
    with pytest.raises(MapError) as caught:
        parse_yaml(text, file="f.yaml", error=MapError)
    assert "\n" not in str(caught.value)
    return caught.value


def test_data_and_lines():
    tree = parse_yaml("# head\na: 1\nb:\n  - {c: x}\n  - {c: 2.5,\n     d: true}\n", file="f")
    assert tree.data == {"a": 1, "b": [{"c": "x"}, {"c": 2.5, "d": True}]}
    assert tree.line(("a",)) == 2
    assert tree.line(("b", 0, "c")) == 4
    assert tree.line(("b", 1, "d")) == 6
    assert tree.line(("b", 1, "not there")) == 5


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("12", 12),
        ("010", 10),
        ("-1.5e3", -1500.0),
        (".5", 0.5),
        ("yes", "yes"),
        ("1:30", "1:30"),
        ("0x10", "0x10"),
        ("TRUE", True),
        ("~", None),
        ("", None),
        ("-.inf", float("-inf")),
        ("1e999", float("inf")),
        ("1234567890123456789", "1234567890123456789"),
    ],
)
def test_plain_values(text, value):
    found = plain_value(text)
    if text == "1234567890123456789":
        value = 1234567890123456789.0  # too long for an exact whole number
    assert found == value
    assert type(found) is type(value)


def test_quoted_numbers_stay_text():
    assert parse_yaml("a: \"12\"\nb: 'true'", file="f").data == {"a": "12", "b": "true"}


@pytest.mark.parametrize(
    ("text", "line", "words"),
    [
        ("", None, "empty"),
        ("# only a comment\n", None, "empty"),
        ("a: 1\n\tb: 2\n", 2, "got a tab"),
        ("a: 1\nb: 2\na: 3\n", 3, "twice, first in line 1"),
        ("x:\n  - {a: 1, a: 2}\n", 2, "twice"),
        (BOMB, 1, "anchors"),
        ("a: 1\nb: *a\n", 2, "aliases"),
        ("a: !!python/object/apply:os.system [x]\n", 1, "tags"),
        ("!x a: 1\n", 1, "tags"),
        ("a: {\n", 2, "not valid YAML"),
        ("a: 1: 2\n", 1, "not valid YAML: mapping values"),
        ("a: 'x\nb:3\n", 1, "not valid YAML: found unexpected end"),
        ("? [a]\n: b\n", 1, "key"),
        ("a: 1\n---\nb: 2\n", 2, "another document"),
        ("a: 1\nb: \x00\n", 2, "not allowed"),
        ("[" * 5000, 1, "deep"),
        ("\n".join(f"k{i}: 1" for i in range(30_000)), 20_000, "20000 entries"),
    ],
)
def test_refusals(text, line, words):
    error = refused(text)
    assert words in str(error)
    assert error.line == line


def test_tab_in_a_comment_is_allowed():
    assert parse_yaml("a: 1 #\tindeed\n", file="f").data == {"a": 1}


@pytest.mark.parametrize(
    "text",
    [
        "#" * MAX_BYTES,
        "x" * MAX_BYTES,
        '"' + "\\" * (MAX_BYTES - 1),
        "- " * (MAX_BYTES // 2),
        "? " * (MAX_BYTES // 2),
        "{" * MAX_BYTES,
        "{a: " * (MAX_BYTES // 4),
        "a b\n" * (MAX_BYTES // 4),
        "a: |\n" + "  b\n" * (MAX_BYTES // 4),
        "%A b\n" * (MAX_BYTES // 5),
    ],
)
def test_large_nonsense_is_refused_at_once(text):
    begin = time.perf_counter()
    refused(text)
    assert time.perf_counter() - begin < 5.0  # a bound for a bomb, not a measure of speed


def test_files(tmp_path):
    def error(path) -> str:
        with pytest.raises(MapError) as caught:
            read_yaml(path, error=MapError)
        return str(caught.value)

    assert "no such file" in error(tmp_path / "none.yaml")
    assert "folder" in error(tmp_path)
    (tmp_path / "latin.yaml").write_bytes(b"a: 1\nb: \xe9\n")
    assert "latin.yaml:2: got" in error(tmp_path / "latin.yaml")
    (tmp_path / "binary.yaml").write_bytes(bytes(range(256)))
    assert "expected a YAML file" in error(tmp_path / "binary.yaml")
    os.mkfifo(tmp_path / "pipe.yaml")
    assert "expected a YAML file" in error(tmp_path / "pipe.yaml")
    (tmp_path / "good.yaml").write_bytes(b"\xef\xbb\xbfa: 1\r\nb: 2\r\n")
    assert read_yaml(tmp_path / "good.yaml").data == {"a": 1, "b": 2}


def test_file_of_100_mb_is_refused_unread(tmp_path):
    path = tmp_path / "huge.yaml"
    with path.open("wb") as stream:
        stream.truncate(100_000_000)
    begin = time.perf_counter()
    with pytest.raises(MapError, match="got 100000000 bytes, expected a YAML file of at most"):
        read_yaml(path, error=MapError)
    assert time.perf_counter() - begin < 2.0  # it is not read


def test_key_path():
    assert key_path(("openings", 0, "angle_deg")) == "openings[0].angle_deg"
    assert key_path(("a b\n",)) == r"'a b\n'"
