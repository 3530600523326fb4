"""`doctor`: packages that pyproject.toml requires, the emulated board, ports and browser."""

from __future__ import annotations

import json
import re
import tomllib

import pytest

from mazeplan.apps.cli import doctor


@pytest.fixture
def line(call):
    """The line of `doctor` that begins with a word; "" without one."""

    def line(word, status=0):
        code, out, _ = call("doctor")
        assert code == status
        return next((text for text in out.splitlines() if text.startswith(f"{word} ")), "")

    return line


@pytest.fixture
def document(call):
    return lambda: json.loads(call("doctor", "--json")[1])


@pytest.fixture
def installed(monkeypatch):
    """Pretend that these versions are installed; None: not installed."""
    real = doctor.installed

    def pretend(**versions):
        changed = {name.replace("_", "-"): value for name, value in versions.items()}
        known = lambda package: changed[package] if package in changed else real(package) or "999"  # noqa: E731
        monkeypatch.setattr(doctor, "installed", known)

    return pretend


@pytest.fixture
def project():
    return tomllib.loads(doctor.resources.CHECKOUT.read_text(encoding="utf-8"))["project"]


def test_every_package_of_pyproject_is_checked_and_every_extra_is_described(document, project):
    groups = {"core": project["dependencies"], **project["optional-dependencies"]}
    found = document()
    assert list(found["features"]) == list(groups)
    for extra, texts in groups.items():
        names = {re.split(r"[^\w.-]", text)[0] for text in texts}
        assert set(found["features"][extra]["packages"]) == names
        assert found["features"][extra]["what"]
    assert found["features"]["core"]["ready"]


def test_a_missing_core_package_is_status_1(line, installed):
    installed(mujoco=None)
    assert line("core", status=1).startswith("core      mujoco is missing: ")
