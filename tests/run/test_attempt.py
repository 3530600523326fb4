"""What is told of a run while it goes on: to a feed as to a log, with the tree and how its nodes end."""

from __future__ import annotations

import json
from itertools import pairwise

import numpy as np
from planar_rig import PlanarRig

from mazeplan.behavior.own_nodes import registry_with
from mazeplan.core.logs.run_log import STATUSES, read_log
from mazeplan.core.logs.run_log_reader import read_messages
from mazeplan.learning.modelfile import RigModel
from mazeplan.maze.mapfile import load_map
from mazeplan.run.execution import run_job
from mazeplan.run.goals import Goals
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


def test_the_log_holds_each_tree_and_how_its_nodes_ended(tmp_path):
    log = tmp_path / "run.mcap"
    seen = []
    setup = Setup(MAZE, RigModel.nominal(MAZE), watch=lambda tree, context: seen.append(tree))
    goals = Goals(MAZE)
    goals.aim(4)
    run_job(PlanarRig(MAZE), setup, Job(3, 5, 0.3), log=log, goals=goals)
    read = read_log(log)
    assert len(read.trees) == len(seen) == 2  # the goal of the job, and the other one
    for tree, logged in zip(seen, read.trees, strict=True):
        outline = logged.outline
        assert list(outline.paths) == [path for path, _ in tree.snapshot()]
        assert list(outline.kinds) == [type(node).__name__ for node in tree.nodes()]
        assert outline.parents[0] == -1
        asking = {"BallSeen", "FailureIs", "InRing"}
        assert {outline.kinds[i] for i in outline.conditions} == asking & set(outline.kinds)
        assert len(outline.conditions) == sum(kind in asking for kind in outline.kinds) > 2
        for i, parent in enumerate(outline.parents[1:], 1):
            assert outline.paths[i].rsplit("/", 1)[0] == outline.paths[parent] or "/" in outline.names[i]
    assert not read.trees[0].statuses  # never ticked
    statuses = read.trees[1].statuses
    assert {letters[0] for _, letters in statuses} >= {"R", "S"}
    assert all(a != b for (_, a), (_, b) in pairwise(statuses))
    # the leaf that commands in a tick is one that runs then, or has just ended
    kinds, commanded = read.trees[1].outline.kinds, dict(zip(read.ticks["t"], read.ticks["leaf"], strict=True))
    leaves = set(registry_with(()))
    for t, letters in statuses:
        ticked = {kind for kind, letter in zip(kinds, letters, strict=True) if letter in "RSF"}
        assert commanded[t] in ticked or commanded[t] not in leaves


def test_every_result_has_a_letter_of_its_own():
    assert len(set(STATUSES.values())) == len(STATUSES)
    assert all(len(letter) == 1 for letter in STATUSES.values())
    assert np.all([name.isupper() for name in STATUSES])
