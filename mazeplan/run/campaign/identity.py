"""The identity of a campaign: a document of everything that determines the result of a run with a given number.

The number of runs and the places of files are left out. So the same command with more runs goes on with the same
campaign.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import asdict
from typing import Any

from mazeplan.core import resources
from mazeplan.core.maths.fingerprint import fingerprint
from mazeplan.maze.mapfile import dump_map
from mazeplan.rigs.files import read_rig_file
from mazeplan.rigs.registry import rig_file, rig_label
from mazeplan.run.campaign.one_run import Campaign, job_of, setup_of
from mazeplan.run.campaign.user_files import content_sha256, user_files
from mazeplan.run.campaign.versions import program

LETTERS = 16  # length of a digest: these letters of a SHA-256 are enough for the few campaigns of a folder


def identity(campaign: Campaign) -> dict[str, Any]:
    """Everything that determines the results of a campaign, as a document of names, numbers and texts.

    Raises InputError if a part of the campaign cannot be used."""
    maze = campaign.maze()
    digests = {name: content_sha256(path) for name, path in sorted(user_files(campaign).items())}
    setup, job = setup_of(campaign, maze), job_of(campaign, 0, maze)
    behavior = resources.find("behaviors", setup.behavior, ".xml")
    return {
        "program": dict(program()),
        "rig": _rig_of(campaign),
        "map": dump_map(maze),
        "model": fingerprint(setup.model),
        "behavior": behavior.read_text(encoding="utf-8", errors="replace"),
        "settings": asdict(setup.settings),
        "start_ring": job.start,
        "goal_ring": job.goal,
        "seed": campaign.seed,
        "time_limit_s": campaign.time_limit,
        "files": {name: digest for name, digest in digests.items() if "/" in name and not name.startswith("model/")},
    }


def _rig_of(campaign: Campaign) -> dict[str, Any]:
    path = rig_file(campaign.rig)
    if path is None:
        return {"name": campaign.rig, "class": campaign.rig, "sense": campaign.sense}
    kind, data = read_rig_file(path)
    settings = {key: value for key, value in data.items() if key != "model"}
    return {"name": rig_label(campaign.rig), "class": kind, "settings": settings, "sense": campaign.sense}


def digest_of(document: Mapping[str, Any]) -> str:
    """A short digest of a document."""
    text = json.dumps(document, sort_keys=True, default=str, ensure_ascii=False)
    return hashlib.sha256(text.encode()).hexdigest()[:LETTERS]


def difference(one: Mapping[str, Any], other: Mapping[str, Any]) -> str:
    """Names of the parts in which two documents differ."""
    return ", ".join(key.removesuffix("_s").replace("_", " ") for key in one if one[key] != other.get(key))
