"""The rig on a table: `class: mazeplan.rigs.hardware:HardwareRig` in a rig's file."""

from __future__ import annotations

from importlib import import_module
from typing import Any

from mazeplan.core.errors import RigError
from mazeplan.core.resources import to_install

CLASS = "HardwareRig"


def __getattr__(name: str) -> Any:
    """The class, imported on first use: it needs OpenCV and pyserial. Raises RigError that says what to install."""
    if name != CLASS:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    try:
        return getattr(import_module("mazeplan.rigs.hardware.rig"), name)
    except ModuleNotFoundError as missing:
        if missing.name not in ("cv2", "serial"):
            raise
        raise RigError(f"a rig on a table needs {missing.name}: {to_install('hardware')}") from None
