"""Pages without a live run: recorded runs, and the map editor. Each page is served until Ctrl-C."""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path

from mazeplan.apps.view.door import Door, listen
from mazeplan.apps.view.page import Page, Tab
from mazeplan.apps.view.replay.recorded import RecordedRun, open_recording
from mazeplan.apps.view.server import check_installed
from mazeplan.core.errors import LogError

MOST = 2  # maximum number of runs beside each other


def open_logs(logs: Sequence[str | Path], tell: Callable[[str], None] = lambda text: None) -> list[RecordedRun]:
    """Open one or two recorded runs. tell: gets the name of each log before it is read

    Raises LogError for a file without a run, and InputError without viser."""
    if len(logs) > MOST:
        raise LogError(f"got {len(logs)} logs, expected one, or two to see beside each other")
    check_installed()
    found = []
    for path in logs:
        tell(Path(path).name)
        found.append(open_recording(path))
    return found


def show_logs(runs: Sequence[RecordedRun], host: str, port: int, on: Callable[[], bool] = lambda: True) -> None:
    """Show runs beside each other while `on()` is true. Raises InputError for a port that cannot be used."""
    from mazeplan.apps.view.replay.tab import ReplayTab

    _serve(ReplayTab(runs), host, port, on)


def edit_map(source: str | Path, host: str, port: int, on: Callable[[], bool] = lambda: True) -> None:
    """Edit a map file, or a packaged map, which is saved under another name, while `on()` is true.

    Raises MapError for a map that cannot be read."""
    from mazeplan.apps.view.editor.mapeditor import MapEditor
    from mazeplan.apps.view.editor.tab import EditTab

    check_installed()
    editor = MapEditor(source)
    tab = EditTab(editor)
    try:
        _serve(tab, host, port, on, note=f"map: {source}, saved as {editor.path}")
    finally:
        tab.close()
    if editor.changed:
        _say(f"mazeplan: {editor.path.name}: changes since the last save are lost")


def _say(text: str) -> None:
    with suppress(OSError):  # stderr may be closed; the page goes on
        print(text, file=sys.stderr, flush=True)


def _serve(tab: Tab, host: str, port: int, on: Callable[[], bool], note: str = "") -> None:
    with listen(host, port) as listening:
        door = Door.at(host, listening.getsockname()[1])
        page = Page(door, listening, [tab])
        try:
            for text in (note, f"page: {door.url}"):
                if text:
                    _say(text)
            page.loop(on)
        except KeyboardInterrupt:  # Ctrl-C is the usual way to end a page
            pass
        finally:
            page.close()
