"""Job and setup of a run, and the header of its log."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cache
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import TypeAdapter, ValidationError

from mazeplan.behavior.context import RunContext
from mazeplan.behavior.trees import read_tree
from mazeplan.btree.tree import BehaviorTree
from mazeplan.control.policy import Policy, policy_sha256
from mazeplan.core import resources
from mazeplan.core.constants import TIME_LIMIT
from mazeplan.core.errors import ModelError
from mazeplan.core.maths.fingerprint import fingerprint
from mazeplan.core.records import Latency
from mazeplan.core.user_modules import user_module
from mazeplan.learning.modelfile import RigModel, is_packaged_model, packed_model, unpacked_model
from mazeplan.maze.geometry import Maze
from mazeplan.maze.mapfile import dump_map
from mazeplan.rigs.interface import traits
from mazeplan.run.settings import Settings, load_settings

PUT_BACK_S = 10.0  # s that a run on a real rig waits for a ball that left the maze
REPLAY_FORMAT = 1  # format number of the header's part `replay`
CRASHED = "crashed"  # the reason of a run that an unexpected exception of the program itself ended


@dataclass(frozen=True)
class Job:
    """One navigation to do.

    start, goal: numbers of the rings"""

    start: int
    goal: int
    theta: float | None = None  # start angle, rad; None: drawn by the seed
    seed: int = 0
    time_limit: float = TIME_LIMIT  # rig time for each goal, s
    closed: tuple[str, ...] = ()  # names of openings that the run does not use
    via: tuple[int, ...] = ()  # rings to visit before the goal

    def start_angle(self, maze: Maze, rng: np.random.Generator) -> float:
        """The angle at which the ball is placed, rad, clear of radial walls. rng: seeded with the seed of the job."""
        return maze.clear_angle(self.start, float(rng.uniform(-math.pi, math.pi)) if self.theta is None else self.theta)


@dataclass(frozen=True)
class Setup:
    """Everything that a job is done with, except the rig.

    out_s: the run ends after this time with the ball out of the maze, s; None: the run does not check this"""

    maze: Maze
    model: RigModel  # of ball and stage
    behavior: str = "navigate"  # name or file of the tree
    rig_name: str = ""
    model_name: str = ""
    settings: Settings = field(default_factory=load_settings)
    behavior_modules: tuple[str, ...] = ()  # modules of the user, with leaves
    model_source: str | None = None  # where to load the model from again
    watch: Callable[[BehaviorTree, RunContext], None] | None = None  # called with each tree before it begins
    latency: Latency | None = None  # delays measured on the rig; they replace those of the model
    unseen_s: float | None = None  # the run ends after this time without the ball, s; None: never
    out_s: float | None = 0.0
    effects: str | None = None  # MODULE:FUNCTION of the user
    policy: Policy | None = None  # a learned policy, for the leaf FollowPolicy

    def on(self, rig: Any) -> Setup:
        """The setup with what the rig states (`interface.RigTraits`): its latency, `unseen_s` and `out_s`.

        On a real rig somebody can put the ball back, so `out_s` is PUT_BACK_S there unless the rig states it."""
        own = traits(rig)
        out_s = PUT_BACK_S if own.out_s is None and own.realtime else own.out_s
        return replace(
            self,
            latency=own.latency or self.latency,
            unseen_s=own.unseen_s or self.unseen_s,
            out_s=self.out_s if out_s is None else out_s,
        )

    @property
    def named_model(self) -> str:
        """The model's name for a log: its kind if it has no name."""
        return self.model_name or ("nominal" if self.model.kind == "p" else self.model.kind)

    @property
    def driving_model(self) -> RigModel:
        """The model with the delays of the rig."""
        return self.model if self.latency is None else self.model.late_by(self.latency)


@dataclass(frozen=True)
class SourceFile:
    """A file of the user, and its SHA-256."""

    file: str
    sha256: str


@dataclass(frozen=True)
class OwnEffects:
    """Effects of the user: MODULE:FUNCTION, and the SHA-256 of the module's file."""

    spec: str
    sha256: str


