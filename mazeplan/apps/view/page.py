"""A page: a server, and a tab that one thread draws. The tab has the methods `build` and `draw` (`Tab`)."""

from __future__ import annotations

import sys
import traceback
from collections.abc import Callable
from contextlib import suppress
from threading import Event
from time import monotonic, sleep
from typing import TYPE_CHECKING, Protocol

from mazeplan.apps.view.panel import HtmlPanel, facts_html, tree_html
from mazeplan.apps.view.scene import TILT_SHOWN, Scene, look_from_above
from mazeplan.apps.view.server import open_server
from mazeplan.apps.view.story import Moment
from mazeplan.core.errors import InputError
from mazeplan.maze.geometry import Maze

if TYPE_CHECKING:
    import socket

    from viser import GuiTabGroupHandle, ViserServer

HZ = 30.0  # rate of drawing, the same as that of a rig's samples, so that at least 25 frames a second arrive
WIDTH = 340  # pixels of the panel at each side; a window of 1024 pixels has as much room between the two
FONT = "font-size:13px;line-height:1.4;padding:2px 12px;"


class Tab(Protocol):
    """A tab of the page."""

    def build(self, page: Page) -> None:
        """Add all elements to the page; called once."""

    def draw(self, now: float) -> None:
        """Update the elements within a few ms; now: monotonic, s. Called `HZ` times a second."""


class Page:
    """An open page. bar: HTML above the page. Raises what `open_server` raises."""

    def __init__(self, listening: socket.socket, tab: Tab, *, bar: str = "") -> None:
        ready = Event()
        self.server: ViserServer = open_server(listening, ready, bar)
        self._tab = tab
        self._printed = False
        gui, scene = self.server.gui, self.server.scene
        gui.configure_theme(show_logo=False, show_share_button=False, brand_color=(0, 95, 153))
        gui.set_panel_label("mazeplan")
        gui.main_panel.dock_right()
        gui.main_panel.set_width(WIDTH)
        scene.set_up_direction("+z")
        scene.configure_environment_map(None)
        scene.configure_default_lights(cast_shadow=False)
        scene.add_light_ambient("/light", intensity=0.9)
        scene.add_light_directional("/lamp", intensity=0.7, position=(-0.8, -2.5, 2.0))
        self.tabs: GuiTabGroupHandle = gui.add_tab_group()
        tab.build(self)
        ready.set()

    def draw(self) -> None:
        """Draw the tab once. If it fails, print its exception (only the first one)."""
        try:
            with self.server.atomic():
                self._tab.draw(monotonic())
        except Exception as problem:  # a picture that fails must not end the page, which has the emergency stop
            if not self._printed:
                self._printed = True
                why = problem if isinstance(problem, InputError) else traceback.format_exc()
                with suppress(OSError):
                    print(f"mazeplan: the page could not draw: {why}", file=sys.stderr)

    def loop(self, on: Callable[[], bool]) -> None:
        """Draw while `on()` is true."""
        due = monotonic()
        while on():
            self.draw()
            due = max(due + 1.0 / HZ, monotonic())
            sleep(max(0.0, due - monotonic()))

    def close(self) -> None:
        """Stop the server."""
        self.server.stop()


class RunView:
    """A run on a page: the scene; facts, tree and a slider for the tilt in the current container.

    maze: None for a run without a map that can be read"""

    def __init__(self, page: Page, maze: Maze | None) -> None:
        server, gui = page.server, page.server.gui
        self._scene = None if maze is None else Scene(server, maze)
        if maze is not None:
            look_from_above(server, maze)
        self._facts = HtmlPanel(server, facts_html)
        with gui.add_folder("Behaviour tree"):
            self._tree = HtmlPanel(server, tree_html)
        self._tilt = gui.add_slider("Tilt drawn, times", 1.0, 6.0, 0.5, TILT_SHOWN)

    def show(self, moment: Moment, now: float) -> None:
        """Draw a moment; now: monotonic, s."""
        if self._scene is not None:
            self._scene.tilt_shown = float(self._tilt.value)
            self._scene.show(moment)
        for part in (self._facts, self._tree):
            part.show(moment, now)
