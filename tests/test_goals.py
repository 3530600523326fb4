"""What a run is told from outside: other goals, openings closed and opened, stop; seen at the next tick."""

from __future__ import annotations

import math
import threading

import numpy as np
import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st
from planar_rig import PATIENT, PlanarRig, known

from mazeplan.behavior.context import TwoCommandsError
from mazeplan.data.runlog import RunLogWriter, read_log
from mazeplan.data.runlog_reader import read_messages
from mazeplan.errors import LogError, SettingsError
from mazeplan.goals import Goals
from mazeplan.job import Job, Setup
from mazeplan.maze.mapfile import load_map
from mazeplan.navigate import navigate
from mazeplan.replay import replay
from mazeplan.run import run_job

MAZE = load_map("cme")
SETUP = Setup(MAZE, known(MAZE), rig_name="planar", settings=PATIENT)
NAMES = [opening.name for opening in MAZE.openings]
FIRST = tuple(opening.name for opening in MAZE.openings_between(1, 2))


class Script:
    """A mishap of the planar rig: at tick k do what stands under k; further mishaps are called at each tick."""

    def __init__(self, acts, *others):
        self.acts, self.others, self.k = acts, others, -1

    def __call__(self, rig):
        self.k += 1
        for other in self.others:
            other(rig)
        if self.k in self.acts:
            self.acts[self.k]()


def go(acts, *others, goals=None, start=1, goal=5, theta=0.3, limit=20.0, setup=SETUP, log=None, closed=()):
    rig = PlanarRig(setup.maze, mishap=Script(acts, *others))
    result = run_job(rig, setup, Job(start, goal, theta, 0, limit, closed), log=log, goals=goals)
    return result, rig


def said(log):
    return [
        (e["t"], e["kind"], e["detail"]) for e in log.events if e["kind"] in ("goal", "closed", "opened", "stopped")
    ]


def ticks_between(log, first, last):
    t = log.ticks["t"]
    return [str(leaf) for leaf in log.ticks["leaf"][(t >= first - 1e-9) & (t < last - 1e-9)]]


# -- another goal ----------------------------------------------------------------------------------------------------


def test_another_goal_rules_the_command_of_the_same_tick_and_the_plate_is_not_levelled(tmp_path):
    goals = Goals(MAZE)
    acts = {5: lambda: goals.aim("ring2"), 10: lambda: goals.aim(4)}
    result, rig = go(acts, goals=goals, log=tmp_path / "run.mcap")
    log = read_log(tmp_path / "run.mcap")
    assert result.success
    assert rig.ring == 4
    assert [g.ring for g in result.goals] == [5, 2, 4]
    assert [g.t for g in result.goals] == pytest.approx([0.0, 5 / 30, 10 / 30])
    assert [(kind, detail["ring"]) for _, kind, detail in said(log)] == [("goal", 2), ("goal", 4)]
    for t, _, _ in said(log):
        at = log.ticks["t"] == t
        assert at.sum() == 1  # an event has the time of its tick
        assert log.ticks["leaf"][at][0] == "Track"
        routes = [e["t"] for e in log.events if e["kind"] == "route"]
        assert t in routes  # planned by the new tree in that tick
        k = int(np.flatnonzero(at)[0])
        assert math.hypot(*rig.commands[k]) > 0.01
    assert rig.levelled == 2  # at the end of the run, by the run and by its guard
    assert result.to_json()["goals"] == [{"ring": g.ring, "t": g.t} for g in result.goals]


def test_another_goal_on_the_same_way_costs_no_time():
    goals = Goals(MAZE)
    straight, _ = go({}, goal=5)
    turned, _ = go({12: lambda: goals.aim(5)}, goals=goals, goal=3)
    assert turned.success
    assert turned.rings[0].opening == straight.rings[0].opening
    assert abs(turned.time_s - straight.time_s) < 0.1
    assert abs(turned.rings[0].time_s - straight.rings[0].time_s) < 0.1


def test_a_goal_given_while_the_ball_falls_into_a_ring_is_planned_for_from_there(tmp_path):
    """The ball is taken for one in the next ring already; the new tree takes it so, too."""
    go({}, log=tmp_path / "plain.mcap")
    log = read_log(tmp_path / "plain.mcap")
    t = next(e["t"] for e in log.events if e["kind"] == "passed")
    k = int(np.flatnonzero(log.ticks["t"] == t)[0]) + 1
    rings = []
    goals = Goals(MAZE)
    go({k: lambda: goals.aim(4)}, lambda rig: rings.append(rig.ring), goals=goals, log=tmp_path / "run.mcap")
    log = read_log(tmp_path / "run.mcap")
    assert rings[k] == 1  # of the ball itself
    assert log.ticks["ring"][k] == 2
    assert next(e for e in log.events if e["kind"] == "route" and e["t"] == log.ticks["t"][k])["detail"]["openings"][
        0
    ].startswith("2-3")


