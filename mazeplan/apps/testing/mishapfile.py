"""What goes wrong on a scripted rig, from a few lines of YAML:

    - ball_stuck: {theta_deg: 30, from_s: 2.0, to_s: 3.1}
    - opening_blocked: {opening: 2-3@90}
    - camera_blind: {from_s: 1.0, to_s: 1.4}
    - ball_pushed: {at_s: 1.2, speed_m_s: 0.3, direction_deg: 90}
    - ball_teleported: {ring: 1, theta_deg: 120, in_ring: 3}
    - ball_out: {from_s: 1.0, to_s: 3.0, ring: 2}
    - axis_dead: {axis: beta, from_s: 1.0, to_s: 2.0}

An error names file, line and key.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field, ValidationError

from mazeplan.core.errors import SettingsError
from mazeplan.core.name_hints import one_of, unknown_keys_first
from mazeplan.maze.geometry import Maze
from mazeplan.maze.sections import Section
from mazeplan.maze.yamltree import Key, Tree, key_path, parse_yaml, read_yaml, shown

Seconds = Annotated[float, Field(ge=0.0, le=1e6)]
Angle = Annotated[float, Field(ge=-1e6, le=1e6)]
Ring = Annotated[int, Field(ge=1)]
FOR_EVER = 1e6  # s


class _While(Section):
    """A mishap that lasts from one moment of rig time to another."""

    from_s: Seconds = 0.0
    to_s: Seconds = FOR_EVER

    def active(self, t: float) -> bool:
        """Whether it acts at rig time t, s."""
        return self.from_s - 1e-9 <= t < self.to_s - 1e-9


class BallStuck(_While):
    """The ball sticks at a place as soon as it gets there.

    theta_deg: angle of the place; None: wherever the ball is
    ring: ring of the place; None: any"""

    theta_deg: Angle | None = None
    ring: Ring | None = None


class OpeningBlocked(_While):
    """The ball cannot pass an opening; by default for ever."""

    opening: str


class CameraBlind(_While):
    """The ball is not seen."""


class AxisDead(_While):
    """An axis keeps its last command."""

    axis: Literal["beta", "gamma", "both"]

    @property
    def axes(self) -> tuple[Literal["beta", "gamma"], ...]:
        """The dead axes."""
        return ("beta", "gamma") if self.axis == "both" else (self.axis,)


class _Once(Section):
    """A mishap that happens once: at `at_s`, or as soon after it as the ball is in the ring `in_ring`."""

    at_s: Seconds = 0.0
    in_ring: Ring | None = None


class BallPushed(_Once):
    """A kick of the ball."""

    speed_m_s: float = Field(default=0.3, ge=0.0, le=2.0)
    direction_deg: Angle = 0.0


class BallTeleported(_Once):
    """The ball is put at rest into a ring, as by a hand."""

    ring: Ring
    theta_deg: Angle = 0.0


class BallOut(_While):
    """The ball lies outside the maze, beyond the rim. At the end somebody puts it back.

    ring: into this ring
    theta_deg: at this angle; None: at the angle where the ball got out"""

    ring: Ring = 1
    theta_deg: Angle | None = None


Mishap = BallStuck | OpeningBlocked | CameraBlind | AxisDead | BallPushed | BallTeleported | BallOut
KINDS: dict[str, type[Mishap]] = {
    "ball_stuck": BallStuck,
    "opening_blocked": OpeningBlocked,
    "camera_blind": CameraBlind,
    "axis_dead": AxisDead,
    "ball_pushed": BallPushed,
    "ball_teleported": BallTeleported,
    "ball_out": BallOut,
}
Given = str | Path | Sequence[Mishap | Mapping[str, Any]]


class _Reader:
    """Reads the entries of one script. `file` and `tree` locate errors."""

    def __init__(self, maze: Maze, file: str | Path | None = None, tree: Tree | None = None) -> None:
        self._maze, self._file, self._tree = maze, file, tree

    def error(self, problem: str, key: Key) -> SettingsError:
        """The error at a key."""
        line = None if self._tree is None else self._tree.line(key)
        return SettingsError(problem, file=self._file, line=line, key=key_path(key) or None)

    def all(self, data: Any) -> tuple[Mishap, ...]:
        """All entries. Raises SettingsError."""
        if not isinstance(data, Sequence) or isinstance(data, str):
            raise self.error(f"got {shown(data)}, expected a list such as `- camera_blind: {{from_s: 1, to_s: 2}}`", ())
        return tuple(self._one(entry, (i,)) for i, entry in enumerate(data))

    def _one(self, entry: Any, key: Key) -> Mishap:
        if isinstance(entry, tuple(KINDS.values())):
            return self._checked(entry, key)
        if not isinstance(entry, Mapping):
            raise self.error(f"got {shown(entry)}, expected one of {', '.join(KINDS)} with its keys", key)
        if len(entry) != 1:
            raise self.error(f"got {len(entry)} keys, expected one of {', '.join(KINDS)}", key)
        (name, values), *_ = entry.items()
        if name not in KINDS:
            raise self.error(f"unknown mishap, expected {one_of(KINDS, name)}", (*key, name))
        return self._checked(self._section(KINDS[name], {} if values is None else values, (*key, name)), (*key, name))

    def _section(self, kind: type[Any], values: Any, key: Key) -> Any:
        try:
            return kind.model_validate(values)
        except ValidationError as problem:
            first = unknown_keys_first(problem.errors())[0]
            at: Key = (*key, *first["loc"])
            if first["type"] == "extra_forbidden":
                raise self.error(f"unknown key, expected {one_of(kind.model_fields, at[-1])}", at) from None
            if first["type"] == "missing":
                raise self.error("is missing", at) from None
            said = str(first["msg"]).removeprefix("Input should be ")
            raise self.error(f"got {shown(first.get('input'))}, expected {said}", at) from None

    def _checked(self, mishap: Mishap, key: Key) -> Mishap:
        """The mishap, after the checks that need the map or two keys. Raises SettingsError."""
        if isinstance(mishap, _While) and mishap.to_s <= mishap.from_s:
            raise self.error(f"got {mishap.to_s:g}, expected to_s > from_s, {mishap.from_s:g}", (*key, "to_s"))
        if isinstance(mishap, OpeningBlocked):
            names = [opening.name for opening in self._maze.openings]
            if mishap.opening not in names:
                raise self.error(
                    f"got {shown(mishap.opening)}, expected {one_of(names, mishap.opening)}", (*key, "opening")
                )
        for name in ("ring", "in_ring"):
            ring = getattr(mishap, name, None)
            if ring is not None and ring > len(self._maze.rings):
                raise self.error(f"got {ring}, expected 1 to {len(self._maze.rings)}", (*key, name))
        return mishap


def read_mishaps(given: Given, maze: Maze) -> tuple[Mishap, ...]:
    """Mishaps from a YAML file, from YAML text, or from a list of mishaps.

    A string is YAML text if it has more than one line or begins with `-`; otherwise it names a file. Raises
    SettingsError with file, line, key, what was got and what is allowed."""
    if isinstance(given, str) and ("\n" in given or given.lstrip().startswith("-")):
        tree = parse_yaml(given, file="mishaps", error=SettingsError)
        return _Reader(maze, "mishaps", tree).all(tree.data)
    if isinstance(given, str | Path):
        tree = read_yaml(Path(given), error=SettingsError)
        return _Reader(maze, Path(given), tree).all(tree.data)
    return _Reader(maze).all(given)
