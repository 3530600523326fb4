"""`doctor`: packages that pyproject.toml requires, the emulated board, ports and browser."""

from __future__ import annotations

import json
import re
import tomllib
from email.message import Message

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
    assert list(found["packages"]) == list(groups)
    for extra, texts in groups.items():
        assert set(found["packages"][extra]) == {re.split(r"[^\w.-]", text)[0] for text in texts}
    assert set(doctor.FEATURES) == set(groups)
    assert found["needed"]["core"]["scipy"] == next(t for t in groups["core"] if "scipy" in t).removeprefix("scipy")
    assert found["features"]["core"]["ready"]


def test_an_old_package_is_named_with_the_needed_version(line, document, installed):
    installed(viser="0.2.1", torch="2.13.0+cpu")
    begin = "view      viser is 0.2.1, needed <2,>=1.1: the live page in the browser; to install it: pip install"
    assert line("view").startswith(begin)
    assert "'.[view]'" in line("view")
    assert line("learn").startswith("learn     ready: "), "the part after + does not count"
    features = document()["features"]
    view = features["view"]
    assert (view["ready"], view["missing"], view["too_old"]) == (False, [], ["viser"])
    assert features["learn"]["get"] is None


def test_a_missing_core_package_is_status_1(line, installed):
    installed(mujoco=None)
    assert line("core", status=1).startswith("core      mujoco is missing: ")


def test_without_a_checkout_the_installed_metadata_count(monkeypatch, tmp_path, project):
    expected = {extra: [str(r) for r in group] for extra, group in doctor.requirements().items()}
    package = Message()
    for text in [*project["dependencies"], "winonly>=1; sys_platform == 'no such system'"]:
        package["Requires-Dist"] = text
    for extra, texts in project["optional-dependencies"].items():
        package["Provides-Extra"] = extra
        for text in texts:
            package["Requires-Dist"] = f'{text}; extra == "{extra}"'
    monkeypatch.setattr(doctor, "metadata", lambda name: package)
    monkeypatch.setattr(doctor.resources, "CHECKOUT", tmp_path / "pyproject.toml")
    found = {extra: [str(r).split(";")[0] for r in group] for extra, group in doctor.requirements().items()}
    assert found == expected
    assert doctor.advice("view") == "pip install --upgrade 'mazeplan[view]'"
