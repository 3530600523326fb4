"""A model that does not know all rings of a map is used with a warning."""

from __future__ import annotations

from dataclasses import replace

import pytest

from mazeplan.core.errors import ShortWarning
from mazeplan.learning.modelfile import RigModel, load_model, save_model
from mazeplan.maze.mapfile import load_map
from mazeplan.run.resolve import resolve_model


def test_rings_that_a_model_does_not_know_are_told(tmp_path):
    maze, model = load_map("cme"), RigModel.nominal(load_map("cme"))
    save_model(replace(model, balls={1: model.ball(1)}), tmp_path / "own")
    with pytest.warns(ShortWarning, match=r"own does not know ring 2, 3, 4 of the map cme: numbers of the nearest"):
        found = resolve_model(tmp_path / "own", None, maze)
    assert found == load_model(tmp_path / "own")
    save_model(model, tmp_path / "whole")
    resolve_model(tmp_path / "whole", None, maze)  # a warning would be an error
