"""What a worker does with a run of a campaign."""

from __future__ import annotations

import os
import platform
from dataclasses import dataclass
from time import perf_counter, process_time

from mazeplan.campaign.parcel import Parcel, unpacked, without_site
from mazeplan.campaign.single import Campaign, run_one
from mazeplan.records import NavigationResult


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
    began, used = perf_counter(), process_time()
    result = without_site(run_one(unpacked(parcel, campaign), index))
    return Ran(result, perf_counter() - began, process_time() - used, f"{platform.node()}:{os.getpid()}")
