"""What is told of a run while it goes on: to a feed as to a log, with the tree and how its nodes end."""

from __future__ import annotations

import json

import numpy as np
from planar_rig import PlanarRig

from mazeplan.core.logs.run_log import STATUSES
from mazeplan.core.logs.run_log_reader import read_messages
from mazeplan.learning.modelfile import RigModel
from mazeplan.maze.mapfile import load_map
from mazeplan.run.execution import run_job
from mazeplan.run.specification import Job, Setup

MAZE = load_map("cme")
SETUP = Setup(MAZE, RigModel.nominal(MAZE))


def test_a_feed_gets_what_the_log_gets(tmp_path):
    told = []
    log = tmp_path / "run.mcap"
    run_job(PlanarRig(MAZE), SETUP, Job(4, 5, 0.3), log=log, feed=lambda *message: told.append(message))
    _, messages, complete = read_messages(log)
    assert complete
    assert [topic for topic, _, _ in told] == [topic for topic, _ in messages]
    for (_, _, here), (topic, there) in zip(told, messages, strict=True):
        if topic in ("/tree", "/status", "/event"):
            assert json.loads(json.dumps(here)) == there
    assert {t for topic, t, _ in told if topic == "/tick"} == {m["t"] for topic, m in messages if topic == "/tick"}


def test_every_result_has_a_letter_of_its_own():
    assert len(set(STATUSES.values())) == len(STATUSES)
    assert all(len(letter) == 1 for letter in STATUSES.values())
    assert np.all([name.isupper() for name in STATUSES])
