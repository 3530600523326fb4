"""Picture of a behaviour tree: an indented outline, so that nothing overlaps however wide the tree is.

With the log of a run, the picture shows beside each node how its ticks ended over time. One node is marked:

    after a failed run      the node that ended the run; the path to this node has the colour of failures
    after a limit or end    the node that ran when something else ended the run, such as the time limit; the path to
                            this node has the colour of running nodes
    after a success         the leaf that succeeded last; the path to the leaf that failed last has the colour of
                            failures
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mazeplan.apps.report.drawing import ENDINGS, draw_ending, ending, endings_met, failure_mark
from mazeplan.apps.report.run_record import logged_failures, span_of
from mazeplan.apps.report.words import TIME
from mazeplan.btree.decorators import SubTree
from mazeplan.btree.node import TreeNode
from mazeplan.btree.outline import FOLDED, Row, rows_of
from mazeplan.btree.tree import BehaviorTree
from mazeplan.core.errors import InputError, LogError
from mazeplan.core.logs.run_log import STATUSES, RunLog
from mazeplan.core.palette import COLOURS, FAINT, INKS, TINTS
from mazeplan.core.records import FailureKind, TreeOutline
from mazeplan.core.whole_file import whole_file

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.text import Text

SHAPES = {  # matplotlib's box styles
    "Control": "square,pad=0.28", "Decorator": "round4,pad=0.38", "Action": "round,pad=0.28",
    "Condition": "round,pad=0.28,rounding_size=0.75", "SubTree": "square,pad=0.28",
}  # fmt: skip
STEP, ROW, WORDS, WIDE, DPI = 0.42, 0.29, 5.0, 5.2, 150  # indent; inches: a row, words, picture over time; dots an inch
AXIS, LEGEND = 0.45, 0.5  # inches below the rows, for the time axis and the legend
# {what the marked node did: words beside it}
MARKS = {
    "failure": "✖ ended the run",
    "running": "▶ running at the {limit}",
    "success": "✔ last success",
}


@dataclass(frozen=True)
class History:
    """What a tree did in a run.

    span: from the first tick to one sample after the last tick, s.
    changes: (t, letters): from rig time t on, each node has its letter of `STATUSES`.
    failures: (t, number of the leaf that failed).
    path: numbers of the nodes from the root to the marked node; after a success to the leaf that failed last.
    marked: number of the node that ended the run, ran at its end, or succeeded last.
    how: what the marked node did, a key of `MARKS`.
    limit: what ended the run while the node ran."""

    span: tuple[float, float]
    changes: tuple[tuple[float, str], ...]
    failures: tuple[tuple[float, int], ...]
    path: frozenset[int]
    marked: int | None = None
    how: str = "failure"
    limit: str = "limit"

    @property
    def words(self) -> str:
        """The words beside the marked node."""
        return MARKS[self.how].format(limit=self.limit)


def history(tree: BehaviorTree, log: RunLog, file: Path | None = None) -> History:
    """What a tree did, from a log. Raises LogError if the log has another tree, or no tree."""
    outline = TreeOutline(**tree.outline())
    same = [i for i, logged in enumerate(log.trees) if logged.outline.paths == outline.paths]
    if not same:
        got = "a log without a tree" if not log.trees else "the log of another tree"
        raise LogError(f"got {got}, expected one of a run with the tree {tree.name}", file=file)
    changes = list[tuple[float, str]]()
    for i in same:
        logged = log.trees[i]
        end = log.trees[i + 1].t if i + 1 < len(log.trees) else span_of(log)[1]
        idle = STATUSES["INVALID"] * len(outline.paths)
        changes += [(logged.t, idle), *logged.statuses, (max(end, logged.t), idle)]
    failures = tuple(
        (m.t, number)
        for m in logged_failures(log)
        if (number := _failed(outline.names, changes, m.t, m.where)) is not None
    )
    how, marked = _marked(tree, log, changes, failures[-1][1] if failures else None)
    last = failures[-1][1] if failures else None
    path, number = set[int](), last if marked is None or how == "success" else marked
    while number is not None and number >= 0:
        path.add(number)
        number = outline.parents[number]
    limit = "limit" if log.result is not None and log.result.get("reason") == FailureKind.OUT_OF_TIME else "end"
    return History(span_of(log), tuple(changes), failures, frozenset(path), marked, how, limit)


def _marked(
    tree: BehaviorTree, log: RunLog, changes: list[tuple[float, str]], failed: int | None
) -> tuple[str, int | None]:
    """A key of `MARKS` and the number of the marked node, or None, as for a run without a result.

    After a success, the node is the leaf that succeeded last. Otherwise it is the node that raised an error, or the
    leaf whose failure is the reason of the end, or the node that failed or ran in the last tick."""
    outline, last = TreeOutline(**tree.outline()), next(reversed(logged_failures(log)), None)
    if log.result is None:
        return "failure", None
    if log.result.get("success"):
        return "success", _last_success(outline.parents, changes)
    if last is not None and last.kind == FailureKind.LEAF_FAILED:
        named = [i for i, path in enumerate(outline.paths) if f": {tree.name}/{path}" in last.detail]
        return "failure", max(named, key=lambda i: len(outline.paths[i]), default=None)
    if last is not None and last.where in outline.names and last.kind == log.result.get("reason"):
        return "failure", failed
    letters = _last_letters(changes)
    if letters[:1] not in (STATUSES["FAILURE"], STATUSES["RUNNING"]):
        return "failure", None
    how, number = ENDINGS[letters[0]], 0
    while below := [i for i, parent in enumerate(outline.parents) if parent == number and letters[i] == letters[0]]:
        number = below[-1]
    return how, number


def _last_letters(changes: list[tuple[float, str]]) -> str:
    """The letters after the last tick; empty if there was no tick."""
    return next((letters for _, letters in reversed(changes) if letters.strip(STATUSES["INVALID"])), "")


def _last_success(parents: tuple[int, ...], changes: list[tuple[float, str]]) -> int | None:
    """The leaf that succeeded last. If several succeeded in the same tick, the last of them in the tree."""
    success, idle, found = STATUSES["SUCCESS"], STATUSES["INVALID"], list[tuple[float, int]]()
    for i, letter in enumerate(_last_letters(changes)):
        if letter == success and i not in parents:
            others = (t for t, letters in changes if letters[i] != success and letters.strip(idle))
            found.append((max(others, default=-math.inf), i))
    return max(found)[1] if found else None


def _failed(names: tuple[str, ...], changes: list[tuple[float, str]], t: float, where: str) -> int | None:
    """Number of the leaf with this name that failed at time t; None if the tree has no such leaf.

    A leaf that failed may have started again in the same tick. Then it is the leaf that ran until this tick."""
    named = [i for i, name in enumerate(names) if name == where]
    now = next((letters for at, letters in changes if at >= t - 1e-9), "")
    before = next((letters for at, letters in reversed(changes) if at < t - 1e-9), "")
    for letters, status in ((now, "FAILURE"), (before, "RUNNING")):
        for i in named:
            if letters[i : i + 1] == STATUSES[status]:
                return i
    return named[0] if named else None


def save_tree_picture(
    tree: BehaviorTree, path: str | Path, did: History | None = None, title: str = "", whole: bool = False
) -> None:
    """Draw a tree into a PNG, SVG or PDF file. Raises InputError if the file cannot be written.

    did: what the tree did in a run.
    title: title of the picture over time.
    whole: do not fold repeated SubTrees."""
    from matplotlib.figure import Figure
    from matplotlib.transforms import Bbox

    rows = rows_of(tree, whole, () if did is None else did.path)
    deepest, n = max(row.depth for row in rows), len(rows)
    lowest = AXIS + (0.0 if did is None else LEGEND)
    width, height = 0.3 * deepest + WORDS + 1.5, ROW * n + 0.4 + lowest
    figure = Figure(figsize=(width + WIDE, height), dpi=DPI)
    below, tall = lowest / height, ROW * n / height
    axes = figure.add_axes((0.0, below, width / (width + WIDE), tall))
    axes.set_axis_off()
    axes.set_xlim(-0.1, deepest * STEP + WORDS)
    axes.set_ylim(n - 0.5, -0.5)
    texts = _draw_nodes(axes, rows, did)
    try:
        figure.draw_without_rendering()  # computes how wide the words are at this resolution
        crop = Bbox.union([text.get_window_extent() for text in texts]).transformed(figure.dpi_scale_trans.inverted())
        if did is not None:
            left = (crop.x1 + 0.25) / (width + WIDE)
            over_time = figure.add_axes((left, below, (WIDE - 0.4) / (width + WIDE), tall))
            _draw_history(over_time, rows, did)
            figure.legend(handles=_legend(rows, did), **_below_axes(left))
            over_time.set_title(title, fontsize=8, loc="left", parse_math=False)
            crop = Bbox.union([crop, Bbox.from_bounds(crop.x1, 0.0, WIDE, height)])
        with whole_file(path) as beside:
            figure.savefig(beside, bbox_inches=crop.padded(0.12))
    except (OSError, ValueError) as problem:
        raise InputError(f"cannot be drawn: {problem}", file=Path(path)) from None


def _kind(node: TreeNode) -> str:
    return "SubTree" if isinstance(node, SubTree) else node.category


def _draw_nodes(axes: Axes, rows: list[Row], did: History | None) -> list[Text]:
    texts = list[Any]()
    on_path = COLOURS["running" if did is not None and did.how == "running" else "failure"]
    for y, row in enumerate(rows):
        x, bad = row.depth * STEP, did is not None and row.number in did.path
        colour, width = (on_path, 1.8) if bad else (INKS["quiet"], 0.9)
        if row.parent is not None:
            trunk = (row.depth - 1) * STEP + 0.12
            axes.plot([trunk, trunk, x], [row.parent + 0.35, y, y], color=colour, lw=width, zorder=2 if bad else 1)
        kind = _kind(row.node)
        mark = did if did is not None and row.number == did.marked else None
        fill, edge = TINTS[kind if mark is None else mark.how], colour if bad else INKS["ink"]
        box = axes.text(
            x, y, row.title, va="center", ha="left", fontsize=8, zorder=3, family="DejaVu Sans", parse_math=False,
            bbox={"boxstyle": SHAPES[kind], "fc": fill, "ec": edge, "lw": width},
        )  # fmt: skip
        note = "  ".join(filter(None, (row.name, row.attributes, FOLDED * row.folded)))
        beside = axes.annotate(
            note, xy=(1.0, 0.5), xycoords=box, xytext=(6, 0), textcoords="offset points",
            va="center", fontsize=7, color=INKS["quiet"], parse_math=False,
        )  # fmt: skip
        texts += [box, beside] if note else [box]
        if mark is not None:
            texts.append(axes.annotate(
                mark.words, xy=(1.0, 0.5), xycoords=beside if note else box, xytext=(8, 0),
                textcoords="offset points", va="center", fontsize=8, weight="bold", family="DejaVu Sans",
                color=INKS[mark.how],
            ))  # fmt: skip
    return texts


def _draw_history(axes: Axes, rows: list[Row], did: History) -> None:
    for y, row in enumerate(rows):
        for name, start, end in _endings(did, row):
            draw_ending(axes, name, y, start, end)
        at = [t for t, number in did.failures if number == row.number]
        axes.plot(at, [y] * len(at), **failure_mark("X", markersize=8.0))
    axes.set_ylim(len(rows) - 0.5, -0.5)
    axes.set_xlim(*did.span)
    axes.set_yticks(range(len(rows)), [])
    axes.tick_params(axis="y", length=0)
    axes.tick_params(axis="x", labelsize=7)
    axes.grid(color=FAINT["grid"], lw=0.6)
    axes.set_axisbelow(True)
    axes.set_xlabel(TIME, fontsize=8)
    for side in ("top", "right", "left"):
        axes.spines[side].set_visible(False)


def _legend(rows: list[Row], did: History) -> list[Any]:
    """Entries of the legend: the endings of ticks that the picture shows, and the mark of a leaf's failure."""
    from matplotlib.lines import Line2D

    marks = [Line2D([], [], label="a leaf's failure", **failure_mark("X", markersize=8.0))] if did.failures else []
    return [*endings_met({name for row in rows for name, *_ in _endings(did, row)}), *marks]


def _below_axes(left: float) -> dict[str, Any]:
    """Keywords of a legend at the bottom of the figure. left: its left edge, as a share of the figure's width."""
    return {
        "title": "last tick", "fontsize": 7, "title_fontsize": 7, "ncols": 3, "loc": "lower left", "borderaxespad": 0.0,
        "bbox_to_anchor": (left, 0.0), "frameon": False, "alignment": "left",
    }  # fmt: skip


def _endings(did: History, row: Row) -> list[tuple[str, float, float]]:
    """(how the last tick of the row's node ended, start, end) over time."""
    condition = row.node.category == "Condition"
    return [(ending(letter, condition), start, end) for letter, start, end in _stretches(did, row.number)]


def _stretches(did: History, number: int) -> list[tuple[str, float, float]]:
    """(letter, start, end) of the stretches in which the ending of a node's last tick stays the same."""
    changes = [(t, letters[number]) for t, letters in did.changes]
    kept = [change for i, change in enumerate(changes) if i == 0 or change[1] != changes[i - 1][1]]
    ends = [*kept, (did.span[1], "")]
    return [(letter, t, end) for (t, letter), (end, _) in pairwise(ends) if letter in ENDINGS and end > t]
