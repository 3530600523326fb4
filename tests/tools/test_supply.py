"""The tools that watch over what mazeplan needs: licences, pins, lowest versions, and the wheel elsewhere."""

from __future__ import annotations

import re
import sys

import check_pins
import licences
import pytest
import try_wheel
from dependencies import BASE
from lowest import direct, lowest
from packaging.version import Version

HERE = pytest.mark.skipif(
    (sys.platform, *sys.version_info[:2]) != ("linux", 3, 11),
    reason="constraints.txt is written by Python 3.11 on Linux; others need other packages",
)


@pytest.fixture(scope="module")
def groups():
    return licences.groups()


@pytest.mark.slow
def test_every_dependency_has_a_known_licence_and_the_base_install_no_copyleft(groups):
    assert licences.problems(groups) == []
    names = {one.name.lower() for one in groups[BASE]}
    assert {"numpy", "mujoco", "pydantic_core", "llvmlite"} <= names, "those that others bring, too"
    assert all(one.version for one in groups[BASE])


@HERE
def test_all_that_is_pinned_is_needed_and_all_that_is_needed_is_pinned():
    pinned = check_pins.pins(check_pins.FILE.read_text(encoding="utf-8"))
    assert len(pinned) > 100
    lines = check_pins.problems(pinned, check_pins.needed())
    other = [line for line in lines if ", installed " in line and "not pinned" not in line]  # a newer one may be tried
    assert sorted(set(lines) - set(other)) == []


def test_every_direct_dependency_has_a_lowest_version():
    text = (check_pins.ROOT / "pyproject.toml").read_text(encoding="utf-8")
    found = lowest(direct(text))
    pinned = {name.lower().replace("_", "-"): v for name, v in check_pins.pins(check_pins.FILE.read_text()).items()}
    assert {"numpy", "torch", "viser", "cma"} <= set(found)
    for name in set(found) & set(pinned):
        assert found[name] <= Version(pinned[name]), name


def test_the_commands_of_readme_are_tried_in_their_order():
    commands = [command for command, _ in try_wheel.shown()]
    assert len(commands) > 8
    assert commands[0].startswith("mazeplan navigate")
    assert any(command.startswith("Python of line") for command in commands)
    assert not any(command.startswith("make") for command in commands)
    assert not any(re.match(r"(cp|cat) (maps|behaviors|examples|docs)/", command) for command in commands), (
        "no clone there"
    )
