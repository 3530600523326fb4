"""The tab of a live run: the scene, curves on its left, buttons and tree on its right."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from html import escape
from typing import Any

from mazeplan.apps.view.camera import Layout
from mazeplan.apps.view.page import WIDTH, Page
from mazeplan.apps.view.panel import facts_panel, tree_panel
from mazeplan.apps.view.plots import NOTE, LivePlots
from mazeplan.apps.view.scene import TILT_SHOWN, Scene, outline
from mazeplan.apps.view.story import Story
from mazeplan.core.palette import COLOURS, INKS
from mazeplan.maze.geometry import Maze

Order = dict[str, Any]  # {"do": "start" | "stop" | "level" | "goal" | "close" | "open" | "fault", ...}
STATE = "state"  # topic of the session's phase, beside the topics of a run
PHASES = {  # sign, words, name in the palette
    "idle": ("■", "no run", "neutral"),
    "starting": ("…", "a run gets ready", "planned"),
    "running": ("▶", "a run goes on", "running"),
    "failed": ("✕", "the run could not go on", "bad"),
}


@dataclass(frozen=True)
class Offer:
    """What a person can operate: a maze on a rig; faults: kind -> its description, empty on a real machine."""

    maze: Maze
    rig: str
    faults: dict[str, str] = field(default_factory=dict)


class LiveTab:
    """See `page.Tab`. drain: gives the messages (topic, document) since the last call; order: gets all orders."""

    def __init__(
        self, offer: Offer, drain: Callable[[], Iterable[tuple[str, dict[str, Any]]]], order: Callable[[Order], None]
    ) -> None:
        self._offer, self._drain, self._order = offer, drain, order
        self._story = Story()
        self._moment = self._story.moment()
        self._state: dict[str, Any] = {"phase": "idle", "note": ""}
        self._state_shown: dict[str, Any] = {}

    def build(self, page: Page) -> None:
        """Scene, curves, buttons, facts, tree."""
        server, gui, offer = page.server, page.server.gui, self._offer
        self._scene = Scene(
            server, offer.maze,
            on_ring=lambda ring: self._order({"do": "goal", "ring": ring}), on_opening=self._toggle,
        )  # fmt: skip
        page.framing.show(Layout(outline(offer.maze)))
        curves = gui.add_panel()
        with curves.add_tab("Curves"):
            self._plots = LivePlots(server)
        curves.dock_left()
        curves.set_width(WIDTH)
        with page.tabs.add_tab("Run"):
            self._head = gui.add_html("")
            self._build_buttons(page)
            self._facts = facts_panel(server)
            with gui.add_folder("Behaviour tree"):
                self._tree = tree_panel(server)

    def _build_buttons(self, page: Page) -> None:
        gui, offer = page.server.gui, self._offer
        level = gui.add_button("Level now", color="red", hint="plate level at once, and the run ends")
        self._start = gui.add_button("Start", color="green", hint="begin a run")
        self._stop = gui.add_button("Stop", color="gray", hint="end the run at its next tick, plate level")
        for button, what in ((level, "level"), (self._start, "start"), (self._stop, "stop")):
            button.on_click(lambda event, what=what: self._order({"do": what}))
        rings = [str(ring.number) for ring in offer.maze.rings]  # short, so that seven are in one row
        goal = gui.add_button_group("Go to ring", rings, hint="from where the ball is; or click a ring's floor")
        goal.on_click(lambda event: self._order({"do": "goal", "ring": int(event.target.value)}))
        names = [opening.name for opening in offer.maze.openings]
        if names:
            with gui.add_folder("Openings", expand_by_default=False):
                which = gui.add_dropdown("Opening", names, hint="rings that it joins @ its angle in deg")
                shut = gui.add_button_group("Use", ["close", "open"], hint="or click an opening")
                shut.on_click(lambda event: self._order({"do": event.target.value, "opening": which.value}))
        if offer.faults:
            with gui.add_folder("Faults", expand_by_default=False):
                kinds = list(offer.faults)
                fault = gui.add_dropdown("Fault", kinds)
                what_it_is = gui.add_html(fault_html(offer, kinds[0]))
                fault.on_update(lambda event: setattr(what_it_is, "content", fault_html(offer, fault.value)))
                inject = gui.add_button("Inject", color="orange", hint="from now on, as long as docs/faults.md says")
                inject.on_click(lambda event: self._order({"do": "fault", "kind": fault.value}))
        with gui.add_folder("Picture", expand_by_default=False):
            tilt = gui.add_slider("Tilt drawn, times", 1.0, 6.0, 0.5, TILT_SHOWN)

            @tilt.on_update
            def _(event: Any) -> None:
                self._scene.tilt_shown = float(event.target.value)

    def _toggle(self, opening: str) -> None:
        shut = next((known.closed for known in self._moment.openings if known.name == opening), False)
        self._order({"do": "open" if shut else "close", "opening": opening})

    def draw(self, now: float) -> None:
        """Take new messages, and draw."""
        for topic, document in self._drain():
            if topic == STATE:
                self._state = document
            else:
                self._story.take(topic, document)
        moment = self._moment = self._story.moment()
        if moment.run:
            self._scene.show(moment)
            for part in (self._plots, self._facts, self._tree):
                part.show(moment, now)
        self._draw_state()

    def _draw_state(self) -> None:
        if self._state == self._state_shown:
            return
        self._state_shown = state = dict(self._state)
        phase = str(state.get("phase", "idle"))
        resting = phase in ("idle", "failed")
        self._start.disabled, self._stop.disabled = not resting, resting
        self._head.content = head_html(self._offer, phase, str(state.get("note", "")))


def fault_html(offer: Offer, kind: str) -> str:
    """Description of a fault, below its name: one line would be cut off."""
    return f'<div style="{NOTE}" data-fault="{escape(kind, quote=True)}">{escape(offer.faults[kind])}</div>'


def head_html(offer: Offer, phase: str, note: str) -> str:
    """Rig, map and phase; in a frame a note on what a person waits for, or has to know."""
    sign, word, colour = PHASES.get(phase, ("", phase, "neutral"))
    below = f'<div style="font-size:12px" data-note>{escape(note)}</div>' if note else ""
    frame = f"border-left:4px solid {COLOURS[colour]};padding-left:6px;margin-top:2px"
    return (
        f'<div style="font-size:13px;line-height:1.35;padding:2px 12px" data-phase="{escape(phase, quote=True)}">rig '
        f"<b>{escape(offer.rig)}</b>, map <b>{escape(offer.maze.name)}</b>"
        f'<div style="{frame}"><b style="color:{INKS[colour]}">{sign} {escape(word)}</b>{below}</div></div>'
    )
