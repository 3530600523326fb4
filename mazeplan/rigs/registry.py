"""Makes the rig that `--rig` names: a packaged rig, a YAML file, or module:Class."""

from __future__ import annotations

import math
import traceback
from collections.abc import Iterator
from contextlib import closing, contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

from mazeplan.core import file_kinds
from mazeplan.core.errors import InputError, MazeplanError, RigError, SettingsError, guess, one_of, reason
from mazeplan.core.user_modules import user_module
from mazeplan.maze.geometry import Maze
from mazeplan.maze.mapfile import load_map
from mazeplan.maze.yamltree import shown
from mazeplan.rigs.files import FileSettings, placed, read_rig_file, validated
from mazeplan.rigs.interface import Rig, RigWrapper
from mazeplan.rigs.sim.settings import SimulatedSettings

PACKAGED = Path(__file__).resolve().parent
HARDWARE = "hardware"  # this name means hardware.yaml in the current folder, if it exists
AnyRig = str | Path | Rig | type  # what `--rig` takes, a rig, or its class
METHODS = ("reset", "observe", "command", "level", "close")


class _KeptOpen(RigWrapper):
    """A rig that several runs use one after the other: it stays open between them, with the plate level."""

    close = RigWrapper.level


@contextmanager
def kept_open(rig: AnyRig, *, alone: bool) -> Iterator[str | Rig | type]:
    """A rig for several runs within this context. A class of rigs is made anew each time, a rig is closed at the end.

    alone: all work is done in this process, and none is kept. If not, a rig that is an object raises InputError."""
    if isinstance(rig, str | Path):
        yield str(rig)
        return
    if not alone:
        problem = "got a rig that is an object, expected a name, a file or module:Class with workers, dask or store"
        raise InputError(problem, key="rig")
    if isinstance(rig, type):
        yield rig
        return
    _check_class(type(rig), type(rig).__name__, {})
    with closing(rig):
        yield _KeptOpen(rig)


def rig_names() -> tuple[str, ...]:
    """Names of the packaged rigs."""
    return tuple(sorted(path.stem for path in PACKAGED.glob("*.yaml")))


def rig_file(spec: str) -> Path | None:
    """The YAML file that a spec names, or None for a class. Raises SettingsError for an unknown rig."""
    packaged = PACKAGED / f"{spec}.yaml"
    if spec == HARDWARE and Path(packaged.name).is_file():  # the user's hardware.yaml comes before the packaged one
        return Path(packaged.name)
    if spec in rig_names():
        return packaged
    path = Path(spec)
    if path.suffix in (".yaml", ".yml") or path.is_file():
        if not path.is_file():
            raise SettingsError(file_kinds.refused(path, "the settings of a rig (YAML)"), file=spec)
        return path
    if ":" in spec:
        return None
    names = one_of(rig_names(), spec, ", a YAML file, or module:Class")
    raise SettingsError(f"got rig {shown(spec)}, expected {names}")


def is_simulated(rig: AnyRig) -> bool:
    """Whether a name or file means a simulated rig of this program: as many at once as one likes."""
    path = rig_file(str(rig)) if isinstance(rig, str | Path) else None
    return path is not None and read_rig_file(path)[0] is None


def rig_label(rig: AnyRig) -> str:
    """Name in reports: the packaged name, the file's stem, or the class."""
    if not isinstance(rig, str | Path):
        rig = rig.inside if isinstance(rig, _KeptOpen) else rig
        return (rig if isinstance(rig, type) else type(rig)).__name__
    path = rig_file(str(rig))
    return str(rig) if path is None else path.stem


def rig_model_hint(spec: str) -> str | None:
    """The model that a rig's file names with `model:`: a path beside the file if it exists, else the name itself."""
    path = rig_file(spec)
    if path is None:
        return None
    data = read_rig_file(path)[1]
    hint = data.get("model")
    if hint is not None and not isinstance(hint, str):
        raise placed(SettingsError(f"got {shown(hint)}, expected a model's name or folder", key="model"), data)
    return None if hint is None else _beside(path, hint)


