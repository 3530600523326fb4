"""When which leaf of a tree ran, by a run's log: the intervals of a Gantt chart.

A log tells how the last tick of every node ended whenever that is another than before (`data.runlog`); logs from before
that tell which leaf commanded in each tick, and nothing of the others.
"""

from __future__ import annotations

from dataclasses import dataclass

from mazeplan.data.runlog import STATUSES, RunLog

IDLE, RUNNING = STATUSES["INVALID"], STATUSES["RUNNING"]


@dataclass(frozen=True)
class Bar:
    """A leaf (its path in the tree) was in a status (a letter of `STATUSES`) from start to end, s of rig time."""

    path: str
    status: str
    start: float
    end: float


def leaf_bars(log: RunLog) -> list[Bar]:
    """Of all leaves that were ticked, by tree and time; leaves in the order of the tree."""
    ticks = log.ticks["t"]
    if not len(ticks):
        return []
    last = float(ticks[-1])
    if not log.trees:
        return _by_command(log, last)
    found: list[Bar] = []
    for number, tree in enumerate(log.trees):
        end = log.trees[number + 1]["t"] if number + 1 < len(log.trees) else last
        found += _of_tree(tree, end)
    order = {path: i for i, path in enumerate(dict.fromkeys(p for tree in log.trees for p in tree["paths"]))}
    return sorted(found, key=lambda bar: (order[bar.path], bar.start))


def _of_tree(tree: dict, end: float) -> list[Bar]:
    above = set(tree["parents"])
    changes = [*tree["statuses"], (max(end, tree["statuses"][-1][0]) if tree["statuses"] else end, "")]
    found = []
    for i, path in enumerate(tree["paths"]):
        if i in above:
            continue
        status, since = IDLE, tree["t"]
        for t, letters in changes:
            now = letters[i] if letters else ""
            if now == status:
                continue
            if status != IDLE:
                found.append(Bar(path, status, since, t))
            status, since = now, t
    return found


def _by_command(log: RunLog, last: float) -> list[Bar]:
    """Stretches of ticks in which a leaf commanded."""
    names = log.ticks.get("leaf")
    if names is None:
        return []
    found: list[Bar] = []
    name, since = "", 0.0
    for t, now in [*zip(log.ticks["t"].tolist(), names.tolist(), strict=True), (last, "")]:
        if now == name:
            continue
        if name:
            found.append(Bar(name, RUNNING, since, t))
        name, since = now, t
    return found


def labels(bars: list[Bar]) -> dict[str, str]:
    """Path -> what a reader calls it: the leaf's own name, with as much of the path as makes it the only one."""
    paths = list(dict.fromkeys(bar.path for bar in bars))
    found = {}
    for path in paths:
        parts = path.split("/")
        tails = (parts[-n:] for n in range(1, len(parts) + 1))
        alone = (tail for tail in tails if sum(other.split("/")[-len(tail) :] == tail for other in paths) == 1)
        found[path] = " / ".join(next(alone, parts))
    return found
