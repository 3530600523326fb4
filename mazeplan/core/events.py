"""What happens in a run: one record for each kind of event.

The run log (topic /event) and the live page hold an event as {"t": 1.5, "kind": "passed", "detail": {...}}.
`TimedEvent.document` writes that form, `TimedEvent.from_document` reads it.
"""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, field, fields
from functools import cache
from typing import Any

from pydantic import TypeAdapter, ValidationError

from mazeplan.core.records import FailureKind, Start


@dataclass(frozen=True, slots=True)
class Event:
    """Something that happened in a run."""


@dataclass(frozen=True, slots=True)
class RingEntered(Event):
    """The ball is in another ring, or was seen for the first time."""

    ring: int


@dataclass(frozen=True, slots=True)
class OtherEntered(Event):
    """A ball after the first one (`ball` is 2 or more) is in another ring, or was seen for the first time."""

    ball: int
    ring: int


@dataclass(frozen=True, slots=True)
class PlacedElsewhere(Event):
    """The ball was first seen in `ring`, although the run asked for another one."""

    ring: int
    asked: int


@dataclass(frozen=True, slots=True)
class RoutePlanned(Event):
    """Names of the openings on the way to the goal, and the expected time, s."""

    openings: tuple[str, ...]
    expected_s: float


@dataclass(frozen=True, slots=True)
class OpeningChosen(Event):
    """The opening to which the ball is steered now, and the expected time, s."""

    opening: str
    expected_s: float


@dataclass(frozen=True, slots=True)
class OpeningPassed(Event):
    """The ball went through an opening into `ring`."""

    opening: str
    ring: int


@dataclass(frozen=True, slots=True)
class LawChanged(Event):
    """The law that steers along a ring from now on: mpc, gains, pd or policy."""

    law: str


@dataclass(frozen=True, slots=True)
class FailureReported(Event):
    """A failure: its kind, the leaf or place, and a sentence."""

    kind: str
    where: str = ""
    detail: str = ""


@dataclass(frozen=True, slots=True)
class RecoveryChosen(Event):
    """The recovery for the last failure."""

    recovery: str


@dataclass(frozen=True, slots=True)
class DoubtRaised(Event):
    """A measurement was not used; `records.Doubt` lists the values of `what`."""

    what: str


@dataclass(frozen=True, slots=True)
class MisfitSeen(Event):
    """The rig does not behave as the model says; adopted: the run goes on with what it saw."""

    words: str
    adopted: bool


@dataclass(frozen=True, slots=True)
class GoalChanged(Event):
    """Go to another ring from now on, and also close these openings."""

    ring: int
    closed: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class OpeningClosed(Event):
    """Do not use an opening any more."""

    opening: str


@dataclass(frozen=True, slots=True)
class OpeningReopened(Event):
    """Use an opening again."""

    opening: str


@dataclass(frozen=True, slots=True)
class StopRequested(Event):
    """Level the plate and end the run."""


@dataclass(frozen=True, slots=True)
class ExcitationStarted(Event):
    """A collection excites the ball, which should stay in `ring`."""

    ring: int


@dataclass(frozen=True, slots=True)
class DriveStarted(Event):
    """A collection drives the ball to `ring` without the openings `closed`."""

    ring: int
    closed: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class DriveFailed(Event):
    """A collection gave up the drive to `ring`; kind: of the failure."""

    ring: int
    kind: str


@dataclass(frozen=True, slots=True)
class OtherEvent(Event):
    """An event that this program does not define: from a leaf of the user, or from another version."""

    name: str
    values: Mapping[str, Any] = field(default_factory=dict)


Request = GoalChanged | OpeningClosed | OpeningReopened | StopRequested  # from outside the run
RunEvent = Start | Event

KINDS: dict[str, type[RunEvent]] = {
    "start": Start,
    "ring": RingEntered,
    "other_ring": OtherEntered,
    "placed_elsewhere": PlacedElsewhere,
    "route": RoutePlanned,
    "opening": OpeningChosen,
    "passed": OpeningPassed,
    "law": LawChanged,
    "failure": FailureReported,
    "recovery": RecoveryChosen,
    "doubt": DoubtRaised,
    "misfit": MisfitSeen,
    "goal": GoalChanged,
    "closed": OpeningClosed,
    "opened": OpeningReopened,
    "stopped": StopRequested,
    "excite": ExcitationStarted,
    "drive": DriveStarted,
    "drive_failed": DriveFailed,
}
_NAMES = {kind: name for name, kind in KINDS.items()}


@dataclass(frozen=True, slots=True)
class TimedEvent:
    """An event at rig time t, s."""

    t: float
    event: RunEvent

    @property
    def kind(self) -> str:
        """Name of the kind of event in the run log."""
        return self.event.name if isinstance(self.event, OtherEvent) else _NAMES[type(self.event)]

    @property
    def detail(self) -> dict[str, Any]:
        """Values of the event in the run log."""
        if isinstance(self.event, OtherEvent):
            return dict(self.event.values)
        values = {f.name: getattr(self.event, f.name) for f in fields(self.event)}
        return {name: list(value) if isinstance(value, tuple) else value for name, value in values.items()}

    @property
    def document(self) -> dict[str, Any]:
        """The event as the run log holds it."""
        return {"t": self.t, "kind": self.kind, "detail": self.detail}

    @classmethod
    def from_document(cls, document: Mapping[str, Any]) -> TimedEvent:
        """Read `document`. An unknown kind, or values that do not fit the kind, give an OtherEvent.

        Raises KeyError, TypeError or ValueError for a document that holds no event."""
        kind, detail = document["kind"], document["detail"]
        if not isinstance(kind, str) or not isinstance(detail, dict):
            raise TypeError("an event without kind or detail")
        event: RunEvent = OtherEvent(kind, detail)
        if kind in KINDS:
            with suppress(ValidationError):
                event = _reader(KINDS[kind]).validate_python(detail)
        return cls(float(document["t"]), event)

    @property
    def error_follows(self) -> bool:
        """Whether an error with the full message follows this event, because the rig or a leaf failed."""
        kinds = (FailureKind.RIG_FAILED, FailureKind.LEAF_FAILED)
        return isinstance(self.event, FailureReported) and self.event.kind in kinds


@cache
def _reader(kind: type[RunEvent]) -> TypeAdapter[RunEvent]:
    return TypeAdapter(kind)
