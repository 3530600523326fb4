"""Does one run of a campaign on a worker, and measures its time."""

from __future__ import annotations

import os
import platform
from collections.abc import Callable
from dataclasses import dataclass
from time import perf_counter, process_time
from typing import TypeVar

from mazeplan.core.records import NavigationResult
from mazeplan.run.campaign.one_run import Campaign, run_one
from mazeplan.run.campaign.parcel import Parcel, errors_name_origins, unpacked, with_relative_paths

Result = TypeVar("Result")


@dataclass(frozen=True)
class Ran:
    """A run that has ended. host: computer:process that did it."""

    result: NavigationResult
    wall_s: float
    cpu_s: float
    host: str


def run_packed(parcel: Parcel, campaign: Campaign, index: int) -> Ran:
    """Run number `index` of a campaign whose files are in a parcel."""
    with errors_name_origins(parcel):
        result, wall_s, cpu_s = measured(lambda: with_relative_paths(run_one(unpacked(parcel, campaign), index)))
    return Ran(result, wall_s, cpu_s, here())


def measured(do: Callable[[], Result]) -> tuple[Result, float, float]:
    """The result of `do`, and the wall time and processor time that it took, s."""
    began, used = perf_counter(), process_time()
    result = do()
    return result, perf_counter() - began, process_time() - used


def here() -> str:
    """This computer and process, as computer:process."""
    return f"{platform.node()}:{os.getpid()}"