@dataclass(frozen=True)
class ReplayFacts:
    """The part `replay` of a log's header: everything that affects decisions and is not elsewhere in the header.

    model: folder or packaged name; None if the log holds the model, or the model is the nominal one"""

    format: int
    rate_hz: float
    closed: tuple[str, ...]
    settings: str  # `Settings.text`
    model_sha256: str
    behavior_file: str
    behavior_sha256: str
    modules: dict[str, SourceFile]  # modules of the user, by name
    start_theta: float | None = None  # start angle, rad; None: drawn by the seed
    model: str | None = None
    unseen_s: float | None = None
    out_s: float | None = None
    latency: Latency | None = None
    effects: OwnEffects | None = None
    policy: SourceFile | None = None


@cache
def facts_adapter() -> TypeAdapter[ReplayFacts]:
    """The adapter that writes and reads the part `replay` of a log's header."""
    return TypeAdapter(ReplayFacts)


def replay_facts(document: Any) -> ReplayFacts:
    """Read the part `replay` of a log's header. Raises ValueError that names the first wrong field."""
    try:
        return facts_adapter().validate_python(document)
    except ValidationError as problem:
        first = problem.errors()[0]
        name = ".".join(map(str, first["loc"]))
        raise ValueError(f"'{name}': {first['msg'].lower()}") from None


def log_header(setup: Setup, job: Job, rate_hz: float) -> dict[str, Any]:
    """The header of a log: facts for readers, and for `replay`."""
    return {
        "program": "mazeplan",
        "version": version("mazeplan"),
        "rig": setup.rig_name,
        "map": dump_map(setup.maze),
        "map_name": setup.maze.name,
        "model": setup.named_model,
        "behavior": setup.behavior,
        "behavior_modules": list(setup.behavior_modules),
        "start_ring": job.start,
        "goal_ring": job.goal,
        **({"via_rings": list(job.via)} if job.via else {}),
        "seed": job.seed,
        "time_limit_s": job.time_limit,
        "replay": facts_adapter().dump_python(_facts_for_replay(setup, job, rate_hz), mode="json", exclude_none=True),
    }


def model_to_keep(setup: Setup) -> bytes | None:
    """The packed model, for a log. None if a log needs none: the model is packaged or nominal. Also None if a file
    cannot hold the model to the last bit: a model made in a program has more digits."""
    source, sha256 = setup.model_source, fingerprint(setup.model)
    if source is not None and is_packaged_model(source):
        return None
    if source is None and sha256 == fingerprint(RigModel.nominal(setup.maze)):
        return None
    try:
        packed = packed_model(setup.model)
        return packed if fingerprint(unpacked_model(packed)) == sha256 else None
    except ModelError:
        return None


def _facts_for_replay(setup: Setup, job: Job, rate_hz: float) -> ReplayFacts:
    behavior = resources.find("behaviors", setup.behavior, ".xml")
    modules = [(name, user_module(name, "--behavior-module").__file__ or "") for name in setup.behavior_modules]
    policy, effects = None if setup.policy is None else setup.policy.source, None
    if setup.effects is not None:
        file = user_module(setup.effects.partition(":")[0], "--effects").__file__ or ""
        effects = OwnEffects(setup.effects, file_sha256(file))
    return ReplayFacts(
        format=REPLAY_FORMAT,
        rate_hz=rate_hz,
        closed=tuple(job.closed),
        settings=setup.settings.text(),
        model_sha256=fingerprint(setup.model),
        behavior_file=str(behavior.absolute()),
        behavior_sha256=file_sha256(*read_tree(setup.behavior).files),
        modules={name: SourceFile(file, file_sha256(file)) for name, file in modules},
        start_theta=job.theta,
        model=setup.model_source,
        unseen_s=setup.unseen_s,
        out_s=setup.out_s,
        latency=setup.latency,
        effects=effects,
        policy=None if policy is None else SourceFile(policy, policy_sha256(policy)),
    )


def file_sha256(*paths: str | Path) -> str:
    """SHA-256 of one file, or of several files joined in this order; empty if one of them cannot be read."""
    try:
        return hashlib.sha256(b"".join(Path(path).read_bytes() for path in paths)).hexdigest()
    except (OSError, ValueError):
        return ""
