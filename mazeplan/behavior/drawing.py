"""A behaviour tree as text and as a picture."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from mazeplan.behavior.controls import CONTROLS
from mazeplan.behavior.decorators import SubTree
from mazeplan.behavior.leaf import Leaf
from mazeplan.behavior.node import TreeNode
from mazeplan.behavior.ports import Key, shown
from mazeplan.behavior.tree import BehaviorTree, parts_of
from mazeplan.core.errors import InputError

# fill by kind of node, readable in grey and with any colour vision: light blue, light orange, white, light yellow
COLOURS = {"control": "#cfe2f3", "decorator": "#fce5cd", "leaf": "#ffffff", "condition": "#ffffff", "tree": "#fff2a8"}
SHAPES = {  # matplotlib's box styles
    "control": "square,pad=0.28", "decorator": "round4,pad=0.38", "leaf": "round,pad=0.28",
    "condition": "round,pad=0.28,rounding_size=0.75", "tree": "square,pad=0.28",
}  # fmt: skip
SYMBOLS = {
    "Sequence": "→", "SequenceWithMemory": "→*", "ReactiveSequence": "→ᴿ", "Fallback": "?", "ReactiveFallback": "?ᴿ",
    "Parallel": "⇉", "Repeat": "↻", "RetryUntilSuccessful": "↺", "Inverter": "¬",
}  # fmt: skip


def _kind(node: TreeNode) -> str:
    if isinstance(node, Leaf):
        return "condition" if node.category == "Condition" else "leaf"
    if isinstance(node, SubTree):
        return "tree"
    return "control" if type(node).__name__ in CONTROLS else "decorator"


def _label(node: TreeNode) -> tuple[str, str]:
    """(kind of node, own name if it has one)."""
    kind = type(node).__name__
    symbol = SYMBOLS.get(kind, "")
    title = f"{symbol} {kind}".strip() if symbol else kind
    return title, "" if node.name == kind else node.name


def _ports(node: TreeNode) -> str:
    """Ports and preconditions as attributes."""
    values: dict[str, Any] = getattr(node, "_values", {})
    ports = [f"{name}={_written(value)}" for name, value in values.items()]
    given = {} if node.conditions is None else node.conditions.given
    return " ".join(ports + [f'{name}="{_written(e.text)}"' for name, e in given.items()])


def _written(value: Any) -> str:
    """A port's value as it stands in a file, if that is short and printable."""
    if isinstance(value, Key):
        return f"{{{value.name}}}"
    text = ";".join(value) if isinstance(value, list) else str(value)
    return text if text.isprintable() and len(text) <= 60 else shown(text)


def tree_text(tree: BehaviorTree) -> str:
    """The tree, one node a line, with its ports."""
    lines: list[str] = []

    def add(node: TreeNode, lead: str, branch: str, below: str) -> None:
        title, name = _label(node)
        lines.append(" ".join(filter(None, (lead + branch + title, f"'{name}'" if name else "", _ports(node)))))
        for i, child in enumerate(parts_of(node)):
            last = i + 1 == len(parts_of(node))
            add(child, lead + below, "└── " if last else "├── ", "    " if last else "│   ")

    add(tree.root, "", "", "")
    return "\n".join(lines)


@dataclass
class _Placed:
    node: TreeNode
    x: float
    y: float
    parent: _Placed | None


def _place(tree: BehaviorTree) -> list[_Placed]:
    """Indented outline: one row a node, so that nothing overlaps however wide the tree is."""
    placed: list[_Placed] = []

    def add(node: TreeNode, depth: int, parent: _Placed | None) -> None:
        here = _Placed(node, depth, -len(placed), parent)
        placed.append(here)
        for child in parts_of(node):
            add(child, depth + 1, here)

    add(tree.root, 0, None)
    return placed


def save_tree_drawing(tree: BehaviorTree, path: str | Path) -> None:
    """Draw the tree into a PNG, SVG or PDF file. Raises InputError when it cannot be written."""
    from matplotlib.figure import Figure
    from matplotlib.transforms import Bbox

    path = Path(path)
    placed = _place(tree)
    depth, rows, step = max(p.x for p in placed), len(placed), 0.42
    figure = Figure(figsize=(0.3 * depth + 6.5, 0.32 * rows + 0.4), dpi=150)
    axes = figure.add_axes((0.01, 0.01, 0.98, 0.98))
    axes.set_axis_off()
    texts = []
    for p in placed:
        x = p.x * step
        if p.parent is not None:
            trunk = p.parent.x * step + 0.12
            axes.plot([trunk, trunk, x], [p.parent.y - 0.35, p.y, p.y], color="#555555", lw=0.9, zorder=1)
        kind, (title, name) = _kind(p.node), _label(p.node)
        box = axes.text(
            x, p.y, title, va="center", ha="left", fontsize=8, zorder=3, family="DejaVu Sans", parse_math=False,
            bbox={"boxstyle": SHAPES[kind], "fc": COLOURS[kind], "ec": "#333333", "lw": 0.8},
        )  # fmt: skip
        note = "  ".join(filter(None, (name, _ports(p.node))))
        beside = axes.annotate(
            note, xy=(1.0, 0.5), xycoords=box, xytext=(6, 0), textcoords="offset points",
            va="center", fontsize=7, color="#444444", parse_math=False,
        )  # fmt: skip
        texts += [box, beside] if note else [box]
    axes.set_xlim(-0.1, depth * step + 5.0)
    axes.set_ylim(-rows + 0.2, 0.8)
    try:
        figure.draw_without_rendering()  # only then is it known how wide the words are, at this resolution
        crop = Bbox.union([text.get_window_extent() for text in texts]).transformed(figure.dpi_scale_trans.inverted())
        figure.savefig(path, bbox_inches=crop.padded(0.15))
    except (OSError, ValueError) as problem:
        raise InputError(f"cannot be drawn: {problem}", file=path) from None
