"""`map show --watch`: draw a map again at each save; a mistake stands in its place."""

from __future__ import annotations

import textwrap
import time
from collections.abc import Callable
from pathlib import Path

from mazeplan.apps.cli.output import say
from mazeplan.core.errors import InputError

LOOK_S = 0.25  # s between two looks at the file
WIDTH = 80  # characters of a line of a message


def watch(source: Path, draw: Callable[[Path], None], output: Path, pause: Callable[[], bool] | None = None) -> None:
    """Draw into `output` whenever `source` changes, until Ctrl-C.

    draw:   writes the picture of the map to a path; raises InputError for a mistake in the map
    pause:  waits until the next look and returns whether to go on"""
    wait = pause or _sleep
    say(f"watching {source}, drawing {output}; Ctrl-C ends")
    seen: object = None
    try:
        while True:
            now = _stamp(source)
            if now != seen:
                seen = now
                _draw_or_explain(source, draw, output)
            if not wait():
                return
    except KeyboardInterrupt:  # the usual way to end
        return


def _stamp(source: Path) -> tuple[int, int] | None:
    """What changes when a file is saved; None while an editor replaces the file."""
    try:
        state = source.stat()
    except OSError:
        return None
    return state.st_mtime_ns, state.st_size


def _draw_or_explain(source: Path, draw: Callable[[Path], None], path: Path) -> None:
    try:
        draw(path)
    except InputError as problem:
        say(f"mazeplan: {problem}")
        draw_mistake(problem, source, path)


def draw_mistake(problem: InputError, source: Path, path: Path) -> None:
    """Write a picture with the message and the line of the file that it is about."""
    from matplotlib.figure import Figure

    from mazeplan.core.palette import COLOURS

    words = textwrap.fill(str(problem), WIDTH)
    lines = source.read_text(encoding="utf-8", errors="replace").splitlines() if source.is_file() else []
    if problem.line is not None and problem.line <= len(lines):
        words += f"\n\n{problem.line}: {textwrap.shorten(lines[problem.line - 1].strip(), WIDTH)}"
    figure = Figure(figsize=(6.0, 6.0))
    figure.text(0.05, 0.95, words, va="top", family="monospace", fontsize=8, color=COLOURS["bad"], parse_math=False)
    figure.savefig(path, dpi=300)


def _sleep() -> bool:
    time.sleep(LOOK_S)
    return True
