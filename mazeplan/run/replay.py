"""Replays a recorded run without its rig: the observations of the log go through estimator and tree again, and each
tick must make the recorded decision.

The log identifies everything that affects decisions. Its header holds map, settings, goal and seed, and the
names and SHA-256 of tree, modules and packaged model. Any other model is attached. Wall time affects only the
planner's deadlines; a replay ends each search at the recorded iteration (`control.ilqg`). The events of the log
repeat the requests from outside (`goals`).
"""

from __future__ import annotations

import json
import math
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from mazeplan.behavior.trees import read_tree
from mazeplan.control.estimation.sample_check import FAR_M
from mazeplan.control.ilqg import Recorded
from mazeplan.control.policy import load_policy, policy_sha256
from mazeplan.core import resources
from mazeplan.core.errors import LogError, ModelError, SettingsError
from mazeplan.core.events import TimedEvent
from mazeplan.core.file_kinds import format_problem
from mazeplan.core.logs.run_log import RunMessages, encode
from mazeplan.core.logs.run_log_reader import checked_fields, read_attachment, read_messages
from mazeplan.core.maths.fingerprint import fingerprint
from mazeplan.core.progress import Advance, Display, no_advance
from mazeplan.core.records import FailureKind, Observation
from mazeplan.core.user_modules import user_module
from mazeplan.learning.modelfile import ATTACHED, RigModel, unpacked_model
from mazeplan.maze.geometry import Maze
from mazeplan.maze.mapfile import check_text
from mazeplan.physics.registry import own_effects
from mazeplan.run.goals import RecordedRequests
from mazeplan.run.loop import Run
from mazeplan.run.resolve import model_from
from mazeplan.run.settings import settings_from_text
from mazeplan.run.specification import CRASHED, REPLAY_FORMAT, Job, ReplayFacts, Setup, file_sha256, replay_facts

Message = tuple[str, dict[str, Any]]

NEAR = 1e-9  # tolerance, relative and in rad and m: processors round differently; other decisions differ by more
LAST_DIGIT = 1.5e-6  # tolerance for the trajectory of a plan, which the log holds with six digits
CHOSEN = ("status", "leaf", "u_beta", "u_gamma", "opening", "goal_theta", "planned_theta", "ring")  # in a tick
MEASURED = ("ms", "planner_ms", "tick_ms", "log", "rig", "doubts")  # fields of other messages that are no decisions
UNCOMPARED = ("/header", "/tree", "/status", "/openings")  # topics that are not compared: ticks show their effect
BROKEN = (FailureKind.RIG_FAILED, FailureKind.LEAF_FAILED, FailureKind.LOG_FAILED)
UNFINISHED = ("interrupted", CRASHED, *map(str, BROKEN))  # reasons of runs that may have stopped within a tick


@dataclass(frozen=True)
class Difference:
    """The first difference of a replay. t: rig time of the tick, s; tick: its number, from 0; what: kind of message;
    fields: which fields of the message differ; messages: the recorded and the replayed one, None if there was none."""

    t: float
    tick: int
    what: str
    fields: tuple[str, ...]
    messages: tuple[dict[str, Any] | None, dict[str, Any] | None]


@dataclass(frozen=True)
class Replay:
    """Result of a replay. ticks, plans, events: numbers that were compared and are alike; cut_off: plans that a
    deadline ended; reason: of the recorded run; difference: None if alike."""

    ticks: int
    plans: int
    events: int
    cut_off: int
    reason: str
    difference: Difference | None

    @property
    def identical(self) -> bool:
        """Whether all decisions were the same."""
        return self.difference is None


class _OverError(Exception):
    """There are no more observations, or the replay has already decided otherwise."""


def replay(
    log: str | Path, *, model: str | Path | RigModel | None = None, advance: Advance = no_advance
) -> Replay:  # fmt: skip
    """Replay a log of `navigate`. model: of the run, for a log that does not hold it.
    advance: gets the number of the tick and the number of all ticks.

    Raises LogError if the log is cut, damaged, or not of a navigation, or if model, tree or modules have changed since;
    InputError if they cannot be read."""
    path = Path(log)
    header, messages, complete = read_messages(path)
    _check_kind(header, complete, path)
    with checked_fields(path):
        facts = replay_facts(header["replay"])
        script = _Script([m for m in messages if m[0] not in UNCOMPARED], facts.rate_hz, advance)
        setup = _setup_of(header, facts, path, model)
        job = _job_of(header, facts, setup.maze)
        events = (TimedEvent.from_document(document) for topic, document in messages if topic == "/event")
        requests = RecordedRequests(events, setup.maze)
    compared = RunMessages(script.keep)
    run = Run(script, setup, job, compared, Display(), watch=script.watch, requests=requests)
    with suppress(_OverError):
        compared.result(run.drive().json())
    return script.outcome()


