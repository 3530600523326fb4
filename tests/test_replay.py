"""Recorded runs that decide again: alike, or at the first place where something was changed, or not at all."""

from __future__ import annotations

import json
import textwrap
from copy import deepcopy

import pytest
from commands import call
from planar_rig import PATIENT, PlanarRig, known

from mazeplan.choices import resolve_model
from mazeplan.data.runlog import RunLogWriter
from mazeplan.data.runlog_reader import read_messages
from mazeplan.errors import InputError, LogError, RigError, SettingsError
from mazeplan.job import Job, Setup
from mazeplan.maze.mapfile import load_map
from mazeplan.maze.memory import OpeningMemory
from mazeplan.models.modelfile import RigModel, save_model
from mazeplan.navigate import navigate
from mazeplan.replay import replay
from mazeplan.run import run_job
from mazeplan.settings import Settings, load_settings, settings_from_text

MAZE = load_map("cme")
HURRIED = load_settings().with_values({"travel": {"deadline_ms": 0.5}})  # searches end early, by the clock on the wall


def planar(path, start=3, goal=5, theta=0.3, mishap=None, limit=20.0, settings=PATIENT, **more):
    """A run on the planar rig; its model is known to nobody but the test."""
    setup = Setup(MAZE, known(MAZE), rig_name="planar", settings=settings, **more)
    return run_job(PlanarRig(MAZE, mishap=mishap), setup, Job(start, goal, theta, 0, limit), log=path)


def again(path):
    return replay(path, model=known(MAZE))


def rewritten(path, change, name="other.mcap"):
    """A log with its header and messages changed by `change(header, messages)`."""
    header, messages, _ = read_messages(path)
    header, messages = deepcopy(header), deepcopy([m for m in messages if m[0] != "/header"])
    change(header, messages)
    other = path.with_name(name)
    with RunLogWriter(other, header) as log:
        for topic, document in messages:
            log._add(topic, 0.0, document)
    return other


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    """One run on the toy in which the deadline ended searches."""
    path = tmp_path_factory.mktemp("replay") / "run.mcap"
    result = navigate(3, 5, rig="toy", settings=HURRIED, log=path, seed=4)
    return path, result


def test_a_run_on_the_toy_decides_again(recorded):
    path, result = recorded
    outcome = replay(path)
    assert outcome.identical
    _, messages, _ = read_messages(path)
    topics = [topic for topic, _ in messages]
    counts = outcome.ticks, outcome.plans, outcome.events
    assert counts == tuple(topics.count(topic) for topic in ("/tick", "/plan", "/event"))
    assert outcome.ticks > 30
    assert outcome.cut_off > 3
    assert outcome.reason == result.reason


def test_where_the_deadline_ended_a_search_decides(recorded):
    """Without it, or with another place, the plans become others."""
    path, _ = recorded

    def forget(header, messages):
        for _, document in messages:
            document.pop("cut_off", None)

    outcome = replay(rewritten(path, forget))
    assert not outcome.identical
    assert outcome.difference.what == "plan"
    assert {"reason", "iterations"} <= set(outcome.difference.fields)

    def garble(header, messages):
        next(d for t, d in messages if t == "/tick")["cut_off"] = "soon"

    with pytest.raises(LogError, match="damaged"):
        replay(rewritten(path, garble))


def hide(rig):
    rig.hidden = 0.3 < rig.t < 1.1


def fall(rig):
    if rig.ring == 4 and not getattr(rig, "fell", False):
        rig.fell = True
        rig.place(2, 2.0)


@pytest.mark.parametrize(
    ("mishap", "limit", "reason", "kind"),
    [
        (hide, 20.0, "arrived", "ball_lost"),
        (fall, 20.0, "arrived", None),
        (None, 0.7, "out_of_time", "out_of_time"),
    ],
)
def test_runs_that_went_wrong_on_the_way_decide_again(tmp_path, mishap, limit, reason, kind):
    result = planar(tmp_path / "run.mcap", mishap=mishap, limit=limit)
    assert result.reason == reason
    assert result.failures
    assert kind in (None, *(str(f.kind) for f in result.failures))
    outcome = again(tmp_path / "run.mcap")
    assert outcome.identical, outcome.difference
    assert outcome.reason == reason


@pytest.mark.parametrize(("error", "reason"), [(KeyboardInterrupt, "interrupted"), (RigError, "rig_failed")])
def test_runs_that_were_ended_decide_again_up_to_there(tmp_path, error, reason):
    def end(rig):
        if rig.t > 0.8:
            raise error("enough")

    path = tmp_path / "run.mcap"
    with pytest.raises(error):
        planar(path, mishap=end)
    outcome = again(path)
    assert outcome.identical
    assert outcome.ticks == 25
    assert outcome.reason == reason

    def other(header, messages):
        [d for t, d in messages if t == "/tick"][-1]["u_beta"] += 0.001

    assert not again(rewritten(path, other)).identical