@pytest.mark.parametrize(
    ("hinder", "leaf"), [("glued", "Dither"), ("hidden", "LevelPlate")], ids=["in a dither", "while the ball is lost"]
)
def test_another_goal_in_the_middle_of_a_recovery(tmp_path, hinder, leaf):
    def until_2_s(rig):
        setattr(rig, hinder, 0.3 < rig.t < 2.0)

    go({}, until_2_s, log=tmp_path / "plain.mcap")
    plain = read_log(tmp_path / "plain.mcap")
    k = int(np.flatnonzero(plain.ticks["leaf"] == leaf)[0]) + 4
    assert plain.ticks["leaf"][k] == leaf  # it would have gone on
    goals = Goals(MAZE)
    result, rig = go({k: lambda: goals.aim(2)}, until_2_s, goals=goals, log=tmp_path / "run.mcap")
    log = read_log(tmp_path / "run.mcap")
    assert result.success
    assert rig.ring == 2
    if leaf == "Dither":
        assert log.ticks["leaf"][k] == "Track"
    else:  # the new tree does not see the ball either, and says so itself
        failures = [e["t"] for e in log.events if e["kind"] == "failure"]
        assert failures == [plain.events[0]["t"]] or failures[-1] == log.ticks["t"][k]
    assert len(result.failures) >= (1 if leaf == "Dither" else 2)  # of the whole run


def test_recoveries_are_counted_anew_for_each_goal():
    """back_off is for the first missed opening on the way to a goal."""
    held = (MAZE.opening("1-2@45").angle, MAZE.ring(1).inner_radius + MAZE.ball.radius - 1e-3)

    def plug(rig):
        r, theta = math.hypot(*rig.z[:2]), math.atan2(rig.z[1], rig.z[0])
        if r < held[1] and abs(theta - held[0]) < 0.2 and r > MAZE.ring(2).outer_radius:
            rig.z[:2] *= held[1] / r
            rig.z[2:4] = 0.0

    goals, acts = Goals(MAZE), {}
    others = [name for name in FIRST if name != "1-2@45"]
    first, _ = go({}, plug, theta=held[0], limit=4.0, closed=others)
    assert [f.recovery for f in first.failures].count("back_off") == 1
    acts[round(30 * first.failures[1].t) + 2] = lambda: goals.aim(4)
    again, _ = go(acts, plug, goals=goals, theta=held[0], limit=4.0, closed=others)
    assert [f.recovery for f in again.failures].count("back_off") == 2


def test_each_goal_has_the_time_limit_of_its_own():
    def glue(rig):
        rig.glued = True

    goals = Goals(MAZE)
    result, rig = go({30: lambda: goals.aim(4), 60: lambda: goals.aim(3)}, glue, goals=goals, limit=1.5)
    assert (result.success, result.reason) == (False, "out_of_time")
    assert rig.t == pytest.approx(2.0 + 1.5, abs=0.04)
    assert "ring 3" in result.failures[-1].detail


def test_a_goal_that_waits_when_the_ball_arrives_is_not_lost():
    plain, rig = go({}, goal=2)
    last = len(rig.commands) - 1
    goals, taken = Goals(MAZE), []

    class AtTheLastMoment(PlanarRig):  # between the tick's look into the mailbox and its end
        def command(self, u_beta, u_gamma):
            super().command(u_beta, u_gamma)
            if len(self.commands) - 1 == last:
                taken.append(goals.aim(3))

    rig = AtTheLastMoment(MAZE)
    result = run_job(rig, SETUP, Job(1, 2, 0.3), goals=goals)
    assert taken == [True]
    assert result.success
    assert rig.ring == 3
    assert result.goals[-1].t == pytest.approx(plain.time_s + 1 / 30)
    assert goals.aim(2) is False  # nobody reads any more


def test_goals_before_the_run_begins_are_read_at_its_first_tick():
    goals = Goals(MAZE)
    assert goals.aim(4)
    assert goals.aim(2, closed=FIRST[:1])
    result, rig = go({}, goals=goals, theta=math.radians(45.0))
    assert result.success
    assert rig.ring == 2
    assert [(g.ring, g.t) for g in result.goals] == [(5, 0.0), (2, 0.0)]
    assert result.rings[0].opening not in FIRST[:1]


