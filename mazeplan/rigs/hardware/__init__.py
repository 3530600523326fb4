"""The rig on a table: `class: mazeplan.rigs.hardware:HardwareRig` in a rig's file."""

from __future__ import annotations

from typing import Any

from mazeplan.core.errors import RigError
from mazeplan.core.resources import to_install


def __getattr__(name: str) -> Any:
    """The class, imported on first use: it needs OpenCV and pyserial. Raises RigError that says what to install."""
    if name != "HardwareRig":
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    try:
        from mazeplan.rigs.hardware.rig import HardwareRig
    except ModuleNotFoundError as missing:
        raise RigError(f"a rig on a table needs {missing.name}: {to_install('hardware')}") from None
    return HardwareRig
