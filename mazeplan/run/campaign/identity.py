"""What determines the results of a campaign: to continue a stored one, and to compare a worker's program with ours.

The number of runs and the places of files are left out of the identity. So the same command with more runs goes on with
the same campaign.
"""

from __future__ import annotations

import hashlib
import json
import platform
from collections.abc import Iterator, Mapping
from dataclasses import asdict
from functools import cache
from importlib.metadata import version
from pathlib import Path
from typing import Any

from mazeplan.behavior.trees import read_tree
from mazeplan.control.policy_file import ARRAYS, YAML
from mazeplan.core import resources
from mazeplan.core.errors import InputError
from mazeplan.core.maths.fingerprint import fingerprint
from mazeplan.core.user_modules import user_module
from mazeplan.maze.mapfile import dump_map
from mazeplan.rigs.files import read_rig_file
from mazeplan.rigs.registry import rig_file
from mazeplan.run.campaign.one_run import Campaign, job_of, setup_of

LETTERS = 16  # length of a digest: these letters of a SHA-256 are enough for the few campaigns of a folder
PACKAGES = ("mazeplan", "numpy", "scipy", "numba", "mujoco")
NOT_FOR_RESULTS = {"cli", "view", "report", "_share", "__pycache__"}  # folders of the package
KINDS = {".py", ".yaml", ".xml", ".npz", ".png"}


def identity(campaign: Campaign) -> dict[str, Any]:
    """Everything that determines the results of a campaign, as a document of names, numbers and texts.

    Files that the user's code opens itself, and modules that the user's modules import, are left out. Raises InputError
    if a part of the campaign cannot be used."""
    maze = campaign.maze()
    setup, job = setup_of(campaign, maze), job_of(campaign, 0, maze)
    path = rig_file(campaign.rig)
    kind, settings = (campaign.rig, {}) if path is None else read_rig_file(path)
    modules = [*campaign.behavior_modules, campaign.effects, kind]
    files = [Path(str(_module(name.partition(":")[0]))) for name in modules if name is not None]
    files += [] if campaign.policy is None else [Path(campaign.policy) / name for name in (YAML, ARRAYS)]
    trees = read_tree(str(resources.find("behaviors", setup.behavior, ".xml"))).files
    return {
        "program": dict(program()),
        "rig": {"class": kind, "settings": {key: value for key, value in settings.items() if key != "model"}},
        "map": dump_map(maze),
        "model": fingerprint(setup.model),
        "behavior": [file.read_text(encoding="utf-8", errors="replace") for file in trees],
        "settings": asdict(setup.settings),
        "start_ring": job.start,
        "goal_ring": job.goal,
        "seed": campaign.seed,
        "time_limit_s": campaign.time_limit,
        "files": {file.name: content_sha256(file) for file in files},
    }


def _module(name: str) -> str | None:
    return user_module(name, f"module {name!r}").__file__


def content_sha256(path: Path) -> str:
    """SHA-256 of a file. Raises InputError if it cannot be read."""
    try:
        return hashlib.sha256(path.read_bytes()).hexdigest()
    except OSError as problem:
        raise InputError(f"cannot be read: {problem.strerror}", file=path) from None


def digest_of(document: Mapping[str, Any]) -> str:
    """A short digest of a document."""
    text = json.dumps(document, sort_keys=True, default=str, ensure_ascii=False)
    return hashlib.sha256(text.encode()).hexdigest()[:LETTERS]


def difference(one: Mapping[str, Any], other: Mapping[str, Any]) -> str:
    """Names of the parts in which two documents differ."""
    return ", ".join(key.removesuffix("_s").replace("_", " ") for key in one if one[key] != other.get(key))


@cache
def program() -> Mapping[str, str]:
    """{package: version}, `python`, and `sources`: a digest of all files of the package that affect results."""
    digest = hashlib.sha256()
    for name, path in sorted(_files()):
        content = path.read_bytes()
        digest.update(f"{name} {len(content)}\n".encode())
        digest.update(content)
    versions = {name: version(name) for name in PACKAGES}
    return {**versions, "python": ".".join(platform.python_version_tuple()[:2]), "sources": digest.hexdigest()[:16]}


def _files() -> Iterator[tuple[str, Path]]:
    """Names and paths of the files that affect results. Names are the same in a checkout and in an installed wheel."""
    for path in resources.PACKAGE.rglob("*"):
        inside = path.relative_to(resources.PACKAGE)
        if path.suffix in KINDS and not NOT_FOR_RESULTS & set(inside.parts):
            yield inside.as_posix(), path
    for kind in ("maps", "behaviors"):
        for path in resources.share(kind).iterdir():
            if path.suffix in KINDS:
                yield f"{kind}/{path.name}", path


def program_mismatch(ours: Mapping[str, str], theirs: Mapping[str, str]) -> str:
    """In words, in what another machine's program differs from ours; empty if in nothing."""
    return ", ".join(
        f"{name} {theirs.get(name, 'none')} instead of {ours[name]}" for name in ours if theirs.get(name) != ours[name]
    )