def test_the_tree_file_may_be_gone_when_another_goal_comes(tmp_path):
    from mazeplan import resources

    tree = tmp_path / "tree.xml"
    tree.write_text((resources.share("behaviors") / "navigate.xml").read_text())
    goals = Goals(MAZE)
    setup = Setup(MAZE, known(MAZE), str(tree), settings=PATIENT)

    def now():
        tree.unlink()
        goals.aim(2)

    result, _ = go({5: now}, goals=goals, setup=setup)
    assert result.success


# -- openings --------------------------------------------------------------------------------------------------------


def test_openings_stay_closed_for_later_goals_until_they_are_opened():
    goals = Goals(MAZE)
    acts = {
        3: lambda: goals.close("1-2@45"),
        6: lambda: goals.aim(2, closed=[n for n in FIRST if n not in ("1-2@45", "1-2@135")]),
    }
    result, _ = go(acts, goals=goals, theta=math.radians(15.0))
    assert result.success
    assert result.rings[0].opening == "1-2@135"
    acts[9] = lambda: goals.open("1-2@45")
    result, _ = go(acts, goals=goals, theta=math.radians(15.0))
    assert result.success
    assert result.rings[0].opening == "1-2@45"


def test_an_opening_that_the_command_closed_can_be_opened_and_stays_so():
    goals = Goals(MAZE)
    acts = {2: lambda: goals.open("1-2@45"), 4: lambda: goals.aim(2)}
    result, _ = go(acts, goals=goals, theta=math.radians(45.0), closed=FIRST[:1])
    assert FIRST[0] == "1-2@45"
    assert result.rings[0].opening == "1-2@45"


# -- stop ------------------------------------------------------------------------------------------------------------


def test_stop_ends_the_run_level_with_its_reason(tmp_path):
    goals = Goals(MAZE)
    result, rig = go({25: goals.stop, 26: lambda: pytest.fail("a tick after it")}, goals=goals, log=tmp_path / "a.mcap")
    assert (result.success, result.reason) == (False, "stopped")
    assert result.time_s == pytest.approx(25 / 30)
    assert len(rig.commands) == 26
    assert rig.commands[-1] == (0.0, 0.0)  # at once, in the tick in which it is heard
    assert rig.levelled
    log = read_log(tmp_path / "a.mcap")
    assert said(log) == [(log.events[-1]["t"], "stopped", {})]
    assert log.result is not None
    assert log.result["reason"] == "stopped"
    assert not goals.aim(3)


def test_stop_goes_before_another_goal():
    goals = Goals(MAZE)

    def both():
        goals.stop()
        goals.aim(2)

    result, _ = go({10: both}, goals=goals)
    assert result.reason == "stopped"
    assert [g.ring for g in result.goals] == [5]


# -- told again ------------------------------------------------------------------------------------------------------


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
                log._add(topic, 0.0, document)
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


# -- what cannot be meant, and threads -------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda g: g.aim(6), "goal: got 6, expected ring1 to ring5"),
        (lambda g: g.aim("²"), "goal: got '²', expected ring1 to ring5"),
        (lambda g: g.aim(3, closed=["1-2@45", "7-8@1"]), "opening: got '7-8@1', expected one of 1-2@45, "),
        (lambda g: g.aim(3, closed="1-2@45"), "closed: got '1-2@45', expected a list of names"),
        (lambda g: g.close("1-2"), "opening: got '1-2', expected one of "),
        (lambda g: g.open(None), "opening: got None, expected one of "),
    ],
)
def test_wrong_names_are_refused_in_the_call_and_change_nothing(call, message):
    plain, plain_rig = go({})
    goals = Goals(MAZE)

    def wrong():
        with pytest.raises(SettingsError, match=message.replace("(", r"\(")):
            call(goals)

    result, rig = go({10: wrong}, goals=goals)
    assert rig.commands == plain_rig.commands
    assert result.goals == plain.goals


def test_goals_of_another_map_or_another_run_are_refused():
    rig = PlanarRig(MAZE)
    with pytest.raises(SettingsError, match="goals: made for the map lopsided, expected the one of the run, cme"):
        navigate(map=MAZE, rig=rig, goals=Goals("lopsided"))
    assert rig.commands == []
    goals, inner = Goals(), []

    def another():
        with pytest.raises(SettingsError, match="goals: another run reads them"):
            run_job(PlanarRig(MAZE), SETUP, Job(1, 2, 0.3), goals=goals)
        inner.append(True)

    result, _ = go({3: another}, goals=goals)
    assert inner
    assert result.success
    assert go({}, goals=goals)[0].success  # afterwards they may be used again


