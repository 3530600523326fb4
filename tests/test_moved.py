"""Modules under the names that they had in earlier versions."""

from __future__ import annotations

import importlib
import subprocess
import sys
import warnings

import pytest

from mazeplan.core.moved import MOVED, install, new_place


@pytest.mark.parametrize("name", sorted(MOVED))
def test_an_earlier_name_loads_the_module_at_its_new_place_with_a_warning(name):
    above = name.rpartition(".")[0]
    if above:  # it has moved, too, and warns when it is loaded first
        with warnings.catch_warnings(action="ignore"):
            importlib.import_module(f"mazeplan.{above}")
    sys.modules.pop(f"mazeplan.{name}", None)
    with pytest.warns(DeprecationWarning, match=f"mazeplan.{name} has moved: import mazeplan.{MOVED[name]}"):
        found = importlib.import_module(f"mazeplan.{name}")
    assert found is importlib.import_module(f"mazeplan.{MOVED[name]}")
    assert found.__spec__.name == f"mazeplan.{MOVED[name]}"


def test_a_module_is_never_loaded_twice_under_two_names():
    code = "from mazeplan.errors import MapError as a; from mazeplan.core.errors import MapError as b; print(a is b)\n"
    code += "from mazeplan.models.modelfile import RigModel as a\n"
    code += "from mazeplan.learning.modelfile import RigModel as b; print(a is b)"
    done = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True)
    assert done.stdout == "True\nTrue\n"


def test_names_that_never_moved_are_left_alone():
    assert new_place("mazeplan.maze.geometry") is None
    assert new_place("numpy.errors") is None
    assert new_place("mazeplan") is None
    install()
    assert [type(finder).__name__ for finder in sys.meta_path].count("_Finder") == 1
    with pytest.raises(ModuleNotFoundError, match=r"mazeplan\.never_there"):
        importlib.import_module("mazeplan.never_there")
