"""The tab of a live run: the scene, buttons and tree on its right."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from html import escape
from typing import Any

from mazeplan.apps.view.page import Page, RunView
from mazeplan.apps.view.story import Story
from mazeplan.core.palette import COLOURS, INKS
from mazeplan.maze.geometry import Maze

Order = dict[str, Any]  # {"do": "start" | "stop" | "level" | "goal" | "close" | "open" | "fault", and its arguments}
STATE = "state"  # topic of the session's phase, in addition to the topics of a run
PHASES = {  # sign, words, name in the palette
    "idle": ("■", "no run", "neutral"),
    "starting": ("…", "a run gets ready", "planned"),
    "running": ("▶", "a run goes on", "running"),
    "failed": ("✕", "the run could not go on", "bad"),
}


@dataclass(frozen=True)
class Offer:
    """What a person can operate: a maze on a rig.

    faults: kind -> its description; empty on a real rig"""

    maze: Maze
    rig: str
    faults: dict[str, str] = field(default_factory=dict)


class LiveTab:
    """See `page.Tab`.

    drain: gives the messages (topic, document) since its last call
    order: gets all orders"""

    def __init__(
        self, offer: Offer, drain: Callable[[], Iterable[tuple[str, dict[str, Any]]]], order: Callable[[Order], None]
    ) -> None:
        self._offer, self._drain, self._order = offer, drain, order
        self._story = Story()
        self._state: dict[str, Any] = {"phase": "idle", "note": ""}
        self._state_shown: dict[str, Any] = {}

    def build(self, page: Page) -> None:
        """Add scene, buttons, facts and tree to the page."""
        gui = page.server.gui
        with page.tabs.add_tab("Run"):
            self._head = gui.add_html("")
            self._build_buttons(gui)
            self._view = RunView(page, self._offer.maze)

    def _build_buttons(self, gui: Any) -> None:
        offer = self._offer
        level = gui.add_command("Emergency stop", hotkey="escape", description="plate level at once, and the run ends")
        level.on_trigger(lambda event: self._order({"do": "level"}))
        self._start = gui.add_button("Start", color="green", hint="begin a run")
        self._stop = gui.add_button("Stop", color="gray", hint="end the run at its next tick, plate level")
        for button, what in ((self._start, "start"), (self._stop, "stop")):
            button.on_click(lambda event, what=what: self._order({"do": what}))
        rings = [str(ring.number) for ring in offer.maze.rings]  # short, so that seven are in one row
        goal = gui.add_button_group("Go to ring", rings, hint="from where the ball is")
        goal.on_click(lambda event: self._order({"do": "goal", "ring": int(event.target.value)}))
        names = [opening.name for opening in offer.maze.openings]
        if names:
            with gui.add_folder("Openings", expand_by_default=False):
                which = gui.add_dropdown("Opening", names, hint="rings that it joins @ its angle in deg")
                shut = gui.add_button_group("Use", ["close", "open"])
                shut.on_click(lambda event: self._order({"do": event.target.value, "opening": which.value}))
        if offer.faults:
            with gui.add_folder("Faults", expand_by_default=False):
                fault = gui.add_dropdown("Fault", list(offer.faults))
                inject = gui.add_button("Inject", color="orange", hint="into the run that goes on")
                inject.on_click(lambda event: self._order({"do": "fault", "kind": fault.value}))

    def draw(self, now: float) -> None:
        """Take new messages and draw."""
        for topic, document in self._drain():
            if topic == STATE:
                self._state = document
            else:
                self._story.take(topic, document)
        moment = self._story.moment()
        if moment.run:
            self._view.show(moment, now)
        if self._state != self._state_shown:
            self._state_shown = state = dict(self._state)
            phase = str(state.get("phase", "idle"))
            resting = phase in ("idle", "failed")
            self._start.disabled, self._stop.disabled = not resting, resting
            self._head.content = head_html(self._offer, phase, str(state.get("note", "")))


def head_html(offer: Offer, phase: str, note: str) -> str:
    """Rig and map, and in a frame the phase with a note: what a person waits for or has to know."""
    sign, word, colour = PHASES.get(phase, ("", phase, "neutral"))
    below = f'<div style="font-size:12px" data-note>{escape(note)}</div>' if note else ""
    frame = f"border-left:4px solid {COLOURS[colour]};padding-left:6px;margin-top:2px"
    return (
        f'<div style="font-size:13px;line-height:1.35;padding:2px 12px" data-phase="{escape(phase, quote=True)}">rig '
        f"<b>{escape(offer.rig)}</b>, map <b>{escape(offer.maze.name)}</b>"
        f'<div style="{frame}"><b style="color:{INKS[colour]}">{sign} {escape(word)}</b>{below}</div></div>'
    )
