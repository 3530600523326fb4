"""Packs the user's files that a run needs into a parcel, for a machine that has none of them.

A parcel holds:
- map, behaviour, settings, rig, model and policy of the user; packaged ones are left out,
- the files that the rig's file names, and the behaviour's file includes, by relative paths,
- the user's modules for rig, behaviour and effects, with the modules that they import from the same folders.

Some files must already be on the other machine: files that the user's code opens itself, files with absolute paths, and
installed modules.

A parcel is made once: later edits of the files do not change a campaign that is under way.
"""

from __future__ import annotations

import ast
import hashlib
import importlib
import importlib.util
import os
import re
import sys
import sysconfig
import tempfile
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path, PurePosixPath
from typing import Any

from mazeplan.behavior.treefile import tree_files
from mazeplan.control.policy_file import ARRAYS, YAML
from mazeplan.core import resources
from mazeplan.core.errors import InputError, TreeError
from mazeplan.core.plugins import RIGS, Plugin, plugin
from mazeplan.core.records import NavigationResult
from mazeplan.core.user_modules import user_module, user_module_folders
from mazeplan.learning.modelfile import is_packaged_model
from mazeplan.maze.mapfile import find_map
from mazeplan.rigs.files import read_rig_file
from mazeplan.rigs.registry import rig_file, rig_names, seeded
from mazeplan.run.campaign.one_run import Campaign, effect_modules
from mazeplan.run.resolve import model_source

MODULES = "modules"
MODEL_FILES = {".yaml", ".npz"}
MOST_BYTES = 512 << 20


@dataclass(frozen=True)
class Parcel:
    """The files of a campaign.

    files: (path in the parcel, content)
    names: (field of the campaign, path in the parcel)
    origins: (path in the parcel, path of the file that was packed)
    """

    files: tuple[tuple[str, bytes], ...] = ()
    names: tuple[tuple[str, str], ...] = ()
    origins: tuple[tuple[str, str], ...] = ()

    @cached_property
    def digests(self) -> dict[str, str]:
        """{path: SHA-256 (hex) of the content}."""
        return {name: hashlib.sha256(content).hexdigest() for name, content in self.files}

    @cached_property
    def digest(self) -> str:
        """SHA-256 (hex) of the whole parcel."""
        return hashlib.sha256(repr(sorted(self.digests.items())).encode()).hexdigest()


def packed(campaign: Campaign) -> Parcel:
    """The parcel of a campaign. Raises InputError for missing files, and for more than MOST_BYTES in all."""
    files: dict[str, Path] = {}
    names: dict[str, str] = {}
    modules = [*campaign.behavior_modules, *effect_modules(campaign)]
    places = {"map": find_map(campaign.map)}
    places |= {} if campaign.settings is None else {"settings": Path(campaign.settings)}
    for field, path in places.items():
        if not _packaged(path):
            names[field] = f"{field}/{path.name}"
            files[names[field]] = path
    tree = resources.find("behaviors", campaign.behavior, ".xml")
    if not _packaged(tree):
        names["behavior"], of_tree = _tree_files(tree)
        files |= of_tree
    rig = None if installed(campaign.rig) else rig_file(campaign.rig)
    modules += rig_modules(campaign.rig)
    if rig is not None and not _packaged(rig):
        data = read_rig_file(rig)[1]
        place, beside = _rig_files(rig, data)
        names["rig"] = place + _seed_of(campaign.rig)
        files |= beside
    model = model_source(campaign.model, campaign.rig)
    if model is not None and not is_packaged_model(model) and not _packaged(Path(model)):
        names["model"], of_model = _model_files(Path(model))
        files |= of_model
    if campaign.policy is not None:
        names["policy"] = "policy"
        files |= {f"policy/{name}": Path(campaign.policy) / name for name in (YAML, ARRAYS)}
    files |= _module_files(modules)
    contents = {name: _content(path) for name, path in sorted(files.items())}
    if (size := sum(map(len, contents.values()))) > MOST_BYTES:
        raise InputError(f"the files of this campaign have {size >> 20} MiB, expected at most {MOST_BYTES >> 20}")
    origins = tuple((name, str(path)) for name, path in files.items())
    return Parcel(tuple(contents.items()), tuple(names.items()), origins)


def installed(rig: str) -> Plugin | None:
    """The plug-in of an installed package with the name of this rig; None for any other rig."""
    name = seeded(rig)[0]
    if ":" in name or name in rig_names() or Path(name).suffix in (".yaml", ".yml") or Path(name).is_file():
        return None
    return plugin(RIGS, name)


def rig_modules(rig: str) -> list[str]:
    """The user's module with the class of a rig; none for a rig of an installed package."""
    path = rig_file(rig)
    kind = seeded(rig)[0] if path is None else read_rig_file(path)[0]
    return [kind.partition(":")[0]] if kind is not None and ":" in kind else []


