"""The wheel holds every file that the program reads, and nothing else."""

from __future__ import annotations

import subprocess
import sys
import zipfile
from email.parser import HeaderParser
from pathlib import Path, PurePosixPath

import pytest

pytest.importorskip("build", reason="needs the package build: pip install -e '.[dev]'")
pytest.importorskip("hatchling", reason="needs the package hatchling: pip install -e '.[dev]'")

ROOT = Path(__file__).resolve().parents[2]
SHARED = {"maps": "mazeplan/_share/maps", "behaviors": "mazeplan/_share/behaviors"}


def files(folder: str, place: str) -> set[str]:
    """Names in the wheel of the files of a folder of the clone; place: of the folder."""
    paths = (path for path in (ROOT / folder).rglob("*") if path.is_file() and "__pycache__" not in path.parts)
    return {str(PurePosixPath(place) / path.relative_to(ROOT / folder).as_posix()) for path in paths}


@pytest.fixture(scope="module")
def wheel(tmp_path_factory):
    place = tmp_path_factory.mktemp("wheel")
    words = [sys.executable, "-m", "build", "--wheel", "--no-isolation", "--outdir", str(place), str(ROOT)]
    done = subprocess.run(words, capture_output=True, text=True, cwd=place, check=False)
    assert done.returncode == 0, done.stderr
    (path,) = place.glob("*.whl")
    with zipfile.ZipFile(path) as archive:
        yield archive


def test_the_wheel_holds_all_package_data(wheel):
    expected = files("mazeplan", "mazeplan")
    for folder, place in SHARED.items():
        expected |= files(folder, place)
    kinds = {
        "_share/maps/cme.yaml", "_share/behaviors/navigate.xml", "rigs/toy.yaml", "rigs/hardware.yaml",
        "learning/packaged/toy/model.yaml", "learning/packaged/toy/ring1.npz", "learning/packaged/toy/reference.yaml",
        "run/settings.yaml", "apps/cli/newrig/rig.py.jinja",
    }  # fmt: skip
    assert {f"mazeplan/{name}" for name in kinds} <= expected, "the clone itself lacks a file"
    names = set(wheel.namelist())
    assert sorted(expected - names) == []
    strange = {name for name in names - expected if ".dist-info/" not in name}
    assert sorted(strange) == []


def test_the_wheel_says_what_it_needs(wheel):
    (name,) = (name for name in wheel.namelist() if name.endswith(".dist-info/METADATA"))
    about = HeaderParser().parsestr(wheel.read(name).decode())
    assert about["Name"] == "mazeplan"
    assert about["License-Expression"] == "Apache-2.0"
    assert about["Requires-Python"] == ">=3.11"
    needed = about.get_all("Requires-Dist") or []
    base = [text for text in needed if "extra ==" not in text]
    assert any(text.startswith("mujoco") for text in base)
    assert not any(text.startswith("torch") for text in base), "an extra, as it is large"
    assert {"learn", "view", "hardware", "campaign"} <= set(about.get_all("Provides-Extra") or [])
