"""Groups of options in the help of a command: `--help` shows the common ones, `--help-all` shows every group."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

IN_SIGHT = 12  # most options that --help shows of a command; with fewer ones it shows all
COMMON = "Options"
GROUPS = {
    "Route": ("--start-angle", "--via", "--balls", "--close", "--time-limit"),
    "Rig": ("--tilt", "--highest-hz", "--ring", "--radius", "--rounds"),
    "Model": ("--effects", "--policy", "--settings", "--learn", "--declare", "--system", "--device", "--epochs"),
    "Tree": ("--behavior", "--behavior-module"),
    "Processes": ("--workers", "--dask", "--no-deadline"),
    "Output": ("--video", "--store", "--report", "--test", "--port", "--force"),
}
GROUP_OF = {option: group for group, options in GROUPS.items() for option in options}


def grouped(parameters: Sequence[Any], everything: bool) -> dict[str, list[Any]]:
    """Parameters of a command by group, in the order of the help."""
    if not everything and len(parameters) <= IN_SIGHT:
        return {COMMON: list(parameters)}
    groups: dict[str, list[Any]] = {COMMON: [], **{name: [] for name in GROUPS}}
    for parameter in parameters:
        rare = [GROUP_OF[name] for name in parameter.opts if name in GROUP_OF and not parameter.required]
        groups[rare[0] if rare else COMMON].append(parameter)
    if not everything:
        return {COMMON: groups[COMMON]}
    return {name: members for name, members in groups.items() if members}