def included_elsewhere(behavior: str) -> list[Path]:
    """The user's files that a tree includes by absolute paths, and those that these include. A parcel lacks them."""
    tree = resources.find("behaviors", behavior, ".xml")
    return [path for path in _included(tree) if not path.is_relative_to(tree.parent)]


def _included(tree: Path) -> list[Path]:
    """The user's files that a tree includes; none if it cannot be read, which the run then reports."""
    try:
        return [path for path in tree_files(tree)[1:] if not _packaged(path)]
    except TreeError:
        return []


def _packaged(path: Path) -> bool:
    places = (resources.PACKAGE, resources.share("maps"), resources.share("behaviors"))
    return any(path.resolve().is_relative_to(place.resolve()) for place in places)


def _content(path: Path) -> bytes:
    try:
        return path.read_bytes()
    except OSError as problem:
        raise InputError(f"cannot be read: {problem.strerror}", file=path) from None


def _seed_of(rig: str) -> str:
    seed = seeded(rig)[1]
    return "" if seed is None else f"@{seed}"


def _tree_files(tree: Path) -> tuple[str, dict[str, Path]]:
    """Path of the tree's file in the parcel, and all files: the tree's file and those that it includes by relative
    paths. The path of an included file begins with the folder of the file that includes it."""
    beside = [path for path in _included(tree) if path.is_relative_to(tree.parent)]
    names = {os.path.normpath(path.relative_to(tree.parent)): path for path in beside}
    return _placed("behavior", tree, {PurePosixPath(name).as_posix(): path for name, path in names.items()})


def _rig_files(rig: Path, data: Mapping[str, Any]) -> tuple[str, dict[str, Path]]:
    """Path of the rig's file in the parcel, and all files: the rig's file and those that it names by relative paths.

    The model is packed separately (`_model_files`)."""
    found: dict[str, Path] = {}
    for text in _texts({key: value for key, value in data.items() if key != "model"}):
        name = os.path.normpath(text)
        if os.path.isabs(name) or len(name) > 250 or "\0" in name:
            continue
        path = next((base / name for base in (rig.parent, Path()) if (base / name).is_file()), None)
        if path is not None:
            found[PurePosixPath(name).as_posix()] = path
    for name, path in list(found.items()):
        if path.suffix == ".xml":
            found |= _of_model(name, path)
    return _placed("rig", rig, found)


def _placed(kind: str, first: Path, beside: Mapping[str, Path]) -> tuple[str, dict[str, Path]]:
    """Path in the parcel of a file that names others, and all files. beside: {name relative to the first: file}.

    Names with .. still work, because the folder of the first file lies as deep as they need."""
    folder = kind + "/in" * max((name.split("/").count("..") for name in beside), default=0)
    files = {os.path.normpath(f"{folder}/{name}"): path for name, path in beside.items()}
    place = f"{folder}/{first.name}"
    return place, {**files, place: first}


def _of_model(name: str, model: Path) -> dict[str, Path]:
    """Files that a MuJoCo model names: meshes, pictures and further models, beside it or in folders that it names."""
    found: dict[str, Path] = {}
    waiting, folders = [model], [""]
    while waiting:
        text = waiting.pop().read_text(encoding="utf-8", errors="replace")
        folders += re.findall(r'\b(?:meshdir|texturedir|assetdir)\s*=\s*"([^"]+)"', text)
        for file in re.findall(r'\bfile\s*=\s*"([^"]+)"', text):
            for folder in folders:
                place = os.path.normpath(os.path.join(os.path.dirname(name), folder, file))
                path = model.parent / folder / file
                if os.path.isabs(place) or place in found or not path.is_file():
                    continue
                found[place] = path
                waiting += [path] if path.suffix == ".xml" else []
    return found


def _texts(value: Any) -> Iterator[str]:
    if isinstance(value, str):
        yield value
    elif isinstance(value, Mapping):
        for item in value.values():
            yield from _texts(item)
    elif isinstance(value, list | tuple):
        for item in value:
            yield from _texts(item)


def _model_files(model: Path) -> tuple[str, dict[str, Path]]:
    """Path of the model in the parcel, and its files."""
    folder = model.parent if model.is_file() else model
    place = f"model/{folder.absolute().name or 'model'}"
    if not folder.is_dir():
        return place, {}
    found = [path for path in folder.iterdir() if path.is_file() and path.suffix in MODEL_FILES]
    files = {f"{place}/{path.name}": path for path in found}
    return (f"{place}/{model.name}" if model.is_file() else place), files


# -- modules --------------------------------------------------------------------------------------------------------