def _check_kind(header: dict[str, Any], complete: bool, path: Path) -> None:
    if "excitation" in header:
        raise LogError(
            "got a log of `collect`, expected one of `navigate --log`: here no tree decided alone", file=path
        )
    kept = header.get("replay")
    if not isinstance(kept, dict):
        raise LogError("damaged: expected a mapping", file=path, key="header.replay")
    if problem := format_problem(kept.get("format"), REPLAY_FORMAT, header.get("version")):
        raise LogError(problem, file=path, key="header.replay.format")
    if not complete:
        raise LogError("cut off: the program did not finish it; expected a whole log", file=path)


# -- from the header to the run ------------------------------------------------------------------------------------


def _job_of(header: dict[str, Any], facts: ReplayFacts, maze: Maze) -> Job:
    start, goal, seed = (int(header[name]) for name in ("start_ring", "goal_ring", "seed"))
    if not {start, goal} <= {ring.number for ring in maze.rings} or seed < 0:
        raise ValueError(f"from ring {start} to {goal}, seed {seed}")
    for name in facts.closed:
        maze.opening(name)
    via = tuple(int(ring) for ring in header.get("via_rings", ()))
    return Job(start, goal, facts.start_theta, seed, float(header["time_limit_s"]), facts.closed, via)


def _setup_of(header: dict[str, Any], facts: ReplayFacts, path: Path, model: str | Path | RigModel | None) -> Setup:
    checked = check_text(str(header["map"]), file=f"{path}: header.map")
    if checked.maze is None:
        raise checked.errors[0]
    tree = _tree_of(facts, path, str(header["behavior"]))
    modules = {user_module(name, "--behavior-module").__file__: one.sha256 for name, one in facts.modules.items()}
    if facts.effects is not None:
        own_effects(facts.effects.spec)
        module = user_module(facts.effects.spec.partition(":")[0], "--effects")
        modules[module.__file__] = facts.effects.sha256
    for file, sha256 in modules.items():
        if file_sha256(file or "") != sha256:
            raise _changed("module", str(file), path)
    policy = facts.policy
    if policy is not None and policy_sha256(policy.file) != policy.sha256:
        raise _changed("policy", policy.file, path)
    try:
        settings = settings_from_text(facts.settings)
    except (ValueError, SettingsError) as problem:
        what = f"of another version: {problem}"
        raise LogError(what, file=path, key="header.replay.settings") from None
    return Setup(
        checked.maze,
        _model_of(facts, path, checked.maze, model),
        tree,
        str(header.get("rig", "")),
        settings=settings,
        behavior_modules=tuple(facts.modules),
        latency=facts.latency,
        unseen_s=facts.unseen_s,
        out_s=facts.out_s,
        effects=None if facts.effects is None else facts.effects.spec,
        policy=None if policy is None else load_policy(policy.file),
    )


def _tree_of(facts: ReplayFacts, path: Path, behavior: str) -> str:
    file = Path(facts.behavior_file)
    if not file.is_file():  # a packaged tree may be elsewhere by now
        file = resources.find("behaviors", behavior, ".xml")
    if file_sha256(*read_tree(str(file)).files) != facts.behavior_sha256:
        raise _changed("behaviour tree", str(file), path)
    return str(file)


def _model_of(facts: ReplayFacts, path: Path, maze: Maze, given: str | Path | RigModel | None) -> RigModel:
    if isinstance(given, RigModel):
        found, where = given, "the model given"
    elif given is None and (attached := read_attachment(path, ATTACHED)) is not None:
        try:
            found, where = unpacked_model(attached), "in the log"
        except ModelError as problem:
            raise LogError(f"the model in it {problem}", file=path) from None
    elif (source := given or facts.model) is not None:
        found, where = model_from(source, maze), str(source)
    else:
        found, where = RigModel.nominal(maze), "nominal physics (the run had one that no file holds)"
    if fingerprint(found) != facts.model_sha256:
        raise _changed("model", where, path, "; --model PATH: where it is now")
    return found


def _changed(what: str, name: str, path: Path, advice: str = "") -> LogError:
    return LogError(f"the {what} {name} is not that of the run, by its SHA-256{advice}", file=path)


# -- the run -------------------------------------------------------------------------------------------------------


