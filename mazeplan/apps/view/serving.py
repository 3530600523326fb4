"""The page of recorded runs, served until Ctrl-C."""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path

from mazeplan.apps.view.door import Door, listen
from mazeplan.apps.view.page import Page
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

    with listen(host, port) as listening:
        door = Door.at(host, listening.getsockname()[1])
        page = Page(door, listening, [ReplayTab(runs)])
        try:
            with suppress(OSError):  # stderr may be closed; the page goes on
                print(f"page: {door.url}", file=sys.stderr, flush=True)
            page.loop(on)
        except KeyboardInterrupt:  # Ctrl-C is the usual way to end a page
            pass
        finally:
            page.close()
