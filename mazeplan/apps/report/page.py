"""Writes a page: sections of tables and pictures as one HTML file that loads no other file and runs no script.

Pictures are SVG, which is as sharp as text in print. The template (Jinja2) escapes all text, and a
Content-Security-Policy forbids loading from elsewhere.
"""

from __future__ import annotations

import base64
import io
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mazeplan.core.errors import InputError
from mazeplan.core.palette import COLOURS, FAINT, INKS, TINTS, dashes
from mazeplan.core.resources import template
from mazeplan.core.whole_file import write_text

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

STYLE: Any = {
    "font.size": 9.0,
    "axes.titlesize": 9.5,
    "axes.labelsize": 9.0,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.axisbelow": True,
    "axes.linewidth": 0.7,
    "grid.color": FAINT["grid"],
    "grid.linewidth": 0.6,
    "hatch.linewidth": 0.6,
    "legend.fontsize": 8.0,
    "legend.frameon": False,
    "text.parse_math": False,  # a $ in a name is a dollar
    "svg.fonttype": "path",  # text as paths, so that pictures look the same on every machine
    "svg.hashsalt": "mazeplan",  # a fixed salt, so that the same picture gives the same file
}
INK = INKS["ink"]
TEMPLATE = Path(__file__).parent / "templates" / "page.html"
NUMBER = re.compile(r"|–|-?[0-9][0-9.e+-]*( (s|ms|mm|%|deg))?")
NO_METADATA = dict.fromkeys(("Creator", "Date", "Format", "Type"))


@dataclass(frozen=True)
class PagePicture:
    """A picture of a page: its name, title, description in words, and size (inches). draw: draws into a figure."""

    name: str
    title: str
    alt: str
    draw: Callable[[Figure], None]
    size: tuple[float, float] = (9.0, 3.4)

    def figure(self) -> Figure:
        """The picture as a figure of Matplotlib."""
        from matplotlib import rc_context
        from matplotlib.figure import Figure

        with rc_context(STYLE):
            figure = Figure(figsize=self.size, layout="constrained")
            self.draw(figure)
        return figure

    def source(self) -> str:
        """The picture as SVG in a data URL."""
        from matplotlib import rc_context

        svg, figure = io.BytesIO(), self.figure()
        with rc_context(STYLE):
            figure.savefig(svg, format="svg", metadata=NO_METADATA)
        return f"data:image/svg+xml;base64,{base64.b64encode(svg.getvalue()).decode()}"


@dataclass(frozen=True)
class PageTable:
    """A table of a page.

    rows: text of the cells; the second and later lines of a cell are smaller
    strong: (row, column) of bold cells
    code: columns with names to type"""

    caption: str
    head: Sequence[str]
    rows: Sequence[Sequence[str]]
    strong: frozenset[tuple[int, int]] = frozenset()
    code: frozenset[int] = frozenset()

    @property
    def numeric(self) -> set[int]:
        """Columns that have only numbers, with or without a unit. The page aligns them to the right."""
        columns = list(zip(*self.rows, strict=True))
        return {i for i, cells in enumerate(columns) if all(NUMBER.fullmatch(cell) for cell in cells) and any(cells)}


@dataclass(frozen=True)
class Note:
    """A paragraph. code: a command to type."""

    text: str
    code: str = ""


@dataclass(frozen=True)
class PageSection:
    """A section of a page. lead: the result in a sentence; facts: (name, value) of the input"""

    title: str
    lead: str
    facts: Sequence[tuple[str, str]]
    parts: Sequence[PagePicture | PageTable | Note]


def line(name: str, **more: Any) -> dict[str, Any]:
    """Keywords of Matplotlib for a line in the style of a name of the palette."""
    pattern = dashes(name)
    style: Any = (0, pattern) if pattern else "-"
    return {"color": COLOURS[name], "linestyle": style, "linewidth": 1.4, **more}


def legend_beside(axes: Axes) -> None:
    """A legend to the right of the panel."""
    axes.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0))


def section_text(section: PageSection) -> str:
    """The section as text for a terminal, without its pictures."""
    width = max((len(name) for name, _ in section.facts), default=0)
    lines = [section.lead, *(f"  {name:{width}s}  {value}" for name, value in section.facts)]
    for part in section.parts:
        if isinstance(part, PageTable):
            rows = [[cell.replace("\n", " ") for cell in row] for row in (part.head, *part.rows)]
            widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
            pairs = ([*zip(row, widths, strict=True)] for row in rows)
            lines += [f"{part.caption}:", *("  " + "  ".join(f"{c:{w}s}" for c, w in row).rstrip() for row in pairs)]
        elif isinstance(part, Note):
            lines.append(f"{part.text} {part.code}".rstrip())
    return "\n".join(line for line in lines if line.strip())


def write_page(path: Path, title: str, sections: Sequence[PageSection]) -> None:
    """Write the page. Raises InputError for a path that cannot be written."""
    shown = []
    for section in sections:
        parts = []
        for part in section.parts:
            source = ""
            if isinstance(part, PagePicture):
                try:
                    source = part.source()
                except (ValueError, LookupError, TypeError) as problem:  # a document whose lists do not fit together
                    raise InputError(f"{section.title}: {part.title}: cannot be drawn: {problem}") from None
            parts.append({"kind": type(part).__name__, "part": part, "source": source})
        shown.append({"section": section, "parts": parts})
    page = template(TEMPLATE, colours={**INKS, **TINTS, **FAINT, "strong": COLOURS["real"], "edge": COLOURS["neutral"]})
    write_text(path, page.render(title=title, sections=shown, version=version("mazeplan")))
