"""Recorded runs to be replayed, and logs of which something was changed."""

from __future__ import annotations

import pickle
from functools import cache

from planar_rig import PATIENT, PlanarRig, known

from mazeplan.core.logs.run_log import RunLogWriter
from mazeplan.core.logs.run_log_reader import read_messages
from mazeplan.maze.mapfile import load_map
from mazeplan.run.execution import run_job
from mazeplan.run.replay import replay
from mazeplan.run.settings import load_settings
from mazeplan.run.specification import Job, Setup

MAZE = load_map("cme")
HURRIED = load_settings().with_values({"travel": {"deadline_ms": 0.5}})  # searches end early, by the clock on the wall


def planar(path, start=3, goal=5, theta=0.3, mishap=None, limit=20.0, settings=PATIENT, **more):
    """A run on the planar rig; its model is known to nobody but the test."""
    setup = Setup(MAZE, known(MAZE), rig_name="planar", settings=settings, **more)
    return run_job(PlanarRig(MAZE, mishap=mishap), setup, Job(start, goal, theta, 0, limit), log=path)


def again(path):
    return replay(path, model=known(MAZE))


@cache
def _messages(path, changed_ns):
    """Header and messages of a log as it was at that time, in bytes, from which a copy is sooner made."""
    header, messages, _ = read_messages(path)
    return pickle.dumps((header, [m for m in messages if m[0] != "/header"]))


def rewritten(path, change, name="other.mcap"):
    """A log with its header and messages changed by `change(header, messages)`."""
    header, messages = pickle.loads(_messages(path, path.stat().st_mtime_ns))
    change(header, messages)
    other = path.with_name(name)
    with RunLogWriter(other, header) as log:
        for topic, document in messages:
            log.write(topic, 0.0, document)
    return other


def tick(messages, number):
    return [document for topic, document in messages if topic == "/tick"][number]


def of(messages, topic, number=0):
    return [i for i, (t, _) in enumerate(messages) if t == topic][number]


def other_end(header, messages):
    messages[of(messages, "/result")][1]["reason"] = "stuck"
