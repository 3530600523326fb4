"""Module names of earlier versions: they load the module at its new place, with a DeprecationWarning.

`import mazeplan` installs the finder. Only names that the documentation has shown are kept.
"""

from __future__ import annotations

import importlib
import sys
import warnings
from importlib.abc import Loader, MetaPathFinder
from importlib.machinery import ModuleSpec
from types import ModuleType

MOVED = {  # earlier name: today's, each without "mazeplan."
    "campaign": "run.campaign",
    "collect": "run.collect",
    "compare": "learning.comparison",
    "data": "core.logs",
    "data.runlog": "core.logs.run_log",
    "data.runlog_reader": "core.logs.run_log_reader",
    "data.smoothing": "learning.smoothing",
    "diagnosis.diagnose": "diagnosis.ring.diagnose",
    "display": "core.display",
    "environment": "apps.environment",
    "errors": "core.errors",
    "evaluate": "run.campaign.evaluate",
    "faultcampaign": "run.campaign.faults",
    "goals": "run.goals",
    "improve": "run.campaign.improve",
    "models": "learning",
    "models.learned": "learning.ball_models",
    "models.processfile": "learning.gp_file",
    "models.rig_learning": "learning.rig_gp",
    "navigation": "run.navigate",
    "physics.plate": "physics.dynamics.plate",  # these three: Numba's caches of earlier versions name them
    "physics.rigid_body": "physics.dynamics.rigid_body",
    "physics.walls": "physics.dynamics.walls",
    "records": "core.records",
    "replay": "run.replay",
    "rigs.faultkinds": "rigs.faults.kinds",
    "rigs.faultschedule": "rigs.faults.schedule",
    "rigs.faulty": "rigs.faults.faulty",
    "rigs.fleet": "rigs.sim.fleet",
    "rigs.hardware.chip": "rigs.emulation.chip",
    "rigs.settings": "rigs.sim.settings",
    "rigs.simulated": "rigs.sim.simulated",
    "rigs.surprise": "rigs.sim.surprise",
    "rigs.usermodel": "rigs.sim.usermodel",
    "settings": "run.settings",
    "testing": "apps.testing",
}


class _Alias(Loader):
    """Loads the module at its new place and hands it on under the earlier name."""

    def __init__(self, place: str) -> None:
        self.place = place
        self.spec: ModuleSpec | None = None

    def create_module(self, spec: ModuleSpec) -> ModuleType:
        warnings.warn(f"{spec.name} has moved: import {self.place}", DeprecationWarning, stacklevel=2)
        module = importlib.import_module(self.place)
        self.spec = module.__spec__
        return module

    def exec_module(self, module: ModuleType) -> None:
        """Put back the module's spec, which importing has replaced. The module has already run at its new place."""
        module.__spec__ = self.spec


class _Finder(MetaPathFinder):
    """Finds modules by their earlier names."""

    def find_spec(self, fullname: str, path: object = None, target: ModuleType | None = None) -> ModuleSpec | None:
        place = new_place(fullname)
        return None if place is None else ModuleSpec(fullname, _Alias(place))


def new_place(name: str) -> str | None:
    """Where a module of an earlier version is today; None for a name that has not moved."""
    package, _, rest = name.partition(".")
    if package != "mazeplan" or not rest:
        return None
    parts = rest.split(".")
    for k in range(len(parts), 0, -1):
        known = MOVED.get(".".join(parts[:k]))
        if known is not None:
            return ".".join(["mazeplan", known, *parts[k:]])
    return None


def install() -> None:
    """Let imports find modules by their earlier names. A second call changes nothing."""
    if not any(isinstance(finder, _Finder) for finder in sys.meta_path):
        sys.meta_path.insert(0, _Finder())  # before the finder that would load a moved package's file a second time
