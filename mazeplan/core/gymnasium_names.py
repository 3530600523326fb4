"""Registers the environment with Gymnasium, as soon as a program imports both mazeplan and Gymnasium.

`import mazeplan` does not import Gymnasium. A finder waits until the program imports it. Only names are registered; the
modules load when an environment is made. Since version 1.0, Gymnasium has no entry points for other packages.
"""

from __future__ import annotations

import sys
from importlib.abc import MetaPathFinder
from importlib.machinery import ModuleSpec
from importlib.util import find_spec
from types import ModuleType
from typing import Any

ID = "mazeplan/CircularMaze-v1"
STEPS = 600  # after which an episode is cut off: 20 s at 30 Hz, as for `navigate`


def register(gymnasium: Any) -> None:
    """Register the environment; a second call changes nothing."""
    if ID not in gymnasium.registry:
        gymnasium.register(
            ID,
            entry_point="mazeplan.apps.environment.single:CircularMazeEnv",
            max_episode_steps=STEPS,
        )


class _Waiting(MetaPathFinder):
    """Finds Gymnasium as usual, and registers the environments when Gymnasium has been loaded."""

    def find_spec(self, fullname: str, path: object = None, target: ModuleType | None = None) -> ModuleSpec | None:
        if fullname != "gymnasium":
            return None
        if self in sys.meta_path:
            sys.meta_path.remove(self)
        spec = find_spec(fullname)
        loader: Any = None if spec is None else spec.loader
        if loader is None:
            return spec
        load = loader.exec_module

        def load_and_register(module: ModuleType) -> None:
            vars(loader).pop("exec_module", None)
            load(module)
            if hasattr(module, "register") and hasattr(module, "registry"):
                register(module)

        loader.exec_module = load_and_register
        return spec


def install() -> None:
    """Register now if Gymnasium has been imported, else when it is imported. A second call changes nothing."""
    loaded = sys.modules.get("gymnasium")
    if loaded is not None and hasattr(loaded, "registry"):
        register(loaded)
    elif not any(isinstance(finder, _Waiting) for finder in sys.meta_path):
        sys.meta_path.insert(0, _Waiting())