def test_what_is_remembered_of_openings_decides(tmp_path):
    memory = OpeningMemory()
    for _ in range(6):
        memory.record("1-2@45", success=False, now=0.0)
    path = tmp_path / "run.mcap"
    planar(path, start=1, goal=2, theta=0.785, memory=memory)
    assert again(path).identical
    assert again(path).identical  # a replay leaves nothing behind

    def forget(header, messages):
        del header["replay"]["memory"]

    outcome = again(rewritten(path, forget))
    assert outcome.difference.what == "event"
    assert outcome.difference.tick == 0


def test_settings_decide_again(tmp_path):
    path = tmp_path / "run.mcap"
    planar(path, settings=PATIENT.with_values({"travel": {"lean_deg": 2.0}, "estimator": {"lost_after": 0.3}}))
    assert again(path).identical
    for values in ({"travel": {"lean_deg": 4.0}}, {"cost": {"theta": 2.0}}):

        def change(header, messages, values=values):
            kept = header["replay"]
            kept["settings"] = settings_from_text(kept["settings"]).with_values(values).text()

        assert not again(rewritten(path, change)).identical


def test_closed_openings_seed_and_start_decide_again(tmp_path):
    path = tmp_path / "run.mcap"
    closed = [opening.name for opening in MAZE.openings_between(3, 4)][:1]
    navigate(3, 4, rig="ideal", closed=closed, seed=7, log=path)
    assert replay(path).identical

    def change(header, messages):
        header["seed"] = 8

    outcome = replay(rewritten(path, change))
    assert outcome.difference.what == "event"
    assert outcome.difference.fields == ("detail",)
    navigate(4, 5, rig="ideal", start_angle_deg=-100.0, seed=7, log=path)
    assert replay(path).identical


def tick(messages, number):
    return [document for topic, document in messages if topic == "/tick"][number]


@pytest.mark.parametrize(
    ("field", "value"),
    [("status", "FAILURE"), ("leaf", "Nobody"), ("u_beta", 0.01), ("u_gamma", -0.01), ("opening", "4-5@1"), ("ring", 1),
     ("goal_theta", 0.1), ("planned_theta", 0.1)],
)  # fmt: skip
def test_every_decision_of_a_tick_is_compared(tmp_path, recorded, field, value):
    path, _ = recorded

    def change(header, messages):
        tick(messages, 20)[field] = value

    outcome = replay(rewritten(path, change))
    difference = outcome.difference
    assert (difference.tick, difference.what, difference.fields) == (20, "tick", (field,))
    assert difference.t == pytest.approx(20 / 30.0, abs=1e-6)
    assert outcome.ticks == 20
    for side in (difference.recorded, difference.replayed):
        assert set(side) == {"status", "leaf", "u_beta", "u_gamma", "opening"}
    if field in difference.recorded:
        assert difference.recorded[field] == value
        assert difference.replayed[field] != value


def of(messages, topic, number=0):
    return [i for i, (t, _) in enumerate(messages) if t == topic][number]


def drop_event(header, messages):
    del messages[of(messages, "/event", 2)]


def other_event(header, messages):
    messages[of(messages, "/event", 2)][1]["kind"] = "surprise"


def other_plan(header, messages):
    messages[of(messages, "/plan", 2)][1]["iterations"] += 1


def bent_plan(header, messages):
    messages[of(messages, "/plan", 2)][1]["theta"][7] += 1e-4


def other_end(header, messages):
    messages[of(messages, "/result")][1]["reason"] = "stuck"


def other_sight(header, messages):
    tick(messages, 15)["x"] += 2e-3


def other_goal(header, messages):
    header["goal_ring"] = 4


def one_tick_less(header, messages):
    del messages[of(messages, "/tick", -1)]


@pytest.mark.parametrize(
    ("change", "what", "fields"),
    [
        (drop_event, None, None),
        (other_event, "event", ("kind",)),
        (other_plan, "plan", ("iterations",)),
        (bent_plan, "plan", ("theta",)),
        (other_end, "result", ("reason",)),
        (other_sight, None, None),
        (other_goal, None, None),
        (one_tick_less, None, None),
    ],
)
def test_everything_else_that_is_decided_is_compared(recorded, change, what, fields):
    difference = replay(rewritten(recorded[0], change)).difference
    assert difference is not None
    if what is not None:
        assert (difference.what, difference.fields) == (what, fields)
    if change is other_sight:
        assert difference.tick == 15


def test_rounding_is_no_difference(recorded):
    def change(header, messages):
        for topic, document in messages:
            if topic == "/tick":
                document["u_beta"] += 1e-12

    assert replay(rewritten(recorded[0], change)).identical


