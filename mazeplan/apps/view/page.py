"""What all pages have: viser's server with a theme and lights, the loop that draws, and the view of a run.

Facts and behaviour tree are HTML (`parts.html`). A status has a colour and a sign. Active nodes are bold, with a bar.
"""

from __future__ import annotations

import sys
import traceback
from collections.abc import Callable
from contextlib import suppress
from functools import cache
from pathlib import Path
from threading import Event
from time import monotonic, sleep
from typing import TYPE_CHECKING, Any

from mazeplan.apps.view.scene import Scene, look_from_above
from mazeplan.apps.view.server import open_server
from mazeplan.apps.view.story import Moment
from mazeplan.core.errors import InputError
from mazeplan.core.palette import COLOURS, FAINT, INKS, STOP, TINTS
from mazeplan.core.resources import template
from mazeplan.maze.geometry import Maze

if TYPE_CHECKING:
    import socket

    from viser import ViserServer

HZ = 30.0  # rate of drawing, the same as that of a rig's samples, so that at least 25 frames a second arrive
PANEL_HZ = 10.0  # maximum rate of drawing text
WIDTH = 340  # pixels of the panel; a window of 1024 pixels has twice as much room beside it
SIGNS = {  # letter of a status -> sign, style, word
    "R": ("▶", "running", "running"),
    "S": ("✓", "success", "success"),
    "F": ("✕", "failure", "failure"),
    "K": ("–", "skipped", "skipped"),
    "-": ("·", "skipped", "idle"),
}


@cache
def _parts() -> Any:
    file = Path(__file__).with_name("parts.html")
    return template(file, COLOURS=COLOURS, FAINT=FAINT, INKS=INKS, STOP=STOP, TINTS=TINTS).module


def html(part: str, *values: object) -> str:
    """A part of a page: the macro of `parts.html` with this name, filled in."""
    return str(getattr(_parts(), part)(*values))


def open_page(listening: socket.socket, bar: str = "") -> tuple[ViserServer, Event]:
    """A page without elements. Requests wait until the event is set. bar: HTML above the page

    Raises what `open_server` raises."""
    ready = Event()
    server = open_server(listening, ready, bar)
    gui, scene = server.gui, server.scene
    gui.configure_theme(show_logo=False, show_share_button=False, brand_color=(0, 95, 153))
    gui.set_panel_label("mazeplan")
    gui.main_panel.dock_right()
    gui.main_panel.set_width(WIDTH)
    scene.set_up_direction("+z")
    scene.configure_environment_map(None)
    scene.configure_default_lights(cast_shadow=False)
    scene.add_light_ambient("/light", intensity=0.9)
    scene.add_light_directional("/lamp", intensity=0.7, position=(-0.8, -2.5, 2.0))
    return server, ready


def draw_loop(server: ViserServer, draw: Callable[[float], None], on: Callable[[], bool]) -> None:
    """Call `draw` with the time (monotonic, s), `HZ` times a second, while `on()` is true.

    If drawing fails, print the exception, only the first one: the page, which has the emergency stop, goes on."""
    due, failed = monotonic(), False
    while on():
        try:
            with server.atomic():
                draw(monotonic())
        except Exception as problem:
            why = problem if isinstance(problem, InputError) else traceback.format_exc()
            if not failed:
                with suppress(OSError):
                    print(f"mazeplan: the page could not draw: {why}", file=sys.stderr)
            failed = True
        due = max(due + 1.0 / HZ, monotonic())
        sleep(max(0.0, due - monotonic()))


class RunView:
    """A run on a page: the scene, facts and tree.

    maze: None for a run without a map that can be read"""

    def __init__(self, server: ViserServer, maze: Maze | None) -> None:
        gui = server.gui
        self._scene = None if maze is None else Scene(server, maze)
        if maze is not None:
            look_from_above(server, maze)
        self._facts = gui.add_html(facts_html(Moment()))
        with gui.add_folder("Behaviour tree"):
            self._tree = gui.add_html(tree_html(Moment()))
        self._written = 0.0

    def show(self, moment: Moment, now: float) -> None:
        """Draw a moment; now: monotonic, s."""
        if self._scene is not None:
            self._scene.show(moment)
        if now - self._written < 1.0 / PANEL_HZ:
            return
        self._written = now
        for shown, html in ((self._facts, facts_html(moment)), (self._tree, tree_html(moment))):
            if shown.content != html:
                shown.content = html


def facts_html(moment: Moment) -> str:
    """Time, rings, leaf, outcome, last failure."""
    leaf = moment.leaf or (f"excitation: {excitation}" if (excitation := moment.header.get("excitation")) else "–")
    rows = {"time": "–", "ring": "–", "doing": "–"}  # before the first tick another goal may wait to be read
    if moment.tick:
        rows["time"] = f"{moment.t:.2f} s"
        rows["ring"] = f"{moment.ring or '–'}{f' → {moment.goal}' if moment.goal else ''}"
        if moment.result is None:
            rows["doing"] = f"{leaf}{f' to {moment.opening}' if moment.opening else ''}"
    return html("facts", rows, moment.result, moment.failure)


def tree_html(moment: Moment) -> str:
    """A line for each node, indented."""
    tree, failed = moment.tree, None if moment.failure is None else moment.failure.where
    return html("tree", tree, tree.statuses.ljust(len(tree.nodes), "-"), SIGNS, failed, moment.tick > 0)