def test_threads_may_all_talk_at_once(tmp_path):
    """Every message arrives, once; the newest goal is the one that is reached."""
    goals, threads = Goals(MAZE), []
    ready, last = threading.Barrier(5), threading.Event()

    def talk(n):
        ready.wait(10.0)
        for k in range(50):
            assert goals.aim(2 + (n + k) % 3)
            assert goals.close(NAMES[-1 - n])
            assert goals.open(NAMES[-1 - n])

    def start():
        threads.extend(threading.Thread(target=talk, args=(n,), daemon=True) for n in range(4))
        for thread in threads:
            thread.start()
        ready.wait(10.0)

    def join():
        for thread in threads:
            thread.join()
        goals.aim(2)
        last.set()

    result, rig = go({2: start, 20: join}, goals=goals, log=tmp_path / "a.mcap")
    assert last.is_set()
    assert result.success
    assert rig.ring == 2
    events = [kind for _, kind, _ in said(read_log(tmp_path / "a.mcap"))]
    assert (events.count("goal"), events.count("closed"), events.count("opened")) == (201, 200, 200)


def test_a_thread_of_the_user_gives_another_goal_through_the_public_names():
    from mazeplan import Goals

    goals, began = Goals("cme"), threading.Event()

    def person():
        began.wait(10.0)
        goals.aim("ring2")
        goals.aim("ring3")
        seen.set()

    seen = threading.Event()
    thread = threading.Thread(target=person, daemon=True)
    thread.start()

    class Waiting(PlanarRig):
        def observe(self):
            if len(self.commands) == 10:
                began.set()
                assert seen.wait(10.0)
            return super().observe()

    rig = Waiting(MAZE)
    result = navigate("ring1", "ring5", map=MAZE, rig=rig, start_angle_deg=20.0, goals=goals)
    thread.join()
    assert result.success
    assert rig.ring == 3


# -- by chance -------------------------------------------------------------------------------------------------------

ACTS = st.one_of(
    st.tuples(st.just("aim"), st.integers(1, 5), st.lists(st.sampled_from(NAMES), max_size=3)),
    st.tuples(st.just("close"), st.sampled_from(NAMES)),
    st.tuples(st.just("open"), st.sampled_from(NAMES)),
)
MISHAPS = st.tuples(st.sampled_from(["glued", "hidden", "knocked"]), st.integers(0, 120), st.integers(1, 60))


@settings(max_examples=25, deadline=None, derandomize=True, suppress_health_check=[HealthCheck.too_slow])
@given(
    st.lists(st.tuples(st.integers(0, 150), ACTS), max_size=12),
    st.lists(MISHAPS, max_size=3),
    st.none() | st.integers(0, 200),
    st.floats(-3.1, 3.1),
)
@example([(k, ("aim", 1 + k % 5, [])) for k in range(60)], [], None, 0.0)
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
    planned = {e["t"] for e in log.events if e["kind"] in ("route", "failure")}
    newest = {t: detail["ring"] for t, kind, detail in said(log) if kind == "goal"}
    for t, ring in newest.items():
        if t in times:  # else it was stopped in the same tick
            (k,) = np.flatnonzero(times == t)
            assert log.ticks["leaf"][k] or k == len(times) - 1
            assert t in planned or log.ticks["ring"][k] == ring


def test_two_leaves_that_command_in_one_tick_are_found_after_another_goal(tmp_path, monkeypatch):
    """The context of a new goal asserts it as that of the first one did."""
    (tmp_path / "greedy_leaves.py").write_text(
        "from mazeplan import MazeLeaf, Status\n"
        "from mazeplan.records import LEVEL\n\n"
        "class Greedy(MazeLeaf):\n"
        "    def step(self):\n"
        "        if self.context.goal == 2:\n"
        "            self.context.steer(self.name, LEVEL)\n"
        "        return Status.SUCCESS\n"
    )
    from mazeplan import resources

    monkeypatch.syspath_prepend(str(tmp_path))
    text = (resources.share("behaviors") / "navigate.xml").read_text()
    tree = tmp_path / "tree.xml"
    tree.write_text(text.replace("<BallSeen/>", "<BallSeen/><Greedy/>"))
    setup = Setup(MAZE, known(MAZE), str(tree), settings=PATIENT, behavior_modules=("greedy_leaves",))
    goals = Goals(MAZE)
    assert go({}, goals=goals, setup=setup)[0].success
    with pytest.raises(TwoCommandsError, match=r"Track and Greedy both command the rig at t = 0\.333 s"):
        go({10: lambda: goals.aim(2)}, goals=goals, setup=setup)
    assert not goals.aim(3)  # and the mailbox knows that the run is over