# -- what cannot be replayed ---------------------------------------------------------------------------------------


def test_leaves_of_ones_own_and_trees_are_told_by_their_content(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)
    (tmp_path / "push_leaf.py").write_text(
        textwrap.dedent("""
        from mazeplan import MazeLeaf, Status
        from mazeplan.records import Command

        class Push(MazeLeaf):
            def step(self):
                if self.context.now > 0.4:
                    return Status.SUCCESS
                self.context.steer(self.name, Command(0.01, 0.0))
                return Status.RUNNING
        """)
    )
    tree = tmp_path / "tree.xml"
    tree.write_text(
        '<root BTCPP_format="4" main_tree_to_execute="M"><BehaviorTree ID="M"><Push/></BehaviorTree></root>'
    )
    options = {"behavior": "tree.xml", "behavior_modules": ["push_leaf"], "log": "run.mcap"}
    assert navigate(3, 3, rig="ideal", **options).success
    assert replay("run.mcap").identical
    (tmp_path / "elsewhere").mkdir()
    monkeypatch.chdir(tmp_path / "elsewhere")
    assert replay("../run.mcap").identical  # from anywhere
    moved = tree.rename(tmp_path / "moved.xml")
    with pytest.raises(InputError, match=r"tree\.xml"):
        replay("../run.mcap")
    assert replay("../run.mcap", behavior=str(moved)).identical
    moved.write_text(moved.read_text().replace("<Push/>", "<Push />"))
    with pytest.raises(LogError, match=r"the behaviour tree .*moved\.xml is not that of the run"):
        replay("../run.mcap", behavior=str(moved))
    moved.write_text(moved.read_text().replace("<Push />", "<Push/>"))
    with (tmp_path / "push_leaf.py").open("a") as file:
        file.write("# changed\n")
    with pytest.raises(LogError, match=r"the module push_leaf \(.*push_leaf\.py\) is not that of the run"):
        replay("../run.mcap", behavior=str(moved))


def test_a_model_is_told_by_its_content(tmp_path):
    folder, path = tmp_path / "model", tmp_path / "run.mcap"
    save_model(resolve_model("ideal", None, MAZE), folder)
    navigate(4, 5, rig="ideal", model=folder, log=path)
    assert replay(path).identical
    folder.rename(tmp_path / "moved")
    with pytest.raises(InputError, match="no such model"):
        replay(path)
    assert replay(path, model=tmp_path / "moved").identical
    text = (tmp_path / "moved" / "model.yaml").read_text()
    (tmp_path / "moved" / "model.yaml").write_text(text.replace("rate_hz: 30", "rate_hz: 31"))
    with pytest.raises(LogError, match=r"the model .*moved is not that of the run, by its SHA-256; --model PATH"):
        replay(path, model=tmp_path / "moved")
    planar(path)  # a model that no file holds
    with pytest.raises(LogError, match="the model nominal physics is not that of the run"):
        replay(path)
    own = tmp_path / "own.yaml"
    own.write_text("camera_noise_mm: 0.1\n")
    navigate(4, 5, rig=str(own), log=path)
    assert replay(path).identical  # nominal physics


def old(header, messages):
    del header["replay"]


def newer(header, messages):
    header["replay"]["format"] = 2


def settings_of_others(header, messages):
    text = json.loads(header["replay"]["settings"])
    del text["leaves"]["cost"]["speed"]
    header["replay"]["settings"] = json.dumps(text)


def settings_out_of_range(header, messages):
    header["replay"]["settings"] = header["replay"]["settings"].replace('"deadline_ms": 0.5', '"deadline_ms": -1.0')


def no_rate(header, messages):
    del header["replay"]["rate_hz"]


def bad_map(header, messages):
    header["map"] = header["map"].replace("rings:", "rungs:")


def bad_memory(header, messages):
    header["replay"]["memory"] = {"fading_s": 1.0, "openings": [1]}


def no_time(header, messages):
    del tick(messages, 3)["beta"]


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (old, "was written before runs could be replayed"),
        (newer, "header.replay: what it holds for a replay is of another version"),
        (settings_of_others, "header.replay.settings: of another version: expected"),
        (settings_out_of_range, "header.replay.settings: of another version: deadline_ms: got -1, expected"),
        (no_rate, "damaged: a field is missing or of the wrong kind ('rate_hz')"),
        (bad_map, "header.map"),
        (bad_memory, "damaged"),
        (no_time, "damaged: a field is missing or of the wrong kind ('beta')"),
    ],
)
def test_logs_that_cannot_be_replayed_say_so_in_one_line(recorded, monkeypatch, capsys, change, said):
    code, out, err = call(monkeypatch, capsys, "log", "replay", rewritten(recorded[0], change))
    assert code == 2
    assert out == ""
    assert len(err.splitlines()) == 1
    assert said in err
    assert "other.mcap" in err


