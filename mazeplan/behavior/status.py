"""What a tick of a node may end with: the statuses of py_trees, and SKIPPED, which py_trees has not.

A node that was skipped did nothing: to py_trees it is as idle as before (INVALID), and its parent alone is told.
"""

from __future__ import annotations

from enum import Enum

from py_trees.common import Status


class Skipped(Enum):
    """The one status beside those of py_trees."""

    SKIPPED = "SKIPPED"


Result = Status | Skipped
SKIPPED = Skipped.SKIPPED
RUNNING, SUCCESS, FAILURE, INVALID = Status.RUNNING, Status.SUCCESS, Status.FAILURE, Status.INVALID
FINISHED = (SUCCESS, FAILURE)
RESULTS = (RUNNING, SUCCESS, FAILURE, SKIPPED)


def result_named(name: str) -> Result:
    """SUCCESS, FAILURE, RUNNING or SKIPPED by its name."""
    return SKIPPED if name == "SKIPPED" else Status(name)
