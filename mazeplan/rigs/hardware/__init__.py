"""The real rig on the table, and its emulation: `class: mazeplan.rigs.hardware:HardwareRig` in a rig's file."""

from __future__ import annotations

from importlib import import_module
from typing import Any

from mazeplan.errors import RigError
from mazeplan.resources import to_install

WHERE = {"HardwareRig": "rig", "EmulatedRig": "emulated"}


def __getattr__(name: str) -> Any:
    """The classes, once they are asked for: they bring camera and serial line with them. Raises RigError that says what
    to install."""
    if name not in WHERE:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    try:
        return getattr(import_module(f"{__name__}.{WHERE[name]}"), name)
    except ModuleNotFoundError as missing:
        if missing.name not in ("cv2", "serial"):
            raise
        raise RigError(f"a rig on a table needs {missing.name}: {to_install('hardware')}") from None