def test_files_that_are_no_whole_log_of_a_navigation(recorded, monkeypatch, capsys, tmp_path):
    whole = recorded[0].read_bytes()
    collected = tmp_path / "collected.mcap"
    assert call(monkeypatch, capsys, "collect", "--rig", "ideal", "--seconds", "1", "-o", collected)[0] == 0
    half = tmp_path / "half.mcap"
    half.write_bytes(whole[: len(whole) // 2])
    damaged = tmp_path / "damaged.mcap"
    damaged.write_bytes(whole[:5000] + b"\0" * 50 + whole[5050:])
    (tmp_path / "text.mcap").write_text("hello")
    for path, said in (
        (collected, "got a log of `collect`, expected one of `navigate --log`"),
        (half, "cut off"),
        (damaged, "damaged"),
        (tmp_path / "text.mcap", "another kind of file"),
        (tmp_path / "none.mcap", "cannot be read"),
    ):
        code, out, err = call(monkeypatch, capsys, "log", "replay", path)
        assert (code, out, len(err.splitlines())) == (2, "", 1)
        assert said in err
        assert path.name in err


# -- the command ---------------------------------------------------------------------------------------------------


def test_the_command_tells_the_first_difference_with_both_sides(recorded, monkeypatch, capsys):
    def change(header, messages):
        tick(messages, 20).update(status="SUCCESS", leaf="Nobody", u_beta=0.1)
        tick(messages, 25)["leaf"] = "Later"

    other = rewritten(recorded[0], change)
    code, out, err = call(monkeypatch, capsys, "log", "replay", other)
    lines = out.splitlines()
    assert code == 1
    assert err == ""
    assert lines[0].endswith("different at t = 0.667 s, tick 20, tick: status, leaf, u_beta")
    assert "recorded  SUCCESS Nobody (+5.730," in lines[1]
    assert "replayed  RUNNING " in lines[2]
    assert "Later" not in out
    code, out, _ = call(monkeypatch, capsys, "log", "replay", other, "--json")
    document = json.loads(out)
    assert code == 1
    assert not document["identical"]
    assert document["difference"]["tick"] == 20
    assert document["difference"]["recorded"]["leaf"] == "Nobody"
    assert document["difference"]["replayed"]["status"] == "RUNNING"
    code, out, _ = call(monkeypatch, capsys, "log", "replay", rewritten(recorded[0], other_end))
    assert code == 1
    assert '"reason": "stuck"' in out
    assert '"reason": "arrived"' in out


def test_the_command_says_identical(recorded, monkeypatch, capsys):
    code, out, _ = call(monkeypatch, capsys, "log", "replay", recorded[0])
    assert code == 0
    assert out.splitlines()[0].startswith(f"{recorded[0]}: identical: ")
    assert "searches ended by the deadline" in out
    code, out, _ = call(monkeypatch, capsys, "log", "replay", recorded[0], "--json")
    document = json.loads(out)
    assert code == 0
    assert document["identical"]
    assert document["difference"] is None
    code, out, _ = call(monkeypatch, capsys, "log", "info", recorded[0], "--json")
    assert "replay" not in json.loads(out)["header"]  # long, and for the program only


def test_another_version_is_named_beside_a_difference(recorded, monkeypatch, capsys):
    def change(header, messages):
        header["version"] = "0.0.1"
        other_end(header, messages)

    code, out, _ = call(monkeypatch, capsys, "log", "replay", rewritten(recorded[0], change))
    assert code == 1
    assert "recorded by version 0.0.1" in out


def test_settings_are_told_to_the_last_bit():
    settings = load_settings().with_values({"travel": {"lean_deg": 0.1 + 0.2, "deadline_ms": 1e6}})
    assert settings_from_text(settings.text()) == settings
    assert settings_from_text(settings.text()) != load_settings()
    broken = settings.text().replace('"deadline_ms": 1000000.0', '"deadline_ms": -1.0')
    with pytest.raises(SettingsError, match="deadline_ms"):
        settings_from_text(broken)
    for text in ("[]", "{}", '{"leaves": 1, "estimator": 2}', "x"):
        with pytest.raises(ValueError):
            settings_from_text(text)
    assert isinstance(settings_from_text(Settings().text()), Settings)


def test_nominal_physics_are_those_of_the_map(tmp_path):
    lopsided = load_map("lopsided")
    path = tmp_path / "run.mcap"
    navigate(2, 3, map=lopsided, rig="ideal", model=RigModel.nominal(lopsided), log=path)
    assert replay(path).identical
