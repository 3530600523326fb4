"""What is to be done, with what, and what a log says of both."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from dataclasses import asdict, dataclass, field, replace
from importlib.metadata import version
from pathlib import Path
from typing import Any

from mazeplan import resources
from mazeplan.behavior.context import RunContext
from mazeplan.behavior.ownleaves import installed_in
from mazeplan.behavior.tree import BehaviorTree
from mazeplan.behavior.treefile import nodes_named
from mazeplan.errors import ModelError, TreeError
from mazeplan.maths.fingerprint import fingerprint
from mazeplan.maze.geometry import Maze
from mazeplan.maze.mapfile import dump_map
from mazeplan.maze.memory import OpeningMemory
from mazeplan.models.modelfile import RigModel, model_names
from mazeplan.models.packedmodel import packed_model, unpacked_model
from mazeplan.plugins import Plugin
from mazeplan.records import Latency
from mazeplan.settings import Settings, load_settings
from mazeplan.usermodule import user_module

REPLAY_FORMAT = 1  # of what the header holds for `replay`
TIME_LIMIT = 20.0  # s of rig time; the limit under which the published figures were taken


@dataclass(frozen=True)
class Job:
    """One navigation to do: from a ring and angle (rad; None: drawn by seed) to a ring, within time_limit s."""

    start: int
    goal: int
    theta: float | None = None
    seed: int = 0
    time_limit: float = TIME_LIMIT
    closed: tuple[str, ...] = ()


@dataclass(frozen=True)
class Setup:
    """With what a job is done: maze, model of ball and stage, tree (name or file), settings, names of modules with
    leaves of one's own, what is remembered of openings, which the run adds to, where the model can be loaded from
    again, and who watches: called with each tree before it begins.

    Of the rig: the latency that was measured of it, in the place of the model's, and after how many seconds without the
    ball a run ends."""

    maze: Maze
    model: RigModel
    behavior: str = "navigate"
    rig_name: str = ""
    model_name: str = ""
    settings: Settings = field(default_factory=load_settings)
    behavior_modules: tuple[str, ...] = ()
    memory: OpeningMemory | None = None
    model_source: str | None = None
    watch: Callable[[BehaviorTree, RunContext], None] | None = None
    latency: Latency | None = None
    unseen_s: float | None = None
    effects: str | None = None

    def on(self, rig: Any) -> Setup:
        """With what a rig says of itself (`interface.Rig`), where it says something."""
        latency, unseen = getattr(rig, "latency", None), getattr(rig, "unseen_s", None)
        if latency is None and unseen is None:
            return self
        return replace(self, latency=latency or self.latency, unseen_s=unseen or self.unseen_s)

    @property
    def driving_model(self) -> RigModel:
        """The model, as late as the rig is."""
        return self.model if self.latency is None else self.model.late_by(self.latency)


def log_header(setup: Setup, job: Job, rate_hz: float) -> dict[str, Any]:
    """What a reader of the log needs to know about the run, and `replay` to do it again."""
    return {
        "program": "mazeplan",
        "version": version("mazeplan"),
        "rig": setup.rig_name,
        "map": dump_map(setup.maze),
        "map_name": setup.maze.name,
        "model": setup.model_name or setup.model.kind,
        "behavior": setup.behavior,
        "behavior_modules": list(setup.behavior_modules),
        "start_ring": job.start,
        "goal_ring": job.goal,
        "seed": job.seed,
        "time_limit_s": job.time_limit,
        "replay": _to_replay(setup, job, rate_hz),
    }


def model_to_keep(setup: Setup) -> bytes | None:
    """The model, packed, for a log: None where it can be had by name or from the map, or files cannot hold it to the
    last bit (one made in a program has more digits than they have)."""
    source, sha256 = setup.model_source, fingerprint(setup.model)
    if source is not None and source in model_names() and not Path(source).exists():
        return None
    if source is None and sha256 == fingerprint(RigModel.nominal(setup.maze)):
        return None
    try:
        packed = packed_model(setup.model)
        return packed if fingerprint(unpacked_model(packed)) == sha256 else None
    except ModelError:
        return None


def _to_replay(setup: Setup, job: Job, rate_hz: float) -> dict[str, Any]:
    """What is not told elsewhere: small things whole, files by name and SHA-256."""
    behavior = resources.find("behaviors", setup.behavior, ".xml")
    modules = [(name, user_module(name, "--behavior-module").__file__ or "") for name in setup.behavior_modules]
    memory = None if setup.memory is None else setup.memory.document()
    installed = [(plugin.name, plugin.file() or "") for plugin in installed_leaves(setup)]
    leaves = {name: {"file": str(file), "sha256": file_sha256(file)} for name, file in installed}
    more = {
        "leaves": leaves or None,
        "memory": memory, "start_theta": job.theta, "model": setup.model_source, "unseen_s": setup.unseen_s,
        "latency": None if setup.latency is None else asdict(setup.latency),
        "effects": None if setup.effects is None else _effects_of(setup.effects),
    }  # fmt: skip
    return {
        "format": REPLAY_FORMAT,
        "rate_hz": rate_hz,
        "closed": list(job.closed),
        "settings": setup.settings.text(),
        "model_sha256": fingerprint(setup.model),
        "behavior_file": str(behavior.absolute()),
        "behavior_sha256": file_sha256(behavior),
        "modules": {name: {"file": file, "sha256": file_sha256(file)} for name, file in modules},
        **{name: value for name, value in more.items() if value is not None},
    }


def _effects_of(spec: str) -> dict[str, str]:
    """Which effects of a user the model has, and the SHA-256 of their module's file."""
    file = user_module(spec.partition(":")[0], "--effects").__file__ or ""
    return {"spec": spec, "sha256": file_sha256(file)}


def installed_leaves(setup: Setup) -> tuple[Plugin, ...]:
    """Entry points of the leaves of installed packages that the tree names; none where it cannot be read, which others
    will say."""
    try:
        return installed_in(nodes_named(setup.behavior), setup.behavior_modules)
    except TreeError:
        return ()


def file_sha256(path: str | Path) -> str:
    """Of the file's content; nothing where it cannot be read, which others will say."""
    try:
        return hashlib.sha256(Path(path).read_bytes()).hexdigest()
    except (OSError, ValueError):
        return ""
