"""Facts of a run, its behaviour tree and its last failure, as HTML.

A status has a colour and a sign; active nodes are bold and have a bar.
"""

from __future__ import annotations

from html import escape

from mazeplan.apps.view.story import Moment, NodeShown
from mazeplan.core.palette import COLOURS, INKS

SIGNS = {  # letter of a status -> sign, style, word
    "R": ("▶", "running", "running"),
    "S": ("✓", "success", "success"),
    "F": ("✕", "failure", "failure"),
    "K": ("–", "skipped", "skipped"),
    "-": ("·", "skipped", "idle"),
}
FONT = "font-size:12px;line-height:1.35;"
GREY = f'style="color:{INKS["quiet"]}'


def facts_html(moment: Moment) -> str:
    """Time, rings, leaf, outcome, last failure."""
    leaf = moment.leaf or (f"excitation: {excitation}" if (excitation := moment.header.get("excitation")) else "–")
    rows = {"time": "–", "ring": "–", "doing": "–"}  # before the first tick another goal may wait to be read
    if moment.tick:
        rows["time"] = f"{moment.t:.2f} s"
        rows["ring"] = f"{moment.ring or '–'}{f' → {moment.goal}' if moment.goal else ''}"
        if moment.result is None:
            rows["doing"] = f"{leaf}{f' to {moment.opening}' if moment.opening else ''}"
    cells = "".join(
        f'<tr><td {GREY};padding-right:10px;white-space:nowrap">{name}</td>'
        f'<td data-fact="{name}">{escape(text)}</td></tr>'
        for name, text in rows.items()
    )
    table = f'<table style="border-spacing:0">{cells}</table>'
    return f'<div style="{FONT}padding:2px 12px">{_outcome(moment)}{table}{_failure(moment)}</div>'


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
        f'<div title="{escape(node.name, quote=True)}: {word}" style="border-left:3px solid {bar};'
        f'padding-left:{4 + 9 * node.depth}px;white-space:nowrap;overflow:hidden;text-overflow:ellipsis">'
        f'<span style="color:{INKS[style]};display:inline-block;width:13px">{sign}</span>'
        f'<span style="font-weight:{weight};color:{INKS["ink" if letter != "-" else "quiet"]}">'
        f"{escape(node.name)}</span>"
        f"{kind}{mark}</div>"
    )
