"""The tab of a run that goes on, or waits to begin: the scene, curves at its left, buttons and tree at its right."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from html import escape
from typing import Any

from mazeplan.maze.geometry import Maze
from mazeplan.palette import COLOURS
from mazeplan.view.camera import Layout
from mazeplan.view.page import WIDTH, Page
from mazeplan.view.panel import Facts, TreePanel
from mazeplan.view.plots import NOTE, Plots
from mazeplan.view.scene import TILT_SHOWN, Scene, outline
from mazeplan.view.story import Story

Order = dict[str, Any]  # {"do": "start" | "stop" | "level" | "goal" | "close" | "open" | "fault", ...}
STATE = "state"  # topic of what is told of the session, beside the topics of a run
PHASES = {  # sign, words, name in the palette
    "idle": ("■", "no run", "neutral"),
    "starting": ("…", "a run gets ready", "planned"),
    "running": ("▶", "a run goes on", "running"),
    "failed": ("✕", "the run could not go on", "bad"),
}


@dataclass(frozen=True)
class Offer:
    """What can be operated here: a maze, on a rig of that name; faults: kind -> what it is, none on a real machine."""

    maze: Maze
    rig: str
    faults: dict[str, str] = field(default_factory=dict)


class LiveTab:
    """See `page.Tab`. drain: all messages (topic, document) since it was called last; order: does what was pressed."""

    def __init__(
        self, offer: Offer, drain: Callable[[], Iterable[tuple[str, dict[str, Any]]]], order: Callable[[Order], object]
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
            self._plots = Plots(server)
        curves.dock_left()
        curves.set_width(WIDTH)
        with page.tabs.add_tab("Run"):
            self._head = gui.add_html("")
            self._build_buttons(page)
            self._facts = Facts(server)
            with gui.add_folder("Behaviour tree"):
                self._tree = TreePanel(server)

    def _build_buttons(self, page: Page) -> None:
        gui, offer = page.server.gui, self._offer
        level = gui.add_button("Level now", color="red", hint="plate level at once, and the run ends")
        self._start = gui.add_button("Start", color="green", hint="begin a run")
        self._stop = gui.add_button("Stop", color="gray", hint="end the run at its next tick, plate level")
        for button, what in ((level, "level"), (self._start, "start"), (self._stop, "stop")):
            button.on_click(self._ordering(lambda event, what=what: {"do": what}))
        rings = [str(ring.number) for ring in offer.maze.rings]  # short, so that seven are in one row
        goal = gui.add_button_group("Go to ring", rings, hint="from where the ball is; or click a ring's floor")
        goal.on_click(self._ordering(lambda event: {"do": "goal", "ring": int(event.target.value)}))
        names = [opening.name for opening in offer.maze.openings]
        if names:
            with gui.add_folder("Openings", expand_by_default=False):
                which = gui.add_dropdown("Opening", names, hint="rings that it joins @ its angle in deg")
                shut = gui.add_button_group("Use", ["close", "open"], hint="or click an opening")
                shut.on_click(self._ordering(lambda event: {"do": event.target.value, "opening": which.value}))
        if offer.faults:
            with gui.add_folder("Faults", expand_by_default=False):
                kinds = list(offer.faults)
                fault = gui.add_dropdown("Fault", kinds)
                what_it_is = gui.add_html(fault_html(offer, kinds[0]))
                fault.on_update(lambda event: setattr(what_it_is, "content", fault_html(offer, fault.value)))
                inject = gui.add_button("Inject", color="orange", hint="from now on, as long as docs/faults.md says")
                inject.on_click(self._ordering(lambda event: {"do": "fault", "kind": fault.value}))
        with gui.add_folder("Picture", expand_by_default=False):
            tilt = gui.add_slider("Tilt drawn, times", 1.0, 6.0, 0.5, TILT_SHOWN)

            @tilt.on_update
            def _(event: Any) -> None:
                self._scene.tilt_shown = float(event.target.value)

    def _ordering(self, order: Callable[[Any], Order]) -> Callable[[Any], None]:
        def press(event: Any) -> None:
            self._order(order(event))

        return press

    def _toggle(self, opening: str) -> None:
        shut = next((gate.closed for gate in self._moment.gates if gate.name == opening), False)
        self._order({"do": "open" if shut else "close", "opening": opening})

    def draw(self, now: float) -> None:
        """What came since it was drawn last."""
        for topic, document in self._drain():
            if topic == STATE:
                self._state = document
            else:
                self._story.take(topic, document)
        moment = self._moment = self._story.moment()
        if not moment.run:
            self._draw_state()
            return
        self._scene.show(moment)
        self._plots.show(moment, now)
        self._facts.show(moment, now)
        self._tree.show(moment, now)
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
    """What a fault is, below its name: as one line it would be cut off."""
    return f'<div style="{NOTE}" data-fault="{escape(kind, quote=True)}">{escape(offer.faults[kind])}</div>'


def head_html(offer: Offer, phase: str, note: str) -> str:
    """Rig, map, and how things stand; what a person waits for, or has to know, in a frame."""
    sign, word, colour = PHASES.get(phase, ("", phase, "neutral"))
    told = f'<div style="font-size:12px" data-note>{escape(note)}</div>' if note else ""
    frame = f"border-left:4px solid {COLOURS[colour]};padding-left:6px;margin-top:2px"
    return (
        f'<div style="font-size:13px;line-height:1.35;padding:2px 12px" data-phase="{escape(phase, quote=True)}">rig '
        f"<b>{escape(offer.rig)}</b>, map <b>{escape(offer.maze.name)}</b>"
        f'<div style="{frame}"><b style="color:{COLOURS[colour]}">{sign} {escape(word)}</b>{told}</div></div>'
    )
