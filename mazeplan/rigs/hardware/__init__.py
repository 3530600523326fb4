"""The real rig on the table, and its emulation: `class: mazeplan.rigs.hardware:HardwareRig` in a rig's file."""

from __future__ import annotations

from typing import Any


def __getattr__(name: str) -> Any:
    """The classes, once they are asked for: they bring camera and serial line with them."""
    if name == "HardwareRig":
        from mazeplan.rigs.hardware.rig import HardwareRig

        return HardwareRig
    if name == "EmulatedRig":
        from mazeplan.rigs.hardware.emulated import EmulatedRig

        return EmulatedRig
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
