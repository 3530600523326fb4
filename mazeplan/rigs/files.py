"""The YAML file of a rig: reads it, checks it against a pydantic model, and names file, line and key of a mistake."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any, TypeVar

from pydantic import BaseModel, ValidationError

from mazeplan.core.errors import SettingsError
from mazeplan.maze.sections import as_tuples, problems
from mazeplan.maze.yamltree import Tree, check_format, key_path, read_yaml, shown

FORMAT = 1  # also the format of a file without the key `format`
OURS = "mazeplan."  # a class whose name begins so is one of this package


class FileSettings(dict[str, Any]):
    """Settings from a file; `file` and `tree` give the line of every key."""

    def __init__(self, data: Mapping[str, Any], file: Path, tree: Tree) -> None:
        super().__init__(data)
        self.file = file
        self.tree = tree


def read_rig_file(path: Path) -> tuple[str | None, FileSettings]:
    """The value of `class` (or None) and the other keys of a rig's YAML file. Raises SettingsError."""
    tree = read_yaml(path, error=SettingsError, what="the settings of a rig (YAML)")
    if not isinstance(tree.data, dict):
        raise SettingsError(f"got {shown(tree.data)}, expected settings as `key: value`", file=path, line=1)
    data = FileSettings(tree.data, path, tree)
    kind = data.pop("class", None)
    if kind is not None and not isinstance(kind, str):
        raise placed(SettingsError(f"got {shown(kind)}, expected module:Class", key="class"), data)
    if kind is None or kind.startswith(OURS):  # a user's class may have a setting named `format`
        check_format(tree, FORMAT, file=path, error=SettingsError)
        data.pop("format", None)
    return kind, data


def placed(problem: SettingsError, settings: Mapping[str, Any]) -> SettingsError:
    """The error with file and line added, if the settings come from a file and the error names no file."""
    if problem.file is not None or not isinstance(settings, FileSettings):
        return problem
    line = None
    if problem.key is not None:
        parts = re.findall(r"[^.\[\]]+", problem.key)  # of a key such as camera.size[0]
        line = settings.tree.line(tuple(int(part) if part.isdigit() else part for part in parts))
    return SettingsError(problem.problem, file=settings.file, line=line, key=problem.key)


M = TypeVar("M", bound=BaseModel)


def validated(kind: type[M], data: Mapping[str, Any]) -> M:
    """`data` as a section of the class `kind`. Raises SettingsError with the key; if `FileSettings`, with its line."""
    try:
        return kind.model_validate(as_tuples(data))
    except ValidationError as problem:
        key, said = problems(kind, problem)[0]
        raise placed(SettingsError(said, key=key_path(key) or None), data) from None
