"""The emulated board for tests: the real firmware in simavr. Skipped where it is not built (make emulator)."""

from __future__ import annotations

import os
from collections.abc import Iterator

import pytest

from mazeplan.core.errors import RigError
from mazeplan.rigs.emulation.chip import EmulatedChip, built

NEEDED = os.environ.get("MAZEPLAN_EMULATOR") == "needed"  # set where the packages are: nothing is skipped there


@pytest.fixture
def chip() -> Iterator[EmulatedChip]:
    try:
        parts = built()
    except RigError as missing:
        if NEEDED:
            raise
        pytest.skip(str(missing))
    with EmulatedChip(*parts) as chip:
        yield chip