def _module_files(names: Iterable[str]) -> dict[str, Path]:
    """Source files of the user's modules, and of the user's modules that they import. Raises InputError."""
    files: dict[str, Path] = {}
    seen: set[str] = set()
    waiting = list(names)
    for name in waiting:
        user_module(name, f"module {name!r}")  # looks into this folder; raises InputError
    while waiting:
        name = waiting.pop()
        if name in seen:
            continue
        seen.add(name)
        if not _is_user_module(name.partition(".")[0]):  # the first word only: a look into a package would import it
            continue
        path = module_file(name)
        if path is None:
            continue
        place = f"{MODULES}/{name.replace('.', '/')}"
        files[f"{place}/__init__.py" if path.name == "__init__.py" else f"{place}.py"] = path
        waiting += [name.rpartition(".")[0]] if "." in name else []
        waiting += _imports(_content(path), name if path.name == "__init__.py" else name.rpartition(".")[0])
    return files


def module_file(name: str) -> Path | None:
    """The source file of a module, if it has one."""
    try:
        spec = importlib.util.find_spec(name)
    except (ImportError, ValueError, AttributeError):
        return None
    return Path(spec.origin) if spec is not None and spec.origin and spec.origin.endswith(".py") else None


def _is_user_module(name: str) -> bool:
    """Whether a module is the user's: in the working folder or beside the file that names it, and neither installed nor
    part of this program."""
    try:
        spec = importlib.util.find_spec(name)
    except (ImportError, ValueError):
        return False
    places = [] if spec is None else [spec.origin or "", *(spec.submodule_search_locations or ())]
    path = next((Path(place).resolve() for place in places if os.path.exists(place)), None)
    installed = [Path(sysconfig.get_path(kind)).resolve() for kind in ("purelib", "stdlib")]
    if path is None or any(path.is_relative_to(place) for place in (*installed, resources.PACKAGE)):
        return False
    return any(path.is_relative_to(place) for place in user_module_folders())


def _imports(source: bytes, package: str) -> list[str]:
    """Names in the imports of a source that may be modules outside the standard library."""
    found: list[str] = []
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            found += [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            above = package.rsplit(".", node.level - 1)[0] if node.level else ""
            base = ".".join(part for part in (above, node.module) if part)
            found += [base, *(f"{base}.{alias.name}" for alias in node.names)]
    return [name for name in found if name and name.partition(".")[0] not in sys.stdlib_module_names]


# -- unpacking ------------------------------------------------------------------------------------------------------

_unpack_cache: list[tuple[str, tempfile.TemporaryDirectory[str]]] = []  # digest and folder of the unpacked parcel


def unpacked(parcel: Parcel, campaign: Campaign) -> Campaign:
    """The campaign with the paths of its unpacked files. The files stay until another parcel is unpacked."""
    if not parcel.files:
        return campaign
    if not _unpack_cache or _unpack_cache[0][0] != parcel.digest:
        _clear()
        folder = tempfile.TemporaryDirectory(prefix="mazeplan-")
        for name, content in parcel.files:
            path = Path(folder.name) / name
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(content)
        _unpack_cache.append((parcel.digest, folder))
        _import_from(Path(folder.name) / MODULES)
    folder_name = Path(_unpack_cache[0][1].name)
    return replace(campaign, **{field: str(folder_name / name) for field, name in parcel.names})


def with_relative_paths(result: NavigationResult) -> NavigationResult:
    """The result with file names relative to the folder of the unpacked parcel, so that it is the same everywhere."""
    if not _unpack_cache:
        return result
    here = f"{_unpack_cache[0][1].name}{os.sep}"
    return replace(result, failures=tuple(replace(f, detail=f.detail.replace(here, "")) for f in result.failures))


@contextmanager
def errors_name_origins(parcel: Parcel) -> Iterator[None]:
    """A context in which errors about an unpacked file name the file that was packed."""
    try:
        yield
    except Exception as problem:  # a user's leaf may raise anything; a note names the place
        if _unpack_cache:
            here = f"{_unpack_cache[0][1].name}{os.sep}"

            def of_origin(text: str) -> str:
                for name, origin in parcel.origins:
                    text = text.replace(f"{here}{name}", origin)
                return text

            problem.args = tuple(of_origin(arg) if isinstance(arg, str) else arg for arg in problem.args)
            if notes := getattr(problem, "__notes__", []):
                notes[:] = map(of_origin, notes)
            if isinstance(problem, InputError) and problem.file is not None:
                problem.file = of_origin(str(problem.file))
        raise


def _import_from(folder: Path) -> None:
    if os.getcwd() not in sys.path:  # else `user_module` would put it before the parcel
        sys.path.insert(0, os.getcwd())
    if folder.is_dir():
        sys.path.insert(0, str(folder))
        importlib.invalidate_caches()


def _clear() -> None:
    """Remove the last parcel and its imported modules: the next parcel may have other modules of the same names."""
    while _unpack_cache:
        _, folder = _unpack_cache.pop()
        modules = os.path.join(folder.name, MODULES)
        sys.path[:] = [place for place in sys.path if place != modules]
        for name, module in list(sys.modules.items()):
            if (getattr(module, "__file__", None) or "").startswith(modules + os.sep):
                del sys.modules[name]
        folder.cleanup()
