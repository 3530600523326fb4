"""Picture of a behaviour tree: an indented outline, so that nothing overlaps however wide the tree is."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from mazeplan.btree.decorators import SubTree
from mazeplan.btree.outline import FOLDED, Row, rows_of
from mazeplan.btree.tree import BehaviorTree
from mazeplan.core.errors import InputError
from mazeplan.core.palette import INKS, TINTS
from mazeplan.core.whole_file import whole_file

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.text import Text

SHAPES = {  # matplotlib's box styles
    "Control": "square,pad=0.28", "Decorator": "round4,pad=0.38", "Action": "round,pad=0.28",
    "Condition": "round,pad=0.28,rounding_size=0.75", "SubTree": "square,pad=0.28",
}  # fmt: skip
STEP, ROW, WORDS, DPI = 0.42, 0.29, 5.0, 150  # indent; inches of a row and of words; dots an inch


def save_tree_picture(tree: BehaviorTree, path: str | Path, whole: bool = False) -> None:
    """Draw a tree into a PNG, SVG or PDF file. Raises InputError if the file cannot be written.

    whole: do not fold repeated SubTrees."""
    from matplotlib.figure import Figure
    from matplotlib.transforms import Bbox

    rows = rows_of(tree, whole, ())
    deepest, n = max(row.depth for row in rows), len(rows)
    figure = Figure(figsize=(0.3 * deepest + WORDS + 1.5, ROW * n + 0.4), dpi=DPI)
    axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    axes.set_axis_off()
    axes.set_xlim(-0.1, deepest * STEP + WORDS)
    axes.set_ylim(n - 0.5, -0.5)
    texts = _draw_nodes(axes, rows)
    try:
        figure.draw_without_rendering()  # computes how wide the words are at this resolution
        crop = Bbox.union([text.get_window_extent() for text in texts]).transformed(figure.dpi_scale_trans.inverted())
        with whole_file(path) as beside:
            figure.savefig(beside, bbox_inches=crop.padded(0.12))
    except (OSError, ValueError) as problem:
        raise InputError(f"cannot be drawn: {problem}", file=Path(path)) from None


def _draw_nodes(axes: Axes, rows: list[Row]) -> list[Text]:
    texts = list[Any]()
    for y, row in enumerate(rows):
        x = row.depth * STEP
        if row.parent is not None:
            trunk = (row.depth - 1) * STEP + 0.12
            axes.plot([trunk, trunk, x], [row.parent + 0.35, y, y], color=INKS["quiet"], lw=0.9, zorder=1)
        kind = "SubTree" if isinstance(row.node, SubTree) else row.node.category
        box = axes.text(
            x, y, row.title, va="center", ha="left", fontsize=8, zorder=3, family="DejaVu Sans", parse_math=False,
            bbox={"boxstyle": SHAPES[kind], "fc": TINTS[kind], "ec": INKS["ink"], "lw": 0.9},
        )  # fmt: skip
        texts.append(box)
        if note := "  ".join(filter(None, (row.name, row.attributes, FOLDED * row.folded))):
            texts.append(axes.annotate(
                note, xy=(1.0, 0.5), xycoords=box, xytext=(6, 0), textcoords="offset points",
                va="center", fontsize=7, color=INKS["quiet"], parse_math=False,
            ))  # fmt: skip
    return texts
