"""Settings of an emulated rig's file."""

from __future__ import annotations

from typing import Any

from pydantic import Field

from mazeplan.maze.sections import Section
from mazeplan.rigs.hardware.settings import HardwareSettings


class WorldSettings(Section):
    """The section `world:` of an emulated rig's file.

    `seed` draws the true servos, diode and camera. No file has these true values."""

    seed: int = Field(default=1, ge=0)
    physics: dict[str, Any] = Field(default_factory=dict, description="of the machine: keys of a simulated rig")
    camera_delay_ms: float = Field(default=50.0, ge=25.0, le=250.0, description="from the shutter to this program")
    diode_noise_mv: float = Field(default=4.0, ge=0.0, le=200.0, description="of each conversion")
    look: dict[str, Any] = Field(default_factory=dict, description="of the pictures: noise, blur, gloss, exposure ...")
    trace: str | None = Field(default=None, description="CSV file that gets pulses and true tilts")
    linger_s: float = Field(
        default=0.0, ge=0.0, le=60.0, description="time for which it continues after the end of the program"
    )


class EmulatedSettings(HardwareSettings):
    """All keys of an emulated rig's file except `class`."""

    world: WorldSettings = WorldSettings()
    place_s: float = Field(default=20.0, ge=1.0, le=3600.0)
