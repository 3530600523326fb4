"""The map while it is edited: its text, its errors with their lines, steps to undo, and its file.

This module has no page. The text is the map: each drag becomes a change of the text (`maze.mapedit`), and the page
draws the text. A text with errors can be edited, but saving it needs `with_errors`.
"""

from __future__ import annotations

import math
import os
import re
from collections.abc import Callable, Hashable
from pathlib import Path

from mazeplan.core import resources
from mazeplan.core.errors import MapError
from mazeplan.core.name_hints import one_of
from mazeplan.core.whole_file import whole_file
from mazeplan.maze import mapedit
from mazeplan.maze.geometry import Maze, Wall
from mazeplan.maze.mapedit import Section, Written
from mazeplan.maze.mapfile import MapCheck, check_text, find_map, packaged_maps
from mazeplan.maze.mapschema import NAME_PATTERN
from mazeplan.maze.yamltree import MAX_BYTES, read_yaml

MOST_STEPS = 500  # maximum number of steps that can be undone
ROOM = 1.2  # width of the first opening of a wall, in diameters of the ball
THICK_MM = 5.0  # thickness of the first radial wall
_BOM = b"\xef\xbb\xbf"


class MapEditor:
    """One map file, open for editing.

    source:   a file, or the name of a packaged map, which is saved in the current folder
    text:     of the map
    check:    result of `check_text`; its `maze` is None while there are errors
    maze:     the last maze without errors; None before the first
    pieces:   openings, radial walls and rings in the text, also with errors (`mapedit.Written`)
    path:     of the file

    Raises MapError for a file that cannot be read or is no YAML. A map with errors can be opened.
    """

    def __init__(self, source: str | Path) -> None:
        found = find_map(source)
        read_yaml(found, error=MapError, what="a map (YAML)")  # says in one line what cannot be read
        packaged = found.parent == resources.share("maps") and found != Path(source)
        self.path = Path.cwd() / found.name if packaged else found.resolve()
        content = found.read_bytes()
        self._on_disk = None if packaged else content
        self._bom = _BOM if content.startswith(_BOM) else b""
        self._crlf = b"\r\n" in content
        self._undone: list[str] = []
        self._done: list[str] = []
        self._gesture: Hashable = None
        self.maze: Maze | None = None
        self._new = False  # whether the map is new and no file holds it yet
        self._saved = content.removeprefix(_BOM).decode()
        self._take(self._saved)

    def _take(self, text: str) -> None:
        self.text = text
        self.check: MapCheck = check_text(text, file=self.path.name)
        self.maze = self.check.maze or self.maze
        self.pieces: tuple[Written, ...] = mapedit.written(text)

    def new(self, template: str, name: str) -> None:
        """Begin a new map with the text of a packaged map. The steps to undo are gone.

        template: name of the packaged map
        name: of the new file, in the same folder

        Raises MapError for a template that is not packaged, and for a file name that exists or is not allowed."""
        if template not in packaged_maps():
            raise MapError(f"got the template {template!r}, expected {one_of(packaged_maps(), template)}")
        path = self._other(name)
        if os.path.lexists(path):
            raise MapError("exists already, expected the name of a new file", file=path)
        text = mapedit.rename(find_map(template).read_text(encoding="utf-8"), path.stem)
        self.path, self._on_disk, self._bom, self._crlf, self._new = path, None, b"", False, True
        self._done, self._undone, self.maze, self._saved = [], [], None, text
        self.settle()
        self._take(text)

    # -- edits ------------------------------------------------------------------------------------------------------

    def move(self, index: int, angle_deg: float, gesture: Hashable = None, section: Section = "openings") -> None:
        """Turn an opening or a radial wall to an angle.

        gesture: calls with the same gesture, such as those of a drag, are undone in one step"""
        turn = mapedit.move_wall if section == "radial_walls" else mapedit.move_opening
        self._change(lambda text: turn(text, index, angle_deg), gesture)

    def widen(self, index: int, width_mm: float, gesture: Hashable = None, section: Section = "openings") -> None:
        """Give an opening another width, or a radial wall another thickness."""
        resize = mapedit.thicken_wall if section == "radial_walls" else mapedit.widen_opening
        self._change(lambda text: resize(text, index, width_mm), gesture)

    def close(self, index: int, closed: bool) -> None:
        """Close an opening for routes, or open it."""
        self._change(lambda text: mapedit.close_opening(text, index, closed))

    def add(self, outer: int, angle_deg: float | None = None, width_mm: float | None = None) -> int:
        """Add an opening to the wall inside ring `outer`. Returns its index.

        angle_deg: by default the middle of the longest piece of the wall
        width_mm: by default as wide as the wall's last opening"""
        angle = self.free_angle(outer) if angle_deg is None else angle_deg
        width = self.usual_width(outer) if width_mm is None else width_mm
        return self._add(lambda text: mapedit.add_opening(text, outer, angle, width), "openings")

    def add_wall(self, ring: int) -> int:
        """Add a radial wall across a ring. Returns its index.

        It stands in the middle of the longest piece of the ring between radial walls and openings. It is as thick as
        the map's last radial wall."""
        known = [piece.width_mm for piece in self.pieces if piece.section == "radial_walls"]
        angle, thickness = self._free_angle((ring - 1, ring), (ring,)), known[-1] if known else THICK_MM
        return self._add(lambda text: mapedit.add_wall(text, ring, angle, thickness), "radial_walls")

    def add_ring(self, number: int) -> int:
        """Add a ring outside ring `number`, with one opening. Returns its index."""
        wall = max(number - 1, 1)
        angle, width = self.free_angle(wall), self.usual_width(wall)
        self._change(lambda text: mapedit.add_ring(text, number, angle, width))
        return number - 1

    def remove(self, index: int, section: Section = "openings") -> None:
        """Remove an opening, a radial wall or a ring. A ring takes its walls and the openings from outside with it."""
        edits = {"openings": mapedit.remove_opening, "radial_walls": mapedit.remove_wall}
        if section == "rings":
            self._change(lambda text: mapedit.remove_ring(text, index + 1))
        else:
            self._change(lambda text: edits[section](text, index))

    def _add(self, edit: Callable[[str], str], section: Section) -> int:
        before = self.of(section)
        self._change(edit)
        pairs = zip(self.of(section), before, strict=False)
        return next((new.index for new, old in pairs if _place(new) != _place(old)), len(self.of(section)) - 1)

    def write(self, text: str) -> None:
        """Replace the whole text by typed text."""
        if len(text.encode()) > MAX_BYTES:
            raise MapError(f"got more than {MAX_BYTES} bytes, expected a map", file=self.path.name)
        plain = text.removeprefix("\ufeff").replace("\r\n", "\n")
        self._change(lambda _: plain.replace("\n", "\r\n") if self._crlf else plain, "typing")

    def settle(self) -> None:
        """End a drag or typing: the next change is a step of its own."""
        self._gesture = None

    def _change(self, edit: Callable[[str], str], gesture: Hashable = None) -> None:
        text = edit(self.text)
        if text == self.text:
            return
        if gesture is None or gesture != self._gesture:
            self._done = [*self._done[1 - MOST_STEPS :], self.text]
        self._undone, self._gesture = [], gesture
        self._take(text)

    def undo(self) -> bool:
        """Undo the last step. Returns whether there was one."""
        return self._step(self._done, self._undone)

    def redo(self) -> bool:
        """Redo the last undone step. Returns whether there was one."""
        return self._step(self._undone, self._done)

    def _step(self, taken: list[str], kept: list[str]) -> bool:
        if taken:
            kept.append(self.text)
            self._take(taken.pop())
            self.settle()
            return True
        return False

    @property
    def can_undo(self) -> bool:
        """Whether a step can be undone."""
        return bool(self._done)

    @property
    def can_redo(self) -> bool:
        """Whether an undone step can be redone."""
        return bool(self._undone)

    # -- what is there ----------------------------------------------------------------------------------------------

    @property
    def saved(self) -> str:
        """The text in the file."""
        return self._saved

    @property
    def changed(self) -> bool:
        """Whether the text differs from the file, or belongs to a new map without a file."""
        return self._new or self.text != self._saved

    @property
    def unsaved(self) -> bool:
        """Whether the file does not hold the text, or there is no file yet."""
        return self.changed or self._on_disk is None

    @property
    def wrong(self) -> frozenset[tuple[str, int]]:
        """Sections and indices of the pieces that the errors name."""
        named = (re.findall(r"(\w+)\[(\d+)\]", f"{error.key} {error.problem}") for error in self.check.errors)
        return frozenset((section, int(index)) for found in named for section, index in found)

    @property
    def openings(self) -> tuple[Written, ...]:
        """The openings among `pieces`."""
        return self.of("openings")

    def of(self, section: Section) -> tuple[Written, ...]:
        """The pieces of a section."""
        return tuple(piece for piece in self.pieces if piece.section == section)

    def piece(self, section: Section, index: int) -> Written | None:
        """One piece; None if the text has none."""
        return next((piece for piece in self.of(section) if piece.index == index), None)

    def usual_width(self, outer: int) -> float:
        """Width, mm, of the last opening of a wall; for a wall without openings, a width that the ball passes."""
        same = [opening.width_mm for opening in self.openings if opening.outer == outer]
        return same[-1] if same else math.ceil(20.0 * ROOM * self._drawn.ball.radius * 1000.0) / 10.0

    def free_angle(self, outer: int) -> float:
        """The middle, deg, of the longest piece of a wall between its openings and the radial walls on both sides.

        outer: the ring outside the wall"""
        return self._free_angle((outer,), (outer, outer + 1))

    def _free_angle(self, openings: tuple[int, ...], walls: tuple[int, ...]) -> float:
        """The middle, deg, of the longest piece between openings and radial walls.

        openings: the walls whose openings count, by the ring outside each
        walls: the rings whose radial walls count"""
        angles = sorted(
            piece.angle_deg % 360.0
            for section, rings in (("openings", openings), ("radial_walls", walls))
            for piece in self.pieces
            if piece.section == section and piece.outer in rings
        )
        if not angles:
            return 0.0
        pieces = zip(angles, [*angles[1:], angles[0] + 360.0], strict=True)
        first, last = max(pieces, key=lambda piece: round(piece[1] - piece[0], 6))
        return 0.5 * (first + last) % 360.0

    @property
    def _drawn(self) -> Maze:
        if self.maze is None:
            raise MapError("has errors: correct them in the text first", file=self.path.name)
        return self.maze

    def wall_at(self, x: float, y: float) -> tuple[int, float]:
        """The wall nearest to a place in the plate, m: the number of the ring outside it, and the angle there, deg."""
        radius, angle = math.hypot(x, y), math.degrees(math.atan2(y, x)) % 360.0
        walls = [wall for wall in self._drawn.walls if wall.outer_ring]

        def off(wall: Wall) -> float:
            return abs(0.5 * (wall.inner_radius + wall.outer_radius) - radius)

        return min(walls, key=off).outer_ring, angle

    # -- the file ---------------------------------------------------------------------------------------------------

    def save(self, name: str | None = None, *, with_errors: bool = False) -> Path:
        """Write the text, completely or not at all. Returns the path of the file.

        name: another file in the same folder, which must not exist yet
        with_errors: whether to save a map that has errors

        Raises MapError in three cases, in which the file does not change:

        - the map has errors and `with_errors` is false: the first error of the map
        - another program has changed the file
        - the file cannot be written"""
        path = self.path if name in (None, self.path.name) else self._other(name)
        if self.check.errors and not with_errors:
            raise self.check.errors[0]
        content = self._bom + self.text.encode()
        try:
            if path == self.path and self._on_disk is not None:
                self._check_unchanged(path)
                _put(path, content)
            else:
                _write_new(path, content)
        except FileExistsError:
            raise MapError("exists already, expected the name of a new file", file=path) from None
        except OSError as problem:
            raise MapError(f"cannot be written: {problem.strerror or problem}", file=path) from None
        self.path, self._on_disk, self._saved, self._new = path, content, self.text, False
        self.settle()
        self._take(self.text)
        return path

    def _other(self, name: str) -> Path:
        if not re.fullmatch(NAME_PATTERN, name) or not name.endswith((".yaml", ".yml")) or name.startswith("."):
            raise MapError(f"got the file name {name!r}, expected letters, digits or _ . @ + - and .yaml at its end")
        return self.path.with_name(name)

    def overtaken(self) -> str:
        """What another program did to the file since the editor read or saved it; empty if nothing."""
        if self._on_disk is None:
            return ""
        try:
            now = self.path.read_bytes()
        except FileNotFoundError:
            return "is gone"
        except OSError as problem:
            return f"cannot be read: {problem.strerror or problem}"
        return "" if now == self._on_disk else "was changed by another program"

    def read_again(self) -> None:
        """Read the file again, as a step that can be undone. Raises MapError for a file without YAML."""
        read_yaml(self.path, error=MapError, what="a map (YAML)")
        content = self.path.read_bytes()
        self._on_disk, self._bom = content, _BOM if content.startswith(_BOM) else b""
        self._crlf, self._saved = b"\r\n" in content, content.removeprefix(_BOM).decode()
        self.settle()
        self._change(lambda _: self._saved)

    def _check_unchanged(self, path: Path) -> None:
        if what := self.overtaken():
            raise MapError(f"{what} since it was opened here: save under another name", file=path)


def _write_new(path: Path, content: bytes) -> None:
    """Write a new file. Raises FileExistsError."""
    with path.open("xb"):  # gives the file the permissions of a new file
        pass
    try:
        _put(path, content)
    except OSError:
        path.unlink()
        raise


def _put(path: Path, content: bytes) -> None:
    """Replace a file in one step. The file keeps its permissions. Raises OSError, also for a read-only file."""
    with whole_file(path) as draft, draft.open("wb") as stream:
        stream.write(content)
        stream.flush()
        os.fsync(stream.fileno())


def _place(opening: Written) -> tuple[int, float, float]:
    return opening.outer, opening.angle_deg, opening.width_mm
