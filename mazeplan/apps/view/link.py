"""The line between a run and its page. The page is a process of its own, so that it costs the run no time.

    run's thread --take--> queue --one thread--> pipe --> page        page --orders--> pipe --one thread--> on_order

`take` only puts a message into a queue. If the page is too slow, or hangs, the queue fills. Then `take` drops ticks,
plans and statuses. If the queue fills further, `take` also drops rare messages, such as the beginning of a run.
"""

from __future__ import annotations

import os
import signal
import socket
import sys
import threading
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field
from multiprocessing import get_context
from multiprocessing.connection import Connection
from time import sleep
from typing import TYPE_CHECKING, Any

from mazeplan.apps.view.page import RunView, draw_loop, html, open_page
from mazeplan.apps.view.story import Story
from mazeplan.maze.geometry import Maze

if TYPE_CHECKING:
    from viser import ViserServer

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
    """What a person can operate: a maze on a rig."""

    maze: Maze
    rig: str
    faults: dict[str, str] = field(default_factory=dict)  # kind -> its description; empty on a real rig


def head_html(offer: Offer, phase: str, note: str) -> str:
    """Rig and map, and the phase with a note."""
    return html("live_head", offer.rig, offer.maze.name, phase, *PHASES[phase], note)


class LiveTab:
    """What a live page shows. order: gets all orders"""

    def __init__(self, server: ViserServer, offer: Offer, order: Callable[[Order], None]) -> None:
        self._offer, self._order = offer, order
        self._story = Story()
        self._state: dict[str, Any] = {"phase": "idle", "note": ""}
        self._state_shown: dict[str, Any] = {}
        self._head = server.gui.add_html("")
        self._build_buttons(server.gui)
        self._view = RunView(server, offer.maze)

    def _build_buttons(self, gui: Any) -> None:
        offer = self._offer
        level = gui.add_command("Emergency stop", hotkey="escape", description="plate level at once, and the run ends")
        level.on_trigger(lambda event: self._order({"do": "level"}))
        self._start = gui.add_button("Start", color="green", hint="begin a run")
        self._start.on_click(lambda event: self._order({"do": "start"}))
        self._stop = gui.add_button("Stop", color="gray", hint="end the run at its next tick, plate level")
        self._stop.on_click(lambda event: self._order({"do": "stop"}))
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

    def take(self, topic: str, document: dict[str, Any]) -> None:
        """Take a message of the run or of the session."""
        if topic == STATE:
            self._state = document
        else:
            self._story.take(topic, document)

    def draw(self, now: float) -> None:
        """Draw what the messages told until now; now: monotonic, s."""
        moment = self._story.moment
        if moment.run:
            self._view.show(moment, now)
        if self._state != self._state_shown:
            self._state_shown, phase = self._state, str(self._state["phase"])
            resting = phase in ("idle", "failed")
            self._start.disabled, self._stop.disabled = not resting, resting
            self._head.content = head_html(self._offer, phase, str(self._state["note"]))


FREQUENT = frozenset({"/tick", "/plan", "/status"})
WAITING, MOST = 300, 5000  # with this many messages in the queue, frequent messages (WAITING) or all (MOST) are dropped
PAUSE_S = 0.015  # s between looks into the queue; it has no lock, so that the run never waits
END_S = 2.0  # s that the page has to end by itself
NICE = 5  # niceness of the page: the run goes first when both want the processor


class PageLink:
    """A page in a process of its own; a context manager.

    on_order: called with each order, in a separate thread
    opened, ended: set when the first browser shows the page, and when the page has ended"""

    def __init__(self, offer: Offer, listening: socket.socket, on_order: Callable[[Order], object]) -> None:
        self.opened, self.ended = threading.Event(), threading.Event()
        self.viewers = 0  # browsers that show the page
        self._on_order, self._closing = on_order, False
        self._queue: deque[tuple[str, dict[str, Any]]] = deque()
        context = get_context("spawn")
        self._pipe, theirs = context.Pipe()
        arguments = (offer, listening, theirs)
        self._process = context.Process(target=live_page, args=arguments, name="mazeplan page", daemon=True)
        self._process.start()
        theirs.close()
        for work in (self._send, self._receive):
            threading.Thread(target=work, name=f"mazeplan page {work.__name__}", daemon=True).start()

    def take(self, topic: str, t: float, document: dict[str, Any]) -> None:
        """Pass a message of the run to the page; returns at once (`core.logs.run_log.Take`)."""
        waiting = len(self._queue)
        if waiting < WAITING or (waiting < MOST and topic not in FREQUENT):
            self._queue.append((topic, document))

    def tell(self, phase: str, note: str = "") -> None:
        """Tell the page the phase of the session: idle, failed (the last run could not begin), starting or running."""
        self.take(STATE, 0.0, {"phase": phase, "note": note})

    def _send(self) -> None:
        with suppress(OSError, ValueError):  # the page has ended
            while not self.ended.is_set():
                batch = [self._queue.popleft() for _ in range(len(self._queue))]
                if batch:
                    self._pipe.send(batch)
                sleep(PAUSE_S)

    def _receive(self) -> None:
        while True:
            try:
                order = self._pipe.recv()
            except (EOFError, OSError):
                self.ended.set()
                if not self._closing:
                    with suppress(OSError):
                        print("mazeplan: the page has ended; the run goes on without it", file=sys.stderr)
                return
            if order["do"] == "viewers":
                self.viewers = order["count"]
                if self.viewers:
                    self.opened.set()
            else:
                self._on_order(order)

    def close(self) -> None:
        """End the page."""
        self._closing = True
        self.ended.set()
        with suppress(OSError), socket.socket(fileno=os.dup(self._pipe.fileno())) as line:
            line.shutdown(socket.SHUT_RDWR)  # closing alone does not end a call that waits for the other end
        self._process.join(END_S)
        if self._process.is_alive():
            self._process.kill()
            self._process.join()
        self._pipe.close()

    def __enter__(self) -> PageLink:
        return self

    def __exit__(self, *problem: object) -> None:
        self.close()


def live_page(offer: Offer, listening: socket.socket, pipe: Connection) -> None:
    """The page's process. It draws until the other end of the pipe is gone. It leaves Ctrl-C to the run's process."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    with suppress(OSError, AttributeError):
        os.nice(NICE)
    server, ready = open_page(listening, html("stop_bar"))
    lock, viewers = threading.Lock(), 0

    def send(order: Order) -> None:
        with lock, suppress(OSError):  # a button's thread may call this
            pipe.send(order)

    def on() -> bool:
        """Send the number of viewers, and take what the run has told."""
        nonlocal viewers
        if len(server.get_clients()) != viewers:
            viewers = len(server.get_clients())
            send({"do": "viewers", "count": viewers})
        try:
            while pipe.poll():
                for topic, document in pipe.recv():
                    tab.take(topic, document)
        except (EOFError, OSError):
            return False
        return True

    tab = LiveTab(server, offer, send)
    ready.set()
    draw_loop(server, tab.draw, on)
    sys.stderr.flush()
    os._exit(0)  # viser's threads wait for browsers, which may hang
