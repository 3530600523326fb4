"""The user's files that determine the results of a campaign, and how they come to a machine that has none of them.

Packaged files are left out. These must be on the other machine already: files outside the folder where the user works,
files that the user's code opens itself, and installed modules.
"""

from __future__ import annotations

import hashlib
import os
import re
import sys
import sysconfig
import tempfile
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from modulefinder import ModuleFinder
from pathlib import Path
from typing import Any

from mazeplan.behavior.trees import read_tree
from mazeplan.control.policy_file import ARRAYS, YAML
from mazeplan.core import resources
from mazeplan.core.errors import InputError, TreeError
from mazeplan.core.user_modules import user_module, user_module_folders
from mazeplan.learning.modelfile import is_packaged_model
from mazeplan.maze.mapfile import find_map
from mazeplan.rigs.files import read_rig_file
from mazeplan.rigs.registry import rig_file
from mazeplan.run.campaign.one_run import Campaign
from mazeplan.run.resolve import model_source

MODEL_FILES = {".yaml", ".npz"}
MOST_BYTES = 512 << 20
PATHS = ("rig", "map", "model", "behavior", "settings", "policy")  # fields of a campaign that may be paths


def user_files(campaign: Campaign) -> dict[str, Path]:
    """{name that does not depend on the place: file}. Raises InputError for a module that cannot be imported.

    map, settings, behavior, rig, model/...: the files that the campaign names
    behavior/..., rig/..., policy/...: the files that these name in turn
    modules/...: the modules of rig, tree and effects, with those that they import"""
    files = {"map": find_map(campaign.map)}
    files |= {} if campaign.settings is None else {"settings": Path(campaign.settings)}
    tree = resources.find("behaviors", campaign.behavior, ".xml")
    files |= {"behavior": tree, **{f"behavior/{os.path.relpath(p, tree.parent)}": p for p in _included(tree)}}
    rig = rig_file(campaign.rig)
    if rig is not None and not _packaged(rig):
        files |= {"rig": rig, **{f"rig/{name}": path for name, path in _named_by_rig(rig).items()}}
    model = model_source(campaign.model, campaign.rig)
    if model is not None and not is_packaged_model(model):
        folder = Path(model).parent if Path(model).is_file() else Path(model)
        files |= {f"model/{path.name}": path for path in folder.glob("*") if path.suffix in MODEL_FILES}
    if campaign.policy is not None:
        files |= {f"policy/{name}": Path(campaign.policy) / name for name in (YAML, ARRAYS)}
    files |= _modules([*campaign.behavior_modules, *effect_modules(campaign), *rig_modules(campaign.rig)])
    return {name: path for name, path in files.items() if not _packaged(path)}


def effect_modules(campaign: Campaign) -> list[str]:
    """The user's module with effects that the model has; empty without one."""
    return [] if campaign.effects is None else [campaign.effects.partition(":")[0]]


def rig_modules(rig: str) -> list[str]:
    """The user's module with the class of a rig; none for a simulated rig."""
    path = rig_file(rig)
    kind = rig if path is None else read_rig_file(path)[0]
    return [kind.partition(":")[0]] if kind is not None and ":" in kind else []


def _included(tree: Path) -> tuple[Path, ...]:
    """The files that a tree includes; none if it cannot be read, which the run then reports."""
    try:
        return read_tree(tree).files[1:]
    except TreeError:
        return ()


def _packaged(path: Path) -> bool:
    places = (resources.PACKAGE, resources.share("maps"), resources.share("behaviors"))
    return any(path.resolve().is_relative_to(place.resolve()) for place in places)


def _named_by_rig(rig: Path) -> dict[str, Path]:
    """Files that a rig's file names; for a MuJoCo model also those that it names. The rig's model is left out."""
    found: dict[str, Path] = {}
    for text in _texts({key: value for key, value in read_rig_file(rig)[1].items() if key != "model"}):
        if len(text) > 250 or "\0" in text:
            continue
        path = next((base / text for base in (rig.parent, Path()) if (base / text).is_file()), None)
        if path is not None:
            found |= {text: path, **(_named_by_mujoco(path) if path.suffix == ".xml" else {})}
    return found


