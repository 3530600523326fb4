"""The tab of a live run: the scene, curves on its left, buttons and tree on its right."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from html import escape
from typing import Any

from mazeplan.apps.view.camera import Layout
from mazeplan.apps.view.lookback import LookBack
from mazeplan.apps.view.page import FONT, WIDTH, Page
from mazeplan.apps.view.panel import facts_panel, tree_panel
from mazeplan.apps.view.plots import NOTE, LivePlots
from mazeplan.apps.view.scene import TILT_SHOWN, Scene, outline
from mazeplan.apps.view.story import Story
from mazeplan.core.palette import COLOURS, INKS
from mazeplan.maze.geometry import Maze

Order = dict[str, Any]  # {"do": "start" | "stop" | "level" | "goal" | "close" | "open" | "fault" | "pause" ...}
STATE = "state"  # topic of the session's phase, in addition to the topics of a run
PLANNED = "planned"  # topic of what the next run will do
SPEEDS = (0.1, 0.25, 0.5, 1.0)  # s of simulated time in 1 s of wall time
PHASES = {  # sign, words, name in the palette
    "idle": ("■", "no run", "neutral"),
    "starting": ("…", "a run gets ready", "planned"),
    "running": ("▶", "a run goes on", "running"),
    "paused": ("‖", "the run is paused", "unsure"),
    "failed": ("✕", "the run could not go on", "bad"),
}


@dataclass(frozen=True)
class Offer:
    """What a person can operate: a maze on a rig.

    faults: kind -> its description; empty on a real rig
    simulated: whether a run can be paused and slowed down"""

    maze: Maze
    rig: str
    faults: dict[str, str] = field(default_factory=dict)
    simulated: bool = False


class LiveTab:
    """See `page.Tab`.

    drain: gives the messages (topic, document) since its last call
    order: gets all orders"""

    def __init__(
        self, offer: Offer, drain: Callable[[], Iterable[tuple[str, dict[str, Any]]]], order: Callable[[Order], None]
    ) -> None:
        self._offer, self._drain, self._order = offer, drain, order
        self._story = Story()
        self._moment = self._story.moment()
        self._state: dict[str, Any] = {"phase": "idle", "note": ""}
        self._state_shown: dict[str, Any] = {}
        self._planned: dict[str, Any] | None = None

    def build(self, page: Page) -> None:
        """Add scene, curves, buttons, facts and tree to the page."""
        server, gui, offer = page.server, page.server.gui, self._offer
        push = "ball_pushed" in offer.faults
        self._scene = Scene(
            server, offer.maze,
            on_ring=lambda ring: self._order({"do": "goal", "ring": ring}), on_opening=self._toggle,
            on_push=(lambda x, y: self._order({"do": "push", "x": x, "y": y})) if push else None,
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
            self._back = LookBack(server)
            with gui.add_folder("Behaviour tree"):
                self._tree = tree_panel(server)

    def _build_buttons(self, page: Page) -> None:
        gui, offer = page.server.gui, self._offer
        level = gui.add_command("Emergency stop", hotkey="escape", description="plate level at once, and the run ends")
        level.on_trigger(lambda event: self._order({"do": "level"}))
        self._start = gui.add_button("Start", color="green", hint="begin a run")
        self._stop = gui.add_button("Stop", color="gray", hint="end the run at its next tick, plate level")
        for button, what in ((self._start, "start"), (self._stop, "stop")):
            button.on_click(lambda event, what=what: self._order({"do": what}))
        if offer.simulated:
            self._build_pace(gui)
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
                inject = gui.add_button("Inject", color="orange", hint="now; without a run, with the next Start")
                inject.on_click(lambda event: self._order({"do": "fault", "kind": fault.value}))
        with gui.add_folder("Legend: 93 % (69–100), colours, keys", expand_by_default=False):
            gui.add_html(legend_html(offer))
        with gui.add_folder("Picture", expand_by_default=False):
            tilt = gui.add_slider("Tilt drawn, times", 1.0, 6.0, 0.5, TILT_SHOWN)

            @tilt.on_update
            def _(event: Any) -> None:
                self._scene.tilt_shown = float(event.target.value)

    def _build_pace(self, gui: Any) -> None:
        def toggle(_: Any) -> None:
            self._order({"do": "go on" if self._state.get("phase") == "paused" else "pause"})

        pace = gui.add_button_group("Pace", ["pause", "step", "go on"], hint="keys: space, arrow to the right")
        pace.on_click(lambda event: self._order({"do": event.target.value}))
        gui.add_command("Pause, or go on", hotkey="space").on_trigger(toggle)
        gui.add_command("One step", hotkey="arrowright").on_trigger(lambda event: self._order({"do": "step"}))
        names = {f"{speed:g}×": speed for speed in SPEEDS}
        speed = gui.add_dropdown(
            "Speed", list(names), initial_value="1×", hint="slow motion; 1×: as fast as a real rig"
        )
        speed.on_update(lambda event: self._order({"do": "speed", "factor": names[event.target.value]}))

    def _toggle(self, opening: str) -> None:
        shut = next((known.closed for known in self._moment.openings if known.name == opening), False)
        self._order({"do": "open" if shut else "close", "opening": opening})

    def draw(self, now: float) -> None:
        """Take new messages and draw."""
        for topic, document in self._drain():
            if topic == STATE:
                self._state = document
            elif topic == PLANNED:
                self._planned = document
            else:
                self._story.take(topic, document)
        moment = self._moment = self._story.moment()
        planned = self._planned if self._state.get("phase") in ("idle", "failed") else None
        shown = self._back.show(moment, now)
        self._scene.show_planned(planned if self._back.past.at is None else None)
        self._scene.show_goal(moment.task.goal if planned is None else planned["goal"])
        if moment.run:
            self._scene.show(shown)
            for part in (self._plots, self._facts, self._tree):
                part.show(shown, now)
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
    """Description of a fault, to be shown below its name: in one line with the name it would be cut off."""
    return f'<div style="{NOTE}" data-fault="{escape(kind, quote=True)}">{escape(offer.faults[kind])}</div>'


def legend_html(offer: Offer) -> str:
    """What colours, labels and keys mean."""
    label = (
        "<b>93 % (69–100)</b>: the ball passes this opening with a probability of 93 %. With a certainty of 90 %, it "
        "is between 69 and 100 %. It is learned from the tries of this run, and from earlier ones with --memory."
    )
    rows = [
        (swatch("skipped"), "opening that was not tried; else dark red (seldom passed) over yellow to green"),
        (swatch("bad"), "a plug: the opening is closed"),
        (swatch("planned"), "posts: the next opening; line: the route before Start, the plan during a run; pale band: "
                            "twice the rms error of earlier plans"),
        (swatch("real"), "ball and its way of the last 3 s; a grey ball is not seen by the camera"),
        ("green floor", "the ring of the goal"),
    ]  # fmt: skip
    keys = [("Esc", "emergency stop"), ("N, P", "next, previous failure")]
    if offer.simulated:
        keys += [("space", "pause, or go on"), ("→", "one step")]
    rows += [(f"<kbd>{key}</kbd>", what) for key, what in keys]
    if "ball_pushed" in offer.faults:
        rows.append(("mouse", "drag the ball to push it"))
    cells = "".join(
        f'<tr><td style="padding-right:8px;vertical-align:top;white-space:nowrap">{name}</td><td>{what}</td></tr>'
        for name, what in rows
    )
    return f'<div style="{FONT}" data-legend>{label}<table style="font-size:12px">{cells}</table></div>'


def swatch(style: str) -> str:
    """A patch of a colour of the palette."""
    return f'<span style="display:inline-block;width:24px;height:12px;background:{COLOURS[style]}"></span>'


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
