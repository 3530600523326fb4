"""What a run says of itself, as HTML: where it is, the behaviour tree with how its nodes ended, the last failure.

Statuses are told by colour and by a sign, active nodes by bold type and a bar, so that nothing hangs on colours alone.
"""

from __future__ import annotations

from html import escape
from typing import TYPE_CHECKING

from mazeplan.palette import COLOURS
from mazeplan.view.moment import Moment, TreeNode

if TYPE_CHECKING:
    from viser import ViserServer

HZ = 10.0  # so often at most
SIGNS = {  # letter of a status -> sign, name in the palette, word
    "R": ("▶", "running", "running"),
    "S": ("✓", "success", "success"),
    "F": ("✕", "failure", "failure"),
    "K": ("–", "skipped", "skipped"),
    "-": ("·", "skipped", "idle"),
}
FONT = "font-size:12px;line-height:1.35;"


class Facts:
    """Where the run is, in a few lines, in the container that is current when it is made."""

    def __init__(self, server: ViserServer) -> None:
        self._html = server.gui.add_html(facts_html(Moment()))
        self._at, self._before = 0.0, ""

    def show(self, moment: Moment, now: float) -> None:
        """Draw a moment; now: s of any clock."""
        if now - self._at < 1.0 / HZ:
            return
        text = facts_html(moment)
        if text != self._before:
            self._html.content, self._before, self._at = text, text, now


class TreePanel:
    """The behaviour tree, in the container that is current when it is made."""

    def __init__(self, server: ViserServer) -> None:
        self._html = server.gui.add_html(tree_html(Moment()))
        self._at, self._before = 0.0, (-1, -1, "", -1)

    def show(self, moment: Moment, now: float) -> None:
        """Draw a moment; now: s of any clock."""
        key = (moment.run, moment.tree, moment.statuses, moment.failures)
        if key == self._before or now - self._at < 1.0 / HZ:
            return
        self._before, self._at = key, now
        self._html.content = tree_html(moment)


def facts_html(moment: Moment) -> str:
    """Time, rings, leaf, computing time, outcome, last failure, what happened last."""
    rows = [("time", f"{moment.t:.2f} s" if moment.tick else "–")]
    goal = moment.goal if moment.tick else None  # before, another one may wait to be read
    rows.append(("ring", f"{moment.ring or '–'}{f' → {goal}' if goal else ''}"))
    rows.append(("doing", _doing(moment)))
    if len(moment.rows):
        planner, tick = moment.column("planner_ms")[-1], moment.column("tick_ms")[-1]
        if planner == planner or tick == tick:  # not NaN: somebody planned
            rows.append(("planner, tick", f"{_ms(planner)}, {_ms(tick)}"))
    if moment.doubts:
        rows.append(("not believed", moment.doubts))
    cells = "".join(
        f'<tr><td style="color:#666;padding-right:10px;white-space:nowrap">{name}</td>'
        f'<td data-fact="{name}">{escape(text)}</td></tr>'
        for name, text in rows
    )
    said = "".join(f"<div>{s.t:6.2f} s  {escape(s.text)}</div>" for s in reversed(moment.said[-5:]))
    return (
        f'<div style="{FONT}padding:2px 12px">{_outcome(moment)}<table style="border-spacing:0">{cells}</table>'
        f'{_failure(moment)}<div style="color:#666;margin-top:4px;white-space:pre-wrap">{said}</div></div>'
    )


def _doing(moment: Moment) -> str:
    if moment.result is not None or not moment.tick:
        return "–"
    excitation = moment.header.get("excitation")
    leaf = moment.leaf or (f"excitation: {excitation}" if excitation else "–")
    return f"{leaf}{f' to {moment.opening}' if moment.opening else ''}"


def _ms(value: float) -> str:
    return f"{value:.1f} ms" if value == value else "–"  # NaN is not itself


def _outcome(moment: Moment) -> str:
    if moment.result is None:
        return ""
    arrived = bool(moment.result.get("success"))
    sign, word = ("✓", "arrived") if arrived else ("✕", str(moment.result.get("reason", "")))
    colour = COLOURS["good" if arrived else "bad"]
    time = moment.result.get("time_s")
    after = f" after {time:.2f} s" if isinstance(time, int | float) else ""
    return (
        f'<div style="color:{colour};font-weight:bold;font-size:14px" data-outcome>{sign} {escape(word)}{after}</div>'
    )


def _failure(moment: Moment) -> str:
    failure = moment.failure
    if failure is None:
        return ""
    recovery = f" → {escape(failure.recovery)}" if failure.recovery else ""
    return (
        f'<div data-failure style="border-left:4px solid {COLOURS["bad"]};padding-left:6px;margin-top:4px">'
        f"<b>last failure</b> at {failure.t:.2f} s: {escape(str(failure.kind))}{recovery}<br>"
        f'<span style="color:#666">{escape(failure.detail)} ({escape(failure.where)})</span></div>'
    )


def tree_html(moment: Moment) -> str:
    """A line for each node, indented."""
    if not moment.nodes:
        return f'<div style="{FONT}color:#666;padding:2px 12px">no tree{"" if moment.tick else " yet"}</div>'
    active = set(moment.active)
    failed = moment.failure.where if moment.failure is not None else None
    lines = [
        _node(node, moment.statuses[i : i + 1] or "-", i in active, node.name == failed)
        for i, node in enumerate(moment.nodes)
    ]
    legend = "  ".join(f'<span style="color:{_ink(name)}">{sign}</span> {word}' for sign, name, word in SIGNS.values())
    return (
        f'<div style="{FONT}padding:2px 12px" data-tree="{moment.tree}">{"".join(lines)}'
        f'<div style="color:#666;margin-top:4px">{legend}</div></div>'
    )


def _ink(name: str) -> str:
    return "#9a9a9a" if name == "skipped" else COLOURS[name]


def _node(node: TreeNode, letter: str, active: bool, failed: bool) -> str:
    sign, colour, word = SIGNS.get(letter, SIGNS["-"])
    ink = _ink(colour)
    bar = COLOURS["running"] if active else "transparent"
    kind = f' <span style="color:#999">{escape(node.kind)}</span>' if node.kind != node.name else ""
    mark = f' <span style="color:{COLOURS["bad"]}">← last failure</span>' if failed else ""
    weight = "bold" if active else "normal"
    return (
        f'<div title="{escape(node.path, quote=True)}: {word}" style="border-left:3px solid {bar};'
        f'padding-left:{4 + 9 * node.depth}px;white-space:nowrap;overflow:hidden;text-overflow:ellipsis">'
        f'<span style="color:{ink};display:inline-block;width:13px">{sign}</span>'
        f'<span style="font-weight:{weight};color:{"#222" if letter != "-" else "#888"}">{escape(node.name)}</span>'
        f"{kind}{mark}</div>"
    )