def _named_by_mujoco(model: Path) -> dict[str, Path]:
    """Meshes, pictures and further models that a MuJoCo model names, beside it or in folders that it names."""
    found: dict[str, Path] = {}
    waiting, folders = [model], [""]
    while waiting:
        text = waiting.pop().read_text(encoding="utf-8", errors="replace")
        folders += re.findall(r'\b(?:meshdir|texturedir|assetdir)\s*=\s*"([^"]+)"', text)
        for file in re.findall(r'\bfile\s*=\s*"([^"]+)"', text):
            for path in (model.parent / folder / file for folder in folders):
                name = os.path.relpath(path, model.parent)
                if name not in found and path.is_file():
                    found[name] = path
                    waiting += [path] if path.suffix == ".xml" else []
    return found


def _texts(value: Any) -> Iterator[str]:
    if isinstance(value, str):
        yield value
    elif isinstance(value, Mapping | list | tuple):
        for item in value.values() if isinstance(value, Mapping) else value:
            yield from _texts(item)


def _modules(names: Iterable[str]) -> dict[str, Path]:
    """The user's modules, and the user's modules that they import: those in the folder of the user, or beside a file
    that names one, which are neither installed nor part of this program. Raises InputError."""
    finder = ModuleFinder([str(folder) for folder in user_module_folders()], excludes=["mazeplan"])
    for name in names:
        user_module(name, f"module {name!r}")  # looks into this folder
        if not name.startswith("mazeplan."):
            try:
                finder.import_hook(name)
            except ImportError:  # installed
                continue
    places = [Path(sysconfig.get_path(kind)).resolve() for kind in ("purelib", "stdlib")]
    found: dict[str, Any] = finder.modules
    paths = {name: Path(module.__file__).resolve() for name, module in found.items() if module.__file__}
    return {
        f"modules/{name}": path
        for name, path in paths.items()
        if path.suffix == ".py" and not any(path.is_relative_to(place) for place in places)
    }


# -- other machines ---------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Parcel:
    """Files for another machine: (path relative to the folder where the user works, content)."""

    files: tuple[tuple[str, bytes], ...] = ()


def packed(campaign: Campaign, files: Iterable[Path]) -> tuple[Parcel, Campaign]:
    """The files below the current folder, and the campaign with paths relative to it. Raises InputError for more than
    MOST_BYTES in all."""
    here = Path.cwd()
    inside = sorted({path for path in map(_absolute, files) if path.is_relative_to(here)})
    contents = tuple((path.relative_to(here).as_posix(), path.read_bytes()) for path in inside)
    if (size := sum(len(content) for _, content in contents)) > MOST_BYTES:
        raise InputError(f"the files of this campaign have {size >> 20} MiB, expected at most {MOST_BYTES >> 20}")
    paths = {name: getattr(campaign, name) for name in PATHS}
    relative = {name: path.removeprefix(f"{here}{os.sep}") for name, path in paths.items() if path is not None}
    return Parcel(contents), replace(campaign, **relative)


def _absolute(path: Path) -> Path:
    return Path(os.path.abspath(path))


_unpacked: list[tuple[Parcel, tempfile.TemporaryDirectory[str]]] = []  # at most one, the current folder


def unpack(parcel: Parcel) -> None:
    """Make a folder with these files the current folder of this process, if there are any."""
    if not parcel.files or (_unpacked and _unpacked[0][0] == parcel):
        return
    sys.path[:] = [os.path.abspath(place) for place in sys.path]
    folder = tempfile.TemporaryDirectory(prefix="mazeplan-", ignore_cleanup_errors=True)
    for name, content in parcel.files:
        path = Path(folder.name) / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(content)
    os.chdir(folder.name)
    sys.path.insert(0, folder.name)
    if _unpacked:  # its modules may have the same names
        _, last = _unpacked.pop()
        sys.path.remove(last.name)
        for name, module in list(sys.modules.items()):
            if (getattr(module, "__file__", None) or "").startswith(last.name):
                del sys.modules[name]
        last.cleanup()
    _unpacked.append((parcel, folder))


def content_sha256(path: Path) -> str:
    """SHA-256 of a file. Raises InputError if it cannot be read."""
    try:
        return hashlib.sha256(path.read_bytes()).hexdigest()
    except OSError as problem:
        raise InputError(f"cannot be read: {problem.strerror}", file=path) from None
