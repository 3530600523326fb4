"""Where compiled code goes when nothing may be written."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

import mazeplan.cli
from mazeplan.cli import keep_compiled


@pytest.fixture(autouse=True)
def clean(monkeypatch):
    monkeypatch.delenv("NUMBA_CACHE_DIR", raising=False)
    yield
    os.environ.pop("NUMBA_CACHE_DIR", None)


@pytest.mark.parametrize("may", ["package", "cache"])
def test_nothing_changes_where_one_of_the_usual_places_will_do(monkeypatch, may):
    package = Path(mazeplan.cli.__file__).parent
    monkeypatch.setattr(os, "access", lambda place, mode: (Path(place) == package) == (may == "package"))
    keep_compiled()
    assert "NUMBA_CACHE_DIR" not in os.environ


def test_else_a_folder_of_its_own_is_used_and_said(monkeypatch, capsys):
    monkeypatch.setattr(os, "access", lambda place, mode: False)
    keep_compiled()
    place = Path(os.environ["NUMBA_CACHE_DIR"])
    assert place.is_dir()
    assert "NUMBA_CACHE_DIR" in capsys.readouterr().err
    place.rmdir()


def test_what_the_user_has_set_stays(monkeypatch):
    monkeypatch.setenv("NUMBA_CACHE_DIR", "/mine")
    monkeypatch.setattr(os, "access", lambda place, mode: False)
    keep_compiled()
    assert os.environ["NUMBA_CACHE_DIR"] == "/mine"
