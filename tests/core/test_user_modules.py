"""Modules of users are found in the current folder, and beside the file that names them."""

from __future__ import annotations

import sys

import pytest

from mazeplan.core.errors import InputError
from mazeplan.core.user_modules import user_module


@pytest.fixture(autouse=True)
def elsewhere(tmp_path, monkeypatch):
    """The current folder has no modules; what a test imports is forgotten behind it."""
    (tmp_path / "here").mkdir()
    monkeypatch.chdir(tmp_path / "here")
    monkeypatch.setattr(sys, "path", list(sys.path))
    before = set(sys.modules)
    yield
    for name in set(sys.modules) - before:
        del sys.modules[name]


@pytest.mark.parametrize("file", ["beside_a_file.py", "beside_a_file/__init__.py"])
def test_a_module_or_package_beside_the_file_that_names_it(tmp_path, file):
    folder = tmp_path / "there"
    (folder / file).parent.mkdir(parents=True)
    (folder / file).write_text("ANSWER = 42\n")
    with pytest.raises(InputError, match=r"cannot be imported: there is none of that name in .* or installed"):
        user_module("beside_a_file", "--system")
    assert user_module("beside_a_file", "--system", folder).ANSWER == 42


def test_a_folder_without_the_module_is_not_searched_later(tmp_path):
    with pytest.raises(InputError, match="--system: module 'beside_no_file' cannot be imported"):
        user_module("beside_no_file", "--system", tmp_path)
    assert str(tmp_path.resolve()) not in sys.path