@dataclass
class _Script:
    """A rig that repeats the recorded observations and compares the new decisions with the recorded ones."""

    recorded: list[Message]
    rate_hz: float
    advance: Advance = no_advance
    replayed: list[Message] = field(default_factory=list)
    watch: Recorded = field(default_factory=Recorded)
    _given: int = 0
    _same: int = 0  # messages that were compared and are alike

    def __post_init__(self) -> None:
        if not (math.isfinite(self.rate_hz) and self.rate_hz > 0.0):
            raise ValueError(f"rate_hz {self.rate_hz}")
        self._ticks = [document for topic, document in self.recorded if topic == "/tick"]
        self._observed = [_observation(document) for document in self._ticks]
        self._result = next((document for topic, document in self.recorded if topic == "/result"), None)
        self._reason = str((self._result or {}).get("reason", ""))
        for document in self._ticks:
            self.watch.load(document.get("cut_off"))  # raises ValueError for what cannot be read

    # a rig

    def reset(self, *, ring: int, theta: float, rng: np.random.Generator) -> None:
        pass  # the ball was placed in the recorded run

    def observe(self) -> Observation:
        """The next recorded observation. Raises _OverError if there is none, or the last tick decided otherwise."""
        if self._given == len(self._ticks) or not self._alike():
            raise _OverError
        self.watch.load(self._ticks[self._given].get("cut_off"))
        self._given += 1
        self.advance(self._given, len(self._ticks))
        return self._observed[self._given - 1]

    def command(self, u_beta: float, u_gamma: float) -> None:
        pass  # the log has the command

    def level(self) -> None:
        pass

    def close(self) -> None:
        pass

    # the comparison

    def keep(self, topic: str, t: float, document: dict[str, Any]) -> None:
        """Keep a message of the replay in the form in which a reader of a log would get it."""
        if topic not in UNCOMPARED:
            self.replayed.append((topic, json.loads(encode(document))))

    def _alike(self) -> bool:
        while self._same < min(len(self.replayed), len(self.recorded)):
            if _differing(self.recorded[self._same], self.replayed[self._same]):
                return False
            self._same += 1
        return self._same == len(self.replayed)

    def outcome(self) -> Replay:
        difference = self._difference()
        topics = [topic for topic, _ in self.replayed[: self._same]]
        cuts = [str(tick.get("cut_off", "")).split() for tick in self._ticks[: topics.count("/tick")]]
        cut_off = sum(cut.isdigit() for of_tick in cuts for cut in of_tick)
        ticks, plans, events = (topics.count(topic) for topic in ("/tick", "/plan", "/event"))
        return Replay(ticks, plans, events, cut_off, self._reason, difference)

    def _difference(self) -> Difference | None:
        alike, then = self._alike(), self.recorded
        if self._reason in UNFINISHED or self._result is None:  # messages after its last tick belong to no tick
            last = max((i for i, (topic, _) in enumerate(then) if topic == "/tick"), default=-1)
            if self._same > last:
                return None
        elif alike and self._same == len(then):
            return None
        index = self._same
        a = then[index] if index < len(then) else None
        b = self.replayed[index] if index < len(self.replayed) else None
        kind = (a or b or ("", {}))[0].removeprefix("/")
        number = min(sum(topic == "/tick" for topic, _ in then[:index]), max(len(self._ticks) - 1, 0))
        t = self._ticks[number]["t"] if self._ticks else 0.0
        return Difference(t, number, kind, _differing(a, b), (a and a[1], b and b[1]))


def _observation(document: dict[str, Any]) -> Observation:
    doubts = str(document.get("doubts", "")).split()  # a log holds only finite numbers
    untold = {"beta": math.nan, "gamma": math.nan} if {"tilt", "no_tilt"} & set(doubts) else {}
    t, beta, gamma = (float({**untold, **document}[name]) for name in ("t", "beta", "gamma"))
    unseen = math.nan if "position" in doubts else 2.0 * FAR_M if "far" in doubts else None  # raises the doubt again
    x, y = (unseen if document.get(name) is None else float(document[name]) for name in ("x", "y"))
    if not math.isfinite(t) or not (untold or (math.isfinite(beta) and math.isfinite(gamma))):
        raise ValueError("a tick without t, beta or gamma")
    x2, y2 = (None if document.get(name) is None else float(document[name]) for name in ("x2", "y2"))
    return Observation(t, x, y, beta, gamma, (Observation(t, x2, y2, beta, gamma),) if "ball" in document else ())


def _differing(a: Message | None, b: Message | None) -> tuple[str, ...]:
    if a is None or b is None or a[0] != b[0]:
        return ("message",)
    (topic, then), (_, now) = a, b
    names = CHOSEN if topic == "/tick" else [name for name in {**then, **now} if name not in MEASURED]
    near = LAST_DIGIT if topic == "/plan" else NEAR
    return tuple(name for name in names if not _near(then.get(name), now.get(name), near))


def _near(a: Any, b: Any, near: float) -> bool:
    if isinstance(a, dict) and isinstance(b, dict):
        return a.keys() == b.keys() and all(_near(a[key], b[key], near) for key in a)
    if isinstance(a, list) and isinstance(b, list):
        return len(a) == len(b) and all(_near(x, y, near) for x, y in zip(a, b, strict=True))
    if isinstance(a, float) and isinstance(b, float):  # JSON keeps floats and integers apart
        return math.isclose(a, b, rel_tol=NEAR, abs_tol=near)
    return type(a) is type(b) and a == b
