"""The tab of recorded runs: their mazes side by side at the same time, curves, failures, and trees."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from html import escape
from threading import RLock
from typing import Any

import numpy as np

from mazeplan.apps.view.camera import ABOVE, Layout, around
from mazeplan.apps.view.page import FONT, WIDTH, Page, pressed
from mazeplan.apps.view.panel import HtmlPanel, facts_panel, tree_panel
from mazeplan.apps.view.plots import ReplayPlots
from mazeplan.apps.view.replay.recorded import SPEEDS, Playback, RecordedRun, common_times
from mazeplan.apps.view.scene import TILT_SHOWN, UNIT, Scene, outline
from mazeplan.core.palette import INKS
from mazeplan.maze.geometry import Maze

MOST_BUTTONS = 30  # failures with a button of their own
APART, BELOW = 2.15, 2.5  # distance of two mazes side by side, or one below the other, in radii of the larger rim
FROM_BELOW = (0.0, -0.35, 1.0)  # direction of the camera if one maze is below the other
NAME_BELOW = 1.25  # distance of a maze's name from the middle of the maze, in radii of the larger rim
LETTERS = "AB"


class ReplayTab:
    """See `page.Tab`. Shows one or two recorded runs."""

    def __init__(self, recordings: Sequence[RecordedRun]) -> None:
        self._recordings = tuple(recordings)
        self._player, self._lock = Playback(common_times(recordings)), RLock()
        self._failures = sorted(
            ((mark, letter) for r, letter in zip(recordings, LETTERS, strict=False) for mark in r.failures),
            key=lambda pair: pair[0].t,
        )
        self._marks = [mark for mark, _ in self._failures]
        self._before, self._drawn, self._tilt_shown = 0.0, (), TILT_SHOWN

    def build(self, page: Page) -> None:
        """Add scenes, curves, controls of time, failures, facts and trees to the page."""
        server, gui = page.server, page.server.gui
        self._scenes = self._build_scenes(page)
        curves = gui.add_panel()
        with curves.add_tab("Curves"):
            self._plots = ReplayPlots(server, self._recordings)
        curves.dock_left()
        curves.set_width(WIDTH)
        with page.tabs.add_tab("Replay"):
            self._head = gui.add_html("")
            self._build_time(gui)
            self._build_failures(gui)
            self._panels = self._build_runs(page)
            with gui.add_folder("Picture", expand_by_default=False):
                tilt = gui.add_slider("Tilt drawn, times", 1.0, 6.0, 0.5, TILT_SHOWN)
            tilt.on_update(lambda event: setattr(self, "_tilt_shown", float(event.target.value)))

    def _build_scenes(self, page: Page) -> list[Scene | None]:
        two = len(self._recordings) > 1
        mazes = {letter: recording.maze for recording, letter in zip(self._recordings, LETTERS, strict=False)}
        reach = max((maze.walls[0].outer_radius for maze in mazes.values() if maze), default=0.1)
        page.framing.show(*layouts(mazes, reach))
        scenes: list[Scene | None] = []
        for recording, (letter, maze) in zip(self._recordings, mazes.items(), strict=True):
            name = f"/run{letter}"
            scenes.append(Scene(page.server, maze, name, places(mazes, reach)[letter]) if maze else None)
            if two and maze:
                below = (0.0, -UNIT * NAME_BELOW * reach, 0.0)
                page.server.scene.add_label(f"{name}/name", f"{letter}: {recording.name}", position=below)
        return scenes

    def _build_time(self, gui: Any) -> None:
        player = self._player
        marks = tuple(round(mark.t, 2) for mark in self._marks if player.first <= mark.t <= player.last)
        span = round(player.last - player.first, 2)
        self._slider = gui.add_slider(
            "Time (s)", round(player.first, 2), round(player.first + max(span, 0.01), 2), 0.01, round(player.first, 2),
            marks=marks or None, hint="points below: failures",
        )  # fmt: skip
        self._slider.on_update(self._pressed(lambda event: self._seek(event.target.value)))
        self._play = gui.add_button("Play", color="blue", hint="space")
        self._play.on_click(self._pressed(lambda event: player.toggle()))
        steps = gui.add_button_group("Step", ["−1 s", "−tick", "+tick", "+1 s"], hint="arrow keys: ticks")
        steps.on_click(self._pressed(lambda event: self._step(event.target.value)))
        speeds = [f"{speed:g}×" for speed in SPEEDS]
        speed = gui.add_dropdown("Speed", speeds, initial_value="1×", hint="1×: as fast as it was")
        speed.on_update(self._pressed(lambda event: setattr(player, "speed", float(event.target.value[:-1]))))
        for label, key, do in (
            ("Play or stop", "space", player.toggle),
            ("One tick on", "arrowright", lambda: player.step(1)),
            ("One tick back", "arrowleft", lambda: player.step(-1)),
            ("Next failure", "N", lambda: player.jump(self._marks, 1)),
            ("Previous failure", "P", lambda: player.jump(self._marks, -1)),
        ):
            command = gui.add_command(label, hotkey=key)
            command.on_trigger(self._pressed(lambda event, do=do: do()))

    def _build_failures(self, gui: Any) -> None:
        count = len(self._marks)
        with gui.add_folder(f"Failures: {count or 'none'}"):
            if not count:
                return
            jumps = gui.add_button_group("Jump", ["previous", "next"], hint="keys P and N")
            jumps.on_click(
                self._pressed(lambda event: self._player.jump(self._marks, 1 if event.target.value == "next" else -1))
            )
            for mark, letter in self._failures[:MOST_BUTTONS]:
                name = f"{letter}  " if len(self._recordings) > 1 else ""
                button = gui.add_button(f"{name}{mark.t:.2f} s  {mark.brief}", color="gray", hint=mark.text)
                button.on_click(self._pressed(lambda event, mark=mark: self._seek(mark.t)))
            if count > MOST_BUTTONS:
                gui.add_html(f'<div style="{FONT}">and {count - MOST_BUTTONS} more: next</div>')

    def _build_runs(self, page: Page) -> list[tuple[HtmlPanel, HtmlPanel]]:
        gui, server = page.server.gui, page.server
        if len(self._recordings) == 1:
            facts = facts_panel(server)
            with gui.add_folder("Behaviour tree"):
                return [(facts, tree_panel(server))]
        group, panels = gui.add_tab_group(), []
        for letter, _ in zip(LETTERS, self._recordings, strict=False):
            with group.add_tab(f"Run {letter}"):
                panels.append((facts_panel(server), tree_panel(server)))
        return panels

    # -- what a person does -----------------------------------------------------------------------------------------

    def _pressed(self, do: Callable[[Any], object]) -> Callable[[Any], None]:
        return pressed(self._lock, do)

    def _seek(self, t: float) -> None:
        self._player.playing = False
        self._player.seek(t)

    def _step(self, what: str) -> None:
        sign = 1 if what.startswith("+") else -1
        if what.endswith("tick"):
            self._player.step(sign)
        else:
            self._seek(self._player.t + sign)

    # -- what is shown ----------------------------------------------------------------------------------------------

    def draw(self, now: float) -> None:
        """Let time pass, and draw the moment of the new time."""
        with self._lock:
            player = self._player
            player.advance(now - self._before if self._before else 0.0)
            self._before = now
            t, playing = player.t, player.playing
        for recording, scene, (facts, tree) in zip(self._recordings, self._scenes, self._panels, strict=True):
            moment = recording.at(t)
            if scene is not None:
                scene.tilt_shown = self._tilt_shown
                scene.show(moment)
            facts.show(moment, now)
            tree.show(moment, now)
        self._plots.show(t, now)
        shown = (round(t, 2), playing)
        if shown != self._drawn:
            self._drawn = shown
            self._slider.value = min(max(round(t, 2), self._slider.min), self._slider.max)
            self._play.label = "Stop" if playing else "Play"
            self._head.content = head_html(self._recordings, t)


def places(mazes: Mapping[str, Maze | None], reach: float, below: bool = False) -> dict[str, tuple[float, float]]:
    """Places of the mazes, x, y in m: one maze in the middle, two side by side or one below the other.

    reach: radius of the larger maze, m
    below: whether one maze is below the other"""
    if len(mazes) < 2:
        return dict.fromkeys(mazes, (0.0, 0.0))
    x, y = (0.0, -0.5 * BELOW * reach) if below else (0.5 * APART * reach, 0.0)
    return dict(zip(mazes, ((-x, -y), (x, y)), strict=True))


def layouts(mazes: Mapping[str, Maze | None], reach: float) -> list[Layout]:
    """The possible layouts of the mazes, each maze with its name below it."""
    found = []
    for below in (False, True)[: len(mazes)]:
        at = places(mazes, reach, below)
        points = [outline(maze, at[letter]) for letter, maze in mazes.items() if maze]
        if len(mazes) > 1:
            points += [np.array([[UNIT * x, UNIT * (y - NAME_BELOW * reach), 0.0]]) for x, y in at.values()]
        frames = {f"/run{letter}": (UNIT * x, UNIT * y, 0.0) for letter, (x, y) in at.items()}
        side = FROM_BELOW if below else ABOVE
        found.append(Layout(np.vstack(points or [around(UNIT * reach)]), frames, side))
    return found


def head_html(recordings: Sequence[RecordedRun], t: float) -> str:
    """For each run: file, rig, map and seed, how it ended, the tick, and what its log lacks."""
    rows = []
    for recording, letter in zip(recordings, LETTERS, strict=False):
        header = recording.header
        name = f"<b>{letter}</b> " if len(recordings) > 1 else ""
        keys = (("rig", "rig"), ("map", "map_name"), ("seed", "seed"))
        facts = ", ".join(f"{word} {header[key]}" for word, key in keys if header.get(key) not in (None, ""))
        notes = "".join(f'<div style="color:{INKS["unsure"]}">{escape(note)}</div>' for note in recording.notes)
        tick = f"tick {recording.tick_at(t) + 1} of {len(recording.moments)}"
        over = "" if t <= recording.times[-1] + 1e-6 else ", over"
        rows.append(
            f'<div>{name}<b>{escape(recording.name)}</b> <span style="color:{INKS["quiet"]}">{escape(facts)}</span>'
            f'<div style="color:{INKS["quiet"]}">{escape(recording.outcome)} · {tick}{over}</div>{notes}</div>'
        )
    return f'<div style="{FONT}" data-t="{t:.3f}">{"".join(rows)}</div>'
