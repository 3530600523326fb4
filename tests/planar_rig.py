"""The light rig of the test kit under the name by which the tests of runs know it, its model, and settings without a
deadline in wall time: or what a run does would depend on how busy the machine is.
"""

from __future__ import annotations

from mazeplan.apps.testing.lightrig import LightRig as PlanarRig
from mazeplan.apps.testing.lightrig import identified as known
from mazeplan.run.settings import load_settings

__all__ = ["PATIENT", "PlanarRig", "known"]

PATIENT = load_settings().with_values({"travel": {"deadline_ms": 1e6}})
