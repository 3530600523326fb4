"""What a worker does with a run of a campaign."""

from __future__ import annotations

import os
import platform
from collections.abc import Callable
from dataclasses import dataclass
from time import perf_counter, process_time
from typing import TypeVar

from mazeplan.campaign.parcel import Parcel, told_of_origins, unpacked, without_site
from mazeplan.campaign.single import Campaign, run_one
from mazeplan.records import NavigationResult

Result = TypeVar("Result")


@dataclass(frozen=True)
class Ran:
    """A run that has ended: result, how long that took by the clock on the wall, and of the processor's time, s; where:
    computer:process."""

    result: NavigationResult
    wall_s: float
    cpu_s: float
    host: str


def run_packed(parcel: Parcel, campaign: Campaign, index: int) -> Ran:
    """Run number `index` of a campaign whose files are in a parcel."""
    with told_of_origins(parcel):
        result, wall_s, cpu_s = measured(lambda: without_site(run_one(unpacked(parcel, campaign), index)))
    return Ran(result, wall_s, cpu_s, here())


def measured(do: Callable[[], Result]) -> tuple[Result, float, float]:
    """What it returns, how long that took by the clock on the wall, and of the processor's time, s."""
    began, used = perf_counter(), process_time()
    result = do()
    return result, perf_counter() - began, process_time() - used


def here() -> str:
    """computer:process."""
    return f"{platform.node()}:{os.getpid()}"
