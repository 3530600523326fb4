"""What was said from outside is said again by a replay, and whatever is said whenever does no harm."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st
from planar_rig import PATIENT, PlanarRig, known
from talking import MAZE, NAMES, SETUP, go, said

from mazeplan.core.errors import LogError, TreeError
from mazeplan.core.logs.run_log import RunLogWriter, read_log
from mazeplan.core.logs.run_log_reader import read_messages
from mazeplan.run.execution import run_job
from mazeplan.run.goals import Goals
from mazeplan.run.navigate import navigate
from mazeplan.run.replay import replay
from mazeplan.run.specification import Job, Setup

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


def test_a_run_that_was_stopped_or_went_on_after_it_had_arrived_decides_again(tmp_path):
    path = tmp_path / "stopped.mcap"
    assert talked_to(path, {20: lambda goals: goals.stop()}).reason == "stopped"
    outcome = replay(path, model=known(MAZE))
    assert outcome.identical, outcome.difference
    assert (outcome.ticks, outcome.reason) == (21, "stopped")
    _, rig = go({}, goal=2)
    goals, last = Goals(MAZE), len(rig.commands)

    class AtTheLastMoment(PlanarRig):
        def command(self, u_beta, u_gamma):
            super().command(u_beta, u_gamma)
            if len(self.commands) == last:
                goals.aim(3)

    path = tmp_path / "on.mcap"
    result = run_job(AtTheLastMoment(MAZE), SETUP, Job(1, 2, 0.3), goals=goals, log=path)
    assert [g.ring for g in result.goals] == [2, 3]
    outcome = replay(path, model=known(MAZE))
    assert outcome.identical, outcome.difference


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

ACTS = st.one_of(
    st.tuples(st.just("aim"), st.integers(1, 5), st.lists(st.sampled_from(NAMES), max_size=3)),
    st.tuples(st.just("close"), st.sampled_from(NAMES)),
    st.tuples(st.just("open"), st.sampled_from(NAMES)),
)
MISHAPS = st.tuples(st.sampled_from(["glued", "hidden", "knocked"]), st.integers(0, 120), st.integers(1, 60))


@pytest.mark.slow
@settings(max_examples=12, deadline=None, derandomize=True, suppress_health_check=[HealthCheck.too_slow])
@given(
    st.lists(st.tuples(st.integers(0, 150), ACTS), max_size=12),
    st.lists(MISHAPS, max_size=3),
    st.none() | st.integers(0, 200),
    st.floats(-3.1, 3.1),
)
@example([(k, ("aim", 1 + k % 5, [])) for k in range(60)], [], None, 0.0)
@example([(22, ("aim", 1, []))], [], 22, 0.0)
def test_whatever_is_said_whenever(tmp_path_factory, talk, mishaps, stop, theta):
    """No exception, no command outside the limits (the rig asserts it), level at the end, and the tree of a new goal
    plans and commands in the tick in which it was heard."""
    goals, acts = Goals(MAZE), {}
    for k, act in talk:
        acts.setdefault(k, []).append(act)

    def act_at(k):
        for name, *arguments in acts.get(k, []):
            getattr(goals, name)(*arguments)
        if k == stop:
            goals.stop()

    def happen(rig):
        k = len(rig.commands)
        for kind, at, length in mishaps:
            if kind == "knocked" and k == at:
                rig.place(1 + length % 4, 0.1 * length)
            elif kind != "knocked":
                setattr(rig, kind, at <= k < at + length)

    heard = range(400)
    path = tmp_path_factory.mktemp("talk") / "run.mcap"
    result, rig = go({k: lambda k=k: act_at(k) for k in heard}, happen, goals=goals, theta=theta, limit=5.0, log=path)
    assert np.all(rig.u == 0.0)
    assert rig.levelled
    log = read_log(path)
    assert log.complete
    outcome = replay(path, model=known(MAZE))
    assert outcome.identical, outcome.difference
    assert result.success == (result.reason == "arrived")
    if result.success:
        assert rig.ring == result.goals[-1].ring
    assert result.time_s <= result.goals[-1].t + 5.0 + 1 / 30
    times = log.ticks["t"]
    planned = {e.t for e in log.events if e.kind in ("route", "failure")}
    newest = {t: detail["ring"] for t, kind, detail in said(log) if kind == "goal"}
    for t, ring in newest.items():
        if t in times:  # else it was stopped in the same tick
            (k,) = np.flatnonzero(times == t)
            stopped = k == len(times) - 1 and result.reason == "stopped"  # by what was said in the same tick
            assert log.ticks["leaf"][k] or k == len(times) - 1
            assert t in planned or log.ticks["ring"][k] == ring or stopped


def test_two_leaves_that_command_in_one_tick_are_found_after_another_goal(tmp_path, monkeypatch):
    """The context of a new goal asserts it as that of the first one did."""
    (tmp_path / "greedy_leaves.py").write_text(
        "from mazeplan import MazeLeaf, Status\n"
        "from mazeplan.core.records import LEVEL\n\n"
        "class Greedy(MazeLeaf):\n"
        "    def step(self):\n"
        "        if self.context.goal == 2:\n"
        "            self.context.steer(self.name, LEVEL)\n"
        "        return Status.SUCCESS\n"
    )
    from mazeplan.core import resources

    monkeypatch.syspath_prepend(str(tmp_path))
    text = (resources.share("behaviors") / "navigate.xml").read_text()
    tree = tmp_path / "tree.xml"
    tree.write_text(text.replace("<BallSeen/>", "<BallSeen/><Greedy/>"))
    setup = Setup(MAZE, known(MAZE), str(tree), settings=PATIENT, behavior_modules=("greedy_leaves",))
    goals = Goals(MAZE)
    assert go({}, goals=goals, setup=setup)[0].success
    with pytest.raises(TreeError, match=r"Track and Greedy both command the rig at t = 0\.333 s"):
        go({10: lambda: goals.aim(2)}, goals=goals, setup=setup)
    assert not goals.aim(3)  # and the mailbox knows that the run is over
