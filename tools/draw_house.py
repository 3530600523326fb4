"""Draw the picture of the house in docs/architecture.md from the program's own imports.

Usage: python tools/draw_house.py [-o docs/house.png]

A box is a room of mazeplan/, its floor the one that pyproject.toml gives it, its width the number of its lines, or what
its words need. An arrow goes from a room to one that it imports; its width is the number of such imports.
"""

from __future__ import annotations

import argparse
import ast
import tomllib
from collections import Counter
from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
from matplotlib.patches import FancyArrowPatch, FancyBboxPatch

from mazeplan.core.palette import INKS, TINTS

ROOT = Path(__file__).resolve().parent.parent
PACKAGE = ROOT / "mazeplan"
WIDTH, HEIGHT, GAP = 10.0, 0.62, 0.25  # of the widest floor, of a box, between boxes
LETTER = 0.075  # width of a letter below a name, with the room beside the words
INK, PAPER, ARROW = INKS["ink"], TINTS["chosen"], INKS["quiet"]


def floors() -> list[list[str]]:
    """Rooms, floor by floor, from the top."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    contracts = project["tool"]["importlinter"]["contracts"]
    layers = next(c["layers"] for c in contracts if c.get("containers") == ["mazeplan"])
    rows = [[name.strip() for name in layer.split("|")] for layer in layers]
    return [row for row in rows if row != ["__main__"]]


def sources(room: str) -> list[Path]:
    """Files of a room."""
    return [path for path in sorted((PACKAGE / room).rglob("*.py")) if "__pycache__" not in path.parts]


def imported(path: Path) -> list[str]:
    """Rooms that a file imports, as often as it does."""
    tree, found = ast.parse(path.read_text(encoding="utf-8")), []
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("mazeplan"):
            names = [f"{node.module}.{alias.name}" for alias in node.names]
        elif isinstance(node, ast.Import):
            names = [alias.name for alias in node.names if alias.name.startswith("mazeplan.")]
        else:
            continue
        found += [name.split(".")[1] for name in names if "." in name]
    return found


def draw(path: Path) -> None:
    """Write the picture."""
    rows = floors()
    lines = {
        room: sum(len(p.read_text(encoding="utf-8").splitlines()) for p in sources(room))
        for row in rows
        for room in row
    }
    inner = {room: sorted(p.name for p in (PACKAGE / room).iterdir() if (p / "__init__.py").exists()) for room in lines}
    below = {room: ", ".join(names) or f"{lines[room]:,} lines" for room, names in inner.items()}
    ties = Counter(
        (room, other)
        for room in lines
        for p in sources(room)
        for other in imported(p)
        if other in lines and other not in (room, "core")
    )
    scale = (WIDTH - GAP) / max(sum(lines[r] for r in row) for row in rows)
    figure, axes = plt.subplots(figsize=(10, 1.15 * len(rows)))
    place = {}
    for level, row in enumerate(reversed(rows)):
        widths = [max(lines[r] * scale, 1.6, LETTER * len(below[r])) for r in row]
        x = (WIDTH - sum(widths) - GAP * (len(row) - 1)) / 2
        for room, width in zip(row, widths, strict=True):
            place[room] = (x, 1.3 * level, width)
            x += width + GAP
    for (a, b), count in ties.items():
        (xa, ya, wa), (xb, yb, wb) = place[a], place[b]
        start, end = (xa + wa / 2 + (xb - xa) * 0.05, ya), (xb + wb / 2 + (xa - xb) * 0.05, yb + HEIGHT)
        bend = 0.0 if ya - yb < 1.5 else 0.22 if xa + wa / 2 >= xb + wb / 2 else -0.22
        axes.add_patch(
            FancyArrowPatch(start, end, connectionstyle=f"arc3,rad={bend}", arrowstyle="-|>", mutation_scale=9,
                            lw=0.4 + count**0.5 / 6, color=ARROW, alpha=0.45, zorder=1)
        )  # fmt: skip
    for room, (x, y, width) in place.items():
        axes.add_patch(FancyBboxPatch((x, y), width, HEIGHT, boxstyle="round,pad=0.02", fc=PAPER, ec=INK, zorder=2))
        axes.text(x + width / 2, y + 0.40, room, ha="center", va="center", color=INK, weight="bold", zorder=3)
        axes.text(x + width / 2, y + 0.15, below[room], ha="center", va="center", color=INK, fontsize=7, zorder=3)
    axes.set_xlim(-0.2, WIDTH + 0.2)
    axes.set_ylim(-0.2, 1.3 * (len(rows) - 1) + HEIGHT + 0.2)
    axes.axis("off")
    figure.savefig(path, dpi=130, bbox_inches="tight", metadata={"Software": None})


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description="Draw the picture of the house.")
    parser.add_argument("-o", "--output", type=Path, default=ROOT / "docs" / "house.png")
    draw(parser.parse_args().output)
