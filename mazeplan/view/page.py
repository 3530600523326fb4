"""A page: a server behind its door, and tabs that are drawn by one thread.

A tab is whatever has `build` and `draw` (`Tab`). It gets the page, whose `server` is viser's, and puts what it has into
`page.tabs`, the group of tabs in the panel at the right; the scene is for one tab alone, as all see the same, and that
one says what of it is to be seen (`page.framing`).
"""

from __future__ import annotations

import sys
import traceback
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager, suppress
from threading import Event
from time import monotonic, sleep
from typing import TYPE_CHECKING, Any, Protocol

from mazeplan.view.camera import Framing
from mazeplan.view.door import Door
from mazeplan.view.server import open_server

if TYPE_CHECKING:
    import socket

    from viser import GuiTabGroupHandle, ViserServer

HZ = 25.0  # drawn so often
WIDTH = 340  # pixels of the panels at both sides: with one of 1024 there is as much left between them
FONT = "font-size:13px;line-height:1.4;padding:2px 12px;"


def pressed(lock: AbstractContextManager[object], do: Callable[[Any], object]) -> Callable[[Any], None]:
    """What a person does in a browser, one after another; not what the program itself sets."""

    def on(event: Any) -> None:
        if getattr(event, "client_id", 0) is not None:
            with lock:
                do(event)

    return on


class Tab(Protocol):
    """Something to show and to press."""

    def build(self, page: Page) -> None:
        """Put what there is to see into the page; once."""

    def draw(self, now: float) -> None:
        """Bring it up to date; now: monotonic, s. Called `HZ` times a second, and must be done in a few ms."""


class Page:
    """An open page. Raises what `open_server` raises."""

    def __init__(self, door: Door, listening: socket.socket, tabs: Sequence[Tab], *, title: str = "mazeplan") -> None:
        self.door = door
        ready = Event()
        self.server: ViserServer = open_server(door, listening, ready)
        self._tabs = tuple(tabs)
        self._told = False
        gui, scene = self.server.gui, self.server.scene
        gui.configure_theme(show_logo=False, show_share_button=False, brand_color=(0, 95, 153))
        gui.set_panel_label(title)
        gui.main_panel.dock_right()
        gui.main_panel.set_width(WIDTH)
        scene.set_up_direction("+z")
        scene.configure_environment_map(None)
        scene.configure_default_lights(cast_shadow=False)
        scene.add_light_ambient("/light", intensity=0.9)
        scene.add_light_directional("/lamp", intensity=0.7, position=(-0.8, -2.5, 2.0))
        self.framing = Framing(self.server)
        self.tabs: GuiTabGroupHandle = gui.add_tab_group()
        for tab in self._tabs:
            tab.build(self)
        ready.set()

    @property
    def seen(self) -> bool:
        """Whether somebody has it open."""
        return bool(self.server.get_clients())

    def draw(self) -> None:
        """All tabs once. What goes wrong in one is told once, and the others are drawn all the same."""
        for tab in self._tabs:
            try:
                with self.server.atomic():
                    tab.draw(monotonic())
            except Exception:
                if not self._told:
                    self._told = True
                    with suppress(OSError):
                        print(f"mazeplan: the page could not draw: {traceback.format_exc()}", file=sys.stderr)

    def loop(self, on: Callable[[], bool]) -> None:
        """Draw until `on` says no more."""
        due = monotonic()
        while on():
            self.draw()
            due = max(due + 1.0 / HZ, monotonic())
            sleep(max(0.0, due - monotonic()))

    def close(self) -> None:
        """Let everybody go."""
        self.server.stop()
