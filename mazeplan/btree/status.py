"""The results of a tick of a node."""

from __future__ import annotations

from enum import Enum


class Status(Enum):
    """How a tick of a node ended. INVALID: the node is idle. A node that was skipped did nothing: its own status stays,
    only its parent gets SKIPPED."""

    RUNNING = "RUNNING"
    SUCCESS = "SUCCESS"
    FAILURE = "FAILURE"
    SKIPPED = "SKIPPED"
    INVALID = "INVALID"


RUNNING, SUCCESS, FAILURE, SKIPPED, INVALID = Status
FINISHED = (SUCCESS, FAILURE)
