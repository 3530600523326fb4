"""Facts of a run, its behaviour tree and its last failure, as HTML.

A status has a colour and a sign; active nodes are bold and have a bar.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from html import escape
from typing import TYPE_CHECKING

from mazeplan.apps.view.story import Moment, NodeShown
from mazeplan.core.palette import COLOURS, INKS

if TYPE_CHECKING:
    from viser import ViserServer

HZ = 10.0  # maximum rate of drawing a panel
SIGNS = {  # letter of a status -> sign, style, word
    "R": ("▶", "running", "running"),
    "S": ("✓", "success", "success"),
    "F": ("✕", "failure", "failure"),
    "K": ("–", "skipped", "skipped"),
    "-": ("·", "skipped", "idle"),
}
FONT = "font-size:12px;line-height:1.35;"
GREY = f'style="color:{INKS["quiet"]}'


class HtmlPanel:
    """HTML of a moment, in viser's current container."""

    def __init__(self, server: ViserServer, html: Callable[[Moment], str]) -> None:
        self._html, self._content, self._at = html, html(Moment()), 0.0
        self._shown = server.gui.add_html(self._content)

    def show(self, moment: Moment, now: float) -> None:
        """Draw a moment, at most HZ times a second; now: s of any clock."""
        if now - self._at >= 1.0 / HZ:
            self._at, content = now, self._html(moment)
            if content != self._content:
                self._content = self._shown.content = content


def facts_html(moment: Moment) -> str:
    """Time, rings, leaf, computing time, outcome, last failure, last events."""
    task = moment.task
    goal = task.goal if moment.tick else None  # before the first tick another goal may wait to be read
    rows = {
        "time": f"{moment.t:.2f} s" if moment.tick else "–",
        "ring": f"{task.ring or '–'}{f' → {goal}' if goal else ''}",
        "doing": _doing(moment),
    }
    if not all(map(math.isnan, moment.ms)):
        rows["planner, tick"] = ", ".join("–" if math.isnan(value) else f"{value:.1f} ms" for value in moment.ms)
    if task.doubts:
        rows["not believed"] = task.doubts
    cells = "".join(
        f'<tr><td {GREY};padding-right:10px;white-space:nowrap">{name}</td>'
        f'<td data-fact="{name}">{escape(text)}</td></tr>'
        for name, text in rows.items()
    )
    events = "".join(f"<div>{event.t:6.2f} s  {escape(event.text)}</div>" for event in reversed(moment.events[-5:]))
    return (
        f'<div style="{FONT}padding:2px 12px">{_outcome(moment)}<table style="border-spacing:0">{cells}</table>'
        f'{_failure(moment)}<div {GREY};margin-top:4px;white-space:pre-wrap">{events}</div></div>'
    )


def _doing(moment: Moment) -> str:
    if moment.result is not None or not moment.tick:
        return "–"
    excitation = moment.header.get("excitation")
    leaf = moment.task.leaf or (f"excitation: {excitation}" if excitation else "–")
    return f"{leaf}{f' to {moment.task.opening}' if moment.task.opening else ''}"


def _outcome(moment: Moment) -> str:
    if moment.result is None:
        return ""
    arrived, time = bool(moment.result.get("success")), moment.result.get("time_s")
    word, colour = ("✓ arrived", "good") if arrived else (f"✕ {moment.result.get('reason', '')}", "bad")
    after = f" after {time:.2f} s" if isinstance(time, int | float) else ""
    style = f"color:{INKS[colour]};font-weight:bold;font-size:14px"
    return f'<div style="{style}" data-outcome>{escape(word)}{after}</div>'


def _failure(moment: Moment) -> str:
    failure = moment.failure
    if failure is None:
        return ""
    recovery = f" → {escape(failure.recovery)}" if failure.recovery else ""
    return (
        f'<div data-failure style="border-left:4px solid {COLOURS["bad"]};padding-left:6px;margin-top:4px">'
        f"<b>last failure</b> at {failure.t:.2f} s: {escape(str(failure.kind))}{recovery}<br>"
        f'<span {GREY}">{escape(failure.words)} ({escape(failure.where)})</span></div>'
    )


def tree_html(moment: Moment) -> str:
    """A line for each node, indented."""
    tree = moment.tree
    if not tree.nodes:
        return f'<div style="{FONT}color:{INKS["quiet"]};padding:2px 12px">no tree{"" if moment.tick else " yet"}</div>'
    failed = moment.failure.where if moment.failure is not None else None
    lines = [
        _node(node, tree.statuses[i : i + 1] or "-", i in tree.active, node.name == failed)
        for i, node in enumerate(tree.nodes)
    ]
    legend = "  ".join(f'<span style="color:{INKS[name]}">{sign}</span> {word}' for sign, name, word in SIGNS.values())
    return (
        f'<div style="{FONT}padding:2px 12px" data-tree="{tree.number}">{"".join(lines)}'
        f'<div {GREY};margin-top:4px">{legend}</div></div>'
    )


def _node(node: NodeShown, letter: str, active: bool, failed: bool) -> str:
    sign, style, word = SIGNS.get(letter, SIGNS["-"])
    bar, weight = (COLOURS["running"], "bold") if active else ("transparent", "normal")
    kind = f' <span style="color:{INKS["quiet"]}">{escape(node.kind)}</span>' if node.kind != node.name else ""
    mark = f' <span style="color:{INKS["bad"]}">← last failure</span>' if failed else ""
    return (
        f'<div title="{escape(node.path, quote=True)}: {word}" style="border-left:3px solid {bar};'
        f'padding-left:{4 + 9 * node.depth}px;white-space:nowrap;overflow:hidden;text-overflow:ellipsis">'
        f'<span style="color:{INKS[style]};display:inline-block;width:13px">{sign}</span>'
        f'<span style="font-weight:{weight};color:{INKS["ink" if letter != "-" else "quiet"]}">'
        f"{escape(node.name)}</span>"
        f"{kind}{mark}</div>"
    )
