"""What was said from outside is said again by a replay, and whatever is said whenever does no harm."""

from __future__ import annotations

import pytest
from planar_rig import known
from talking import MAZE, NAMES, go

from mazeplan.core.errors import LogError
from mazeplan.core.logs.run_log import RunLogWriter
from mazeplan.core.logs.run_log_reader import read_messages
from mazeplan.run.execution import navigate
from mazeplan.run.goals import Goals
from mazeplan.run.replay import replay

# -- told again --------------------------------------------------------------------------------------------------------


def talked_to(path, acts, **more):
    goals = Goals(MAZE)
    result, _ = go({k: lambda deed=deed: deed(goals) for k, deed in acts.items()}, goals=goals, log=path, **more)
    return result


def changed(path, kind, **detail):
    """The log with the first event of a kind telling something else."""
    header, messages, _ = read_messages(path)
    event = next(document for topic, document in messages if topic == "/event" and document["kind"] == kind)
    event["detail"] |= detail
    with RunLogWriter(path.with_name("changed.mcap"), header) as log:
        for topic, document in messages:
            if topic != "/header":
                log.write(topic, 0.0, document)
    return path.with_name("changed.mcap")


def test_a_run_with_two_other_goals_and_edited_openings_decides_again(tmp_path):
    path = tmp_path / "run.mcap"
    acts = {
        4: lambda goals: goals.aim(3),
        9: lambda goals: goals.close("1-2@45"),
        14: lambda goals: goals.open("1-2@45"),
        25: lambda goals: goals.aim(4, closed=["3-4@0"] if "3-4@0" in NAMES else []),
    }
    result = talked_to(path, acts)
    assert [g.ring for g in result.goals] == [5, 3, 4]
    outcome = replay(path, model=known(MAZE))
    assert outcome.identical, outcome.difference
    assert outcome.reason == "arrived"
    other = replay(changed(path, "goal", ring=2), model=known(MAZE))
    assert not other.identical
    with pytest.raises(LogError, match="goal: got 7, expected ring1 to ring5"):
        replay(changed(path, "goal", ring=7), model=known(MAZE))
    with pytest.raises(LogError, match="opening: got '1-2', expected one of"):
        replay(changed(path, "closed", opening="1-2"), model=known(MAZE))
    with pytest.raises(LogError, match="opening: got '1-2', expected one of"):
        replay(changed(path, "opened", opening="1-2"), model=known(MAZE))


@pytest.mark.slow
def test_a_run_on_the_toy_with_two_other_goals_decides_again(tmp_path):
    """With the packaged deadline of the planner, and noise, and a camera that is late."""
    from mazeplan.rigs.registry import make_rig

    goals, path = Goals(MAZE), tmp_path / "run.mcap"
    toy = make_rig("toy", MAZE)
    observe, count = toy.observe, iter(range(10_000))

    def observed():
        k = next(count)
        if k in (15, 45):
            goals.aim(3 if k == 15 else 2)
        return observe()

    toy.observe = observed  # type: ignore[method-assign]
    result = navigate(1, 5, map=MAZE, rig=toy, model="toy", seed=5, goals=goals, log=path)
    assert result.success
    assert [g.ring for g in result.goals] == [5, 3, 2]
    outcome = replay(path)
    assert outcome.identical, outcome.difference


# -- by chance ---------------------------------------------------------------------------------------------------------
