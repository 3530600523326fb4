"""A map's text as HTML: numbered lines, the line of the chosen part marked, each problem below its line."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable
from html import escape

from mazeplan.core.errors import MapError
from mazeplan.core.palette import COLOURS, INKS, TINTS

FONT = "font-family:ui-monospace,Menlo,Consolas,monospace;font-size:11px;line-height:1.5;"
MOST = 2000  # maximum number of lines shown


def listing(text: str, problems: Iterable[MapError], chosen: int | None, changed: frozenset[int] = frozenset()) -> str:
    """The text as HTML. Lines are counted from 1.

    chosen: line to mark
    changed: lines that differ from the file"""
    at: dict[int, list[MapError]] = defaultdict(list)
    rows = text.splitlines()
    for problem in problems:
        at[min(max(problem.line or 1, 1), max(len(rows), 1))].append(problem)
    width = len(str(len(rows)))
    shown = [_row(i, row, i == chosen, i in changed, at[i], width) for i, row in enumerate(rows[:MOST], start=1)]
    if not rows:
        shown = [_row(1, "", False, False, at[1], 1)]
    if len(rows) > MOST:
        shown.append(f"<div>… and {len(rows) - MOST} lines more</div>")
    return f'<div style="{FONT}padding:2px 0">{"".join(shown)}</div>'


def _row(number: int, row: str, chosen: bool, changed: bool, problems: list[MapError], width: int) -> str:
    bad, ink = bool(problems), INKS["bad"]
    back = TINTS["bad"] if bad else TINTS["chosen"] if chosen else "transparent"
    edge = ink if bad else COLOURS["planned"] if changed else "transparent"
    sign = "✕" if bad else "•" if changed else " "
    below = "".join(
        f'<div data-problem="{number}" style="color:{ink};white-space:normal;font-weight:600;text-indent:0">'
        f"{escape(_problem_text(problem))}</div>"
        for problem in problems
    )
    return (
        f'<div data-line="{number}" style="background:{back};border-left:3px solid {edge};white-space:pre-wrap;'
        f'overflow-wrap:anywhere;padding-left:{width + 3}ch;text-indent:-{width + 3}ch">'
        f'<span style="color:{INKS["quiet"]};user-select:none">{sign}{number:>{width}}  </span>'
        f"{_coloured(row)}{below}</div>"
    )


def _problem_text(problem: MapError) -> str:
    return f"{problem.key}: {problem.problem}" if problem.key else problem.problem


def _coloured(row: str) -> str:
    """A line as HTML, with its comment in a quieter colour."""
    mark = 0 if row.lstrip().startswith("#") else row.find(" #")
    if mark < 0 or (mark and any(quote in row for quote in "\"'")):
        return escape(row) or " "
    whole = "display:inline-block;text-indent:0" if mark else ""  # a short comment after an entry wraps as a whole
    return f'{escape(row[:mark])}<span style="color:{INKS["quiet"]};{whole}">{escape(row[mark:])}</span>'


def changed_lines(before: str, now: str) -> frozenset[int]:
    """Numbers, from 1, of lines of the text `now` that are not in `before`, or below which lines were removed."""
    from difflib import SequenceMatcher

    matcher = SequenceMatcher(None, before.splitlines(), now.splitlines(), autojunk=False)
    found: set[int] = set()
    for kind, _, _, start, end in matcher.get_opcodes():
        if kind != "equal":
            found |= set(range(start + 1, end + 1)) or {max(start, 1)}
    return frozenset(found)
