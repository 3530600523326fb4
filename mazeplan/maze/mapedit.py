"""Edits a map's YAML text: openings, radial walls, rings, name. The rest of the text stays as it is (`yamledit`).

The map may have errors (openings may overlap while a user drags one), but `yamltree` must be able to read it. Angles
are in degrees and lengths in mm, as in the file. Indices of openings and radial walls count from 0 in the file's order,
numbers of rings from 1.

If a ring is added or removed, all rings outside it move, so that channels and walls keep their widths:

    remove k:       the wall outside ring k is removed, too; rings 1 ... k-1 move inwards by the space that becomes free
    add outside k:  the new channel is as wide as ring k, the new wall as thick as the wall outside ring k; rings
                    1 ... k-1 move outwards
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Literal

from mazeplan.core.errors import MapError
from mazeplan.maze.mapfile import default_name
from mazeplan.maze.wallrules import default_wall_name
from mazeplan.maze.yamledit import BOM, ListText, Span, applied
from mazeplan.maze.yamltree import Tree, parse_yaml

ANGLE_STEP_DEG = 0.1  # finer than the precision of a cut
WIDTH_STEP_MM = 0.01

Section = Literal["openings", "radial_walls", "rings"]
SECTIONS: tuple[Section, ...] = ("openings", "radial_walls", "rings")


@dataclass(frozen=True)
class Written:
    """An opening, a radial wall or a ring in the text.

    index: in its list, from 0
    line: in the text, from 1
    name: as in logs
    outer, inner: the two rings of an opening; for a radial wall or a ring both are the number of its ring
    width_mm: width of an opening, thickness of a wall, or width of a ring's channel; for the disc its radius
    """

    index: int
    line: int
    name: str
    outer: int
    inner: int
    angle_deg: float
    width_mm: float
    closed: bool
    section: Section = "openings"


def written(text: str) -> tuple[Written, ...]:
    """Openings, radial walls and rings with readable numbers, even if the map has other errors; empty if the text is no
    YAML."""
    try:
        tree = parse_yaml(text.removeprefix(BOM), file="map", error=MapError)
    except MapError:
        return ()
    return (*_openings(tree), *_walls(tree), *_rings(tree))


def written_openings(text: str) -> tuple[Written, ...]:
    """The openings of `written`."""
    return tuple(piece for piece in written(text) if piece.section == "openings")


def move_opening(text: str, index: int, angle_deg: float) -> str:
    """Set the angle of an opening, rounded to `ANGLE_STEP_DEG`, from 0 to below 360 degrees."""
    return ListText(text, "openings").with_value(index, "angle_deg", _angle(angle_deg))


def widen_opening(text: str, index: int, width_mm: float) -> str:
    """Set the width of an opening, rounded to `WIDTH_STEP_MM`."""
    return ListText(text, "openings").with_value(index, "width_mm", _width(width_mm))


def close_opening(text: str, index: int, closed: bool) -> str:
    """Close or open an opening for routes."""
    return ListText(text, "openings").with_value(index, "closed", "true" if closed else "false")


def add_opening(text: str, outer: int, angle_deg: float, width_mm: float) -> str:
    """Add an opening in the wall inside ring `outer`, below the last one of that wall and in the same style."""
    pairs = [("rings", f"[{outer}, {outer + 1}]"), ("angle_deg", _angle(angle_deg)), ("width_mm", _width(width_mm))]
    return _added(ListText(text, "openings"), outer, pairs)


def remove_opening(text: str, index: int) -> str:
    """Remove an opening. A comment on its lines stays, with the name of the opening."""
    return _removed(ListText(text, "openings"), index)


def move_wall(text: str, index: int, angle_deg: float) -> str:
    """Set the angle of a radial wall, as `move_opening`."""
    return ListText(text, "radial_walls").with_value(index, "angle_deg", _angle(angle_deg))


def thicken_wall(text: str, index: int, thickness_mm: float) -> str:
    """Set the thickness of a radial wall, rounded to `WIDTH_STEP_MM`."""
    return ListText(text, "radial_walls").with_value(index, "thickness_mm", _width(thickness_mm))


def add_wall(text: str, ring: int, angle_deg: float, thickness_mm: float) -> str:
    """Add a radial wall across a ring, below the last one of that ring. The first radial wall also adds the list."""
    pairs = [("ring", str(ring)), ("angle_deg", _angle(angle_deg)), ("thickness_mm", _width(thickness_mm))]
    return _added(ListText(text, "radial_walls", optional=True), ring, pairs)


def remove_wall(text: str, index: int) -> str:
    """Remove a radial wall, as `remove_opening`."""
    return _removed(ListText(text, "radial_walls"), index)


def add_ring(text: str, number: int, angle_deg: float, width_mm: float) -> str:
    """Add a ring outside ring `number`; the new ring gets this number. `remove_ring` undoes it.

    The new ring gets an opening with this angle and width in the wall outside it; ring 1 in the wall inside it."""
    sizes = _sizes(text)
    if not 1 <= number <= len(sizes):
        raise MapError(f"got ring {number}, expected one from 1 to {len(sizes)}", file="map", key="rings")
    last = number == len(sizes)
    inner, outer = sizes[number - 1]
    beside = sizes[number - 2] if last else sizes[number - 1]  # the disc has no width
    width = beside[1] - beside[0]
    thickness = sizes[number - 2][0] - outer if number > 1 else inner - sizes[1][1]
    renumbered = _renumbered(text, number, 1, thickness + width)
    low = outer + thickness
    pairs = [("inner_radius_mm", _width(low)), ("outer_radius_mm", _width(low + width))]
    text = ListText(renumbered, "rings").added(number - 1, pairs)
    return add_opening(text, max(number - 1, 1), angle_deg, width_mm)


def remove_ring(text: str, number: int) -> str:
    """Remove a ring, its radial walls, and the wall outside it with its openings; for ring 1, the wall inside it.

    Raises MapError for the last ring (the goal) and for a map of two rings."""
    sizes = _sizes(text)
    if len(sizes) == 2:
        raise MapError("got a map of 2 rings, expected one with more: a map needs 2", file="map", key="rings")
    if not 1 <= number < len(sizes):
        words = f"one from 1 to {len(sizes) - 1}: the last one is the goal"
        raise MapError(f"got ring {number}, expected {words}", file="map", key="rings")
    for piece in reversed(written(text)):
        if piece.section == "openings" and piece.outer == max(number - 1, 1):
            text = remove_opening(text, piece.index)
        elif piece.section == "radial_walls" and piece.outer == number:
            text = remove_wall(text, piece.index)
    nearer = sizes[number - 2][0] - sizes[number - 1][0] if number > 1 else 0.0
    text = _renumbered(text, number, -1, -nearer)
    return ListText(text, "rings").removed(number - 1, f"ring {number}")


def rename(text: str, name: str) -> str:
    """Set the name of the map."""
    found = ListText(text, "rings")
    node = next((node for key, node in found.root.value if key.value == "name"), None)
    if node is None:
        raise MapError("missing, expected the name of the map", file="map", key="name")
    return found.bom + applied(found.text, [found.span(node, json.dumps(name))])


def _angle(degrees: float) -> str:
    steps = round(_finite(degrees) / ANGLE_STEP_DEG) % round(360.0 / ANGLE_STEP_DEG)
    return f"{steps * ANGLE_STEP_DEG:.1f}".removesuffix(".0")


def _width(millimetres: float) -> str:
    steps = round(_finite(millimetres) / WIDTH_STEP_MM)
    return f"{steps * WIDTH_STEP_MM:.2f}".rstrip("0").rstrip(".")


def _finite(number: float) -> float:
    if not math.isfinite(number):
        raise MapError(f"got {number}, expected a finite number", file="map")
    return number


def _added(found: ListText, outer: int, pairs: list[tuple[str, str]]) -> str:
    """The text with a new entry below the last one of the same wall or ring."""
    of = _openings if found.section == "openings" else _walls
    same = [piece.index for piece in of(found.tree) if piece.outer == outer]
    return found.added(max(same, default=len(found.items) - 1) + 1, pairs)


def _removed(found: ListText, index: int) -> str:
    of = _openings if found.section == "openings" else _walls
    called = next((piece.name for piece in of(found.tree) if piece.index == index), f"{found.section}[{index}]")
    return found.removed(index, called)


# Rings.


def _sizes(text: str) -> list[tuple[float, float]]:
    """Inner and outer radius of all rings, mm. Raises MapError if they cannot be read."""
    found = ListText(text, "rings")
    sizes = [_numbers(item, "inner_radius_mm", "outer_radius_mm") for item in found.tree.data["rings"] or ()]
    for index, size in enumerate(sizes):
        if size is None:
            raise found.refused("expected inner_radius_mm and outer_radius_mm: correct them in the text first", index)
    if len(sizes) < 2:
        raise found.refused(f"got {len(sizes)} rings, expected at least 2")
    return [(size[0], size[1]) for size in sizes if size]


def _renumbered(text: str, number: int, by: int, further_mm: float) -> str:
    """The text with new numbers of rings and new radii. Numbers change in openings, radial walls, and comments such as
    `# ring 2`.

    by: 1 if a ring is added outside ring `number`, -1 if ring `number` is removed
    further_mm: added to the radii of the rings outside ring `number`
    """
    bom = BOM if text.startswith(BOM) else ""
    text = text.removeprefix(BOM)
    rings, spans = ListText(text, "rings"), []
    for index, size in enumerate(_sizes(text)):
        if index + 1 < number and further_mm:
            nodes = (rings.node(index, "inner_radius_mm"), rings.node(index, "outer_radius_mm"))
            spans += [rings.span(node, _width(mm + further_mm)) for node, mm in zip(nodes, size, strict=True)]
        if index + 1 > number or (by > 0 and index + 1 == number):
            spans += _comment_spans(rings, index, index + 1 + by)
    lists = (("openings", _openings, "rings", max(number - 1, 1)), ("radial_walls", _walls, "ring", number))
    for section, of, key, first in lists:
        found = ListText(text, section, optional=True)
        for piece in of(found.tree):
            node: Any = found.node(piece.index, key)
            if piece.outer >= first:
                numbers = node.value if key == "rings" else [node]
                spans += [found.span(scalar, str(int(scalar.value) + by)) for scalar in numbers]
    return bom + applied(text, spans)


def _comment_spans(rings: ListText, index: int, number: int) -> Iterator[Span]:
    """Spans that set the number in comments that begin with the name of their ring."""
    for mark, stop in rings.comments_of(index):
        if match := re.match(rf"#+ *ring ({index + 1})\b", rings.text[mark:stop]):
            yield mark + match.start(1), mark + match.end(1), str(number)


# Reading.


def _entries(tree: Tree, section: str) -> Iterator[tuple[int, dict[str, Any]]]:
    data: dict[str, Any] = tree.data if isinstance(tree.data, dict) else {}
    items = data.get(section)
    yield from ((i, item) for i, item in enumerate(items if isinstance(items, list) else ()) if isinstance(item, dict))


def _numbers(item: Any, *keys: str) -> list[float] | None:
    values = [item.get(key) if isinstance(item, dict) else None for key in keys]
    return None if any(type(value) not in (int, float) for value in values) else [float(value or 0) for value in values]


def _openings(tree: Tree) -> Iterator[Written]:
    last = len(list(_entries(tree, "rings")))
    for index, item in _entries(tree, "openings"):
        pair, numbers = item.get("rings"), _numbers(item, "angle_deg", "width_mm")
        if not (isinstance(pair, list) and len(pair) == 2 and all(type(ring) is int for ring in pair)):
            continue
        outer, inner = sorted(pair)
        if inner != outer + 1 or not 1 <= outer < last or numbers is None:
            continue
        angle, width = numbers
        called = _called(item, default_name(outer, inner, angle))
        line = tree.line(("openings", index))
        yield Written(index, line, called, outer, inner, angle, width, item.get("closed") is True)


def _walls(tree: Tree) -> Iterator[Written]:
    last = len(list(_entries(tree, "rings")))
    for index, item in _entries(tree, "radial_walls"):
        ring, numbers = item.get("ring"), _numbers(item, "angle_deg", "thickness_mm")
        if type(ring) is not int or not 1 <= ring < last or numbers is None:
            continue
        angle, thickness = numbers
        called, line = _called(item, default_wall_name(ring, angle)), tree.line(("radial_walls", index))
        yield Written(index, line, called, ring, ring, angle, thickness, False, "radial_walls")


def _rings(tree: Tree) -> Iterator[Written]:
    for index, item in _entries(tree, "rings"):
        if (size := _numbers(item, "inner_radius_mm", "outer_radius_mm")) is not None:
            line, number = tree.line(("rings", index)), index + 1
            yield Written(index, line, f"ring {number}", number, number, 0.0, size[1] - size[0], False, "rings")


def _called(item: dict[str, Any], default: str) -> str:
    name = item.get("name")
    return name if isinstance(name, str) else default
