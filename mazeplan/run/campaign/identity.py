"""What determines the results of a campaign: to continue a stored one, and to compare a worker's program with ours.

The number of runs and the places of files are left out of the identity. So the same command with more runs goes on with
the same campaign.
"""

from __future__ import annotations

import hashlib
import json
import platform
from collections.abc import Iterator, Mapping
from functools import cache
from importlib.metadata import version
from pathlib import Path
from typing import Any

from mazeplan.core import resources
from mazeplan.core.user_modules import user_module
from mazeplan.rigs.files import read_rig_file
from mazeplan.rigs.registry import rig_file
from mazeplan.run.campaign.one_run import Campaign
from mazeplan.run.specification import file_sha256, log_header

LETTERS = 16  # length of a digest: these letters of a SHA-256 are enough for the few campaigns of a folder
PACKAGES = ("mazeplan", "numpy", "scipy", "numba", "mujoco")
NOT_FOR_RESULTS = {"cli", "view", "report", "_share", "__pycache__"}  # folders of the package
KINDS = {".py", ".yaml", ".xml", ".npz", ".png"}


def identity(campaign: Campaign) -> dict[str, Any]:
    """Everything that determines the results of a campaign, as a document of names, numbers and texts.

    Files that the user's code opens itself, and modules that the user's modules import, are left out. Raises InputError
    if a part of the campaign cannot be used."""
    ready = campaign.resolve(job=campaign.job_of(0))
    header = log_header(ready.setup, ready.job, ready.rig.rate_hz)
    facts, path = header["replay"], rig_file(str(campaign.rig))
    kind, settings = (str(campaign.rig), {}) if path is None else read_rig_file(path)
    files = {**facts["modules"], **{name: facts[name] for name in ("effects", "policy") if name in facts}}
    return {
        "program": dict(program()),
        "rig": {
            "class": kind, "settings": {key: value for key, value in settings.items() if key != "model"},
            "file": None if kind is None else file_sha256(user_module(kind.partition(":")[0], "rig").__file__ or ""),
        },
        **{name: header[name] for name in ("map", "start_ring", "goal_ring", "seed", "time_limit_s")},
        "model": facts["model_sha256"],
        "behavior": facts["behavior_sha256"],
        "settings": facts["settings"],
        "files": {name: file["sha256"] for name, file in files.items()},
        "fault": None if campaign.fault is None else campaign.fault.to_json(),
    }  # fmt: skip


def digest_of(document: Mapping[str, Any]) -> str:
    """A short digest of a document."""
    text = json.dumps(document, sort_keys=True, default=str, ensure_ascii=False)
    return hashlib.sha256(text.encode()).hexdigest()[:LETTERS]


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