def unusable_model(spec: str, problem: str) -> SettingsError:
    """The error for an unusable model that a rig's file names with `model:`, with the line of that key."""
    path = rig_file(spec)
    return placed(SettingsError(problem, key="model"), {} if path is None else read_rig_file(path)[1])


def _beside(path: Path, name: str) -> str:
    """A file or folder that a rig's file names: its path beside that file if it exists there, else the name."""
    found = path.parent / name
    return str(found.absolute()) if found.exists() else name  # a bare name would mean a packaged one


def make_rig(rig: AnyRig, maze: Maze) -> Rig:
    """The rig that a name or file means, one of a class, or the rig itself; nothing is opened yet. Raises SettingsError
    with file, line and key."""
    if isinstance(rig, type):
        _check_class(rig, rig.__name__, {})
        return rig(maze, {})
    if not isinstance(rig, str | Path):
        return rig
    path = rig_file(str(rig))
    kind, data = (str(rig), None) if path is None else read_rig_file(path)
    if kind is not None:
        return _from_class(kind, maze, data)
    assert data is not None
    from mazeplan.rigs.sim.simulated import SimulatedRig

    _check_keys(data)
    settings = validated(SimulatedSettings, data)
    own = maze if settings.map is None else replace(load_map(_beside(data.file, settings.map)), balls=maze.balls)
    try:
        return SimulatedRig(own, settings)
    except SettingsError as problem:
        raise placed(problem, data) from None


def _check_keys(settings: FileSettings) -> None:
    """Raises SettingsError for a key that a simulated rig does not have: the file may be of a rig of one's own."""
    known = SimulatedSettings.model_fields
    for key in settings:
        if key not in known:
            what = f"a key of `mazeplan rig list`{guess(key, known)}; or, for a rig of your own, `class: module:Class`"
            raise placed(SettingsError(f"unknown key, expected {what}", key=str(key)), settings)


def _from_class(spec: str, maze: Maze, settings: FileSettings | None) -> Rig:
    where: dict[str, Any] = {}
    if settings is not None:
        where = {"file": settings.file, "line": settings.tree.line(("class",))}
    name, kind, given = f"{spec!r}", rig_class(spec, where), {} if settings is None else settings
    _check_class(kind, name, where)
    try:
        rig = kind(maze, given)
    except SettingsError as problem:  # the class knows the key, but not its line in the file
        raise placed(problem, given) from None
    except MazeplanError:
        raise
    except Exception as problem:  # for example a port that does not exist
        if traceback.extract_tb(problem.__traceback__)[-1].filename == __file__:  # the call itself failed
            raise SettingsError(f"{name}: {problem}; expected __init__(self, maze, settings)", **where) from None
        raise RigError(f"{name} could not be made: {reason(problem)}") from problem
    rate = getattr(rig, "rate_hz", None)
    if not isinstance(rate, int | float) or isinstance(rate, bool) or not 0.0 < rate < math.inf:
        raise SettingsError(f"{name} is no rig: rate_hz: got {shown(rate)}, expected a number > 0", **where)
    return rig


def rig_class(spec: str, where: dict[str, Any]) -> Any:
    """The class that module:Class names. Raises SettingsError. where: file of the rig, and line in it, for errors"""
    module_name, _, class_name = spec.partition(":")
    if not class_name:
        raise SettingsError(f"got rig {spec!r}, expected module:Class", **where)
    file = where.get("file")
    try:
        module = user_module(module_name, f"rig {spec!r}", None if file is None else file.parent)
    except InputError as problem:
        raise SettingsError(problem.problem, **where) from None
    if not hasattr(module, class_name):
        raise SettingsError(f"rig {spec!r}: module {module_name!r} has no {class_name!r}", **where)
    return getattr(module, class_name)


def _check_class(kind: Any, name: str, where: dict[str, Any]) -> None:
    missing = [method for method in METHODS if not callable(getattr(kind, method, None))]
    if missing or not isinstance(kind, type):
        raise SettingsError(f"{name} is no rig: it lacks {', '.join(missing) or 'a class'}", **where)
