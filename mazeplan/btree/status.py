"""The results of a tick of a node: the statuses of py_trees, and SKIPPED, which py_trees lacks.

A node that was skipped did nothing. For py_trees it is as idle as before (INVALID); only its parent gets SKIPPED.
"""

from __future__ import annotations

from enum import Enum

from py_trees.common import Status


class Skipped(Enum):
    """The status that py_trees lacks."""

    SKIPPED = "SKIPPED"


Result = Status | Skipped
SKIPPED = Skipped.SKIPPED
RUNNING, SUCCESS, FAILURE, INVALID = Status.RUNNING, Status.SUCCESS, Status.FAILURE, Status.INVALID
FINISHED = (SUCCESS, FAILURE)
RESULTS = (RUNNING, SUCCESS, FAILURE, SKIPPED)


def result_named(name: str) -> Result:
    """The result with this name: SUCCESS, FAILURE, RUNNING or SKIPPED."""
    return SKIPPED if name == "SKIPPED" else Status(name)
