"""The YAML file of a rig: reads it, checks it against a pydantic model, and names file, line and key of a mistake."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any, TypeVar

from pydantic import BaseModel, ConfigDict, ValidationError

from mazeplan.core import file_kinds
from mazeplan.core.errors import SettingsError
from mazeplan.core.field_checks import unit_hint, unit_of
from mazeplan.core.name_hints import one_of, unknown_keys_first
from mazeplan.maze.yamltree import Key, Tree, check_format, key_path, read_yaml, shown

FORMAT = 1  # also the format of a file without the key `format`
OURS = "mazeplan."  # a class whose name begins so is one of this package
MAPPING = "settings as `key: value`"
EXPECTED = {  # pydantic's kind of error: what to expect, in the words of a YAML file
    "model_type": MAPPING, "model_attributes_type": MAPPING, "dict_type": MAPPING, "tuple_type": "a list",
    "list_type": "a list", "string_type": "text", "bool_type": "true or false", "finite_number": "a finite number",
}  # fmt: skip


class RigSection(BaseModel):
    """Base of all sections of a rig's file. Refuses unknown keys, NaN, and text for a number."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True, allow_inf_nan=False)


class FileSettings(dict[str, Any]):
    """Settings from a file; `file` and `tree` give the line of every key."""

    def __init__(self, data: Mapping[str, Any], file: Path, tree: Tree) -> None:
        super().__init__(data)
        self.file, self.tree = file, tree


def read_rig_file(path: Path) -> tuple[str | None, FileSettings]:
    """The value of `class` (or None) and the other keys of a rig's YAML file. Raises SettingsError."""
    tree = read_yaml(path, error=SettingsError, what="the settings of a rig (YAML)")
    if not isinstance(tree.data, dict):
        raise SettingsError(f"got {shown(tree.data)}, expected {MAPPING}", file=path, line=1)
    data = FileSettings(tree.data, path, tree)
    kind = data.pop("class", None)
    if kind is not None and not isinstance(kind, str):
        raise placed(SettingsError(f"got {shown(kind)}, expected module:Class", key="class"), data)
    if kind is None or kind.startswith(OURS):  # a user's class may have a setting named `format`
        other = file_kinds.by_keys(tree.data)
        if other in ("a map", "a model (model.yaml)"):  # a schedule of faults may be the file of an ideal rig
            raise SettingsError(f"got {other}, expected the file of a rig", file=path, line=1)
        check_format(tree, FORMAT, file=path, error=SettingsError)
        data.pop("format", None)
    return kind, data


def placed(problem: SettingsError, settings: Mapping[str, Any]) -> SettingsError:
    """The error with file and line added, if the settings come from a file and the error names no file."""
    if problem.file is not None or not isinstance(settings, FileSettings):
        return problem
    line = None if problem.key is None else settings.tree.line(_parsed_key(problem.key))
    return SettingsError(problem.problem, file=settings.file, line=line, key=problem.key)


M = TypeVar("M", bound=BaseModel)


def validated(
    kind: type[M], data: Mapping[str, Any], *, within: Key = (), source: Mapping[str, Any] | None = None
) -> M:
    """`data` as a section of the class `kind`.

    within: key of the section in its file.
    source: the settings of the whole file, by default `data`.

    Raises SettingsError with the key, and with file and line if `source` is from a file."""
    try:
        return kind.model_validate(as_tuples(data))
    except ValidationError as problem:
        raise placed(
            mistake(kind, unknown_keys_first(problem.errors())[0], within), data if source is None else source
        ) from None


def mistake(kind: type[BaseModel], error: Any, within: Key = ()) -> SettingsError:
    """One of pydantic's errors as a SettingsError without a file."""
    key = tuple(part for part in error["loc"] if not str(part).startswith("function-"))
    if error["type"] == "extra_forbidden":
        said = f"unknown key, expected {one_of(_fields(kind, key[:-1]), key[-1])}"
    else:
        said = _sentence(error)
    return SettingsError(said, key=key_path((*within, *key)) or None)


def as_tuples(value: Any) -> Any:
    """The value with tuples in place of lists, as strict validation expects."""
    if isinstance(value, Mapping):
        return {key: as_tuples(item) for key, item in value.items()}
    return tuple(as_tuples(item) for item in value) if isinstance(value, list | tuple) else value


def _sentence(error: Any) -> str:
    """One of pydantic's errors in words: the value and what is allowed."""
    name = next((part for part in reversed(error["loc"]) if isinstance(part, str)), "")
    message, kind, got = str(error["msg"]), error["type"], error.get("input")
    if kind == "value_error":  # from a validator of this program
        return message.removeprefix("Value error, ")
    if kind == "missing":
        return "is missing"
    if kind in ("too_long", "too_short"):
        most = error["ctx"].get("max_length", error["ctx"].get("min_length"))
        return f"got {len(got)} entries, expected {'at most' if kind == 'too_long' else 'at least'} {most}"
    expected = EXPECTED.get(kind) or message.removeprefix("Input should be ").removeprefix("Field ")
    limit: Any = next(iter(error.get("ctx", {}).values()), None) if kind.startswith(("less", "greater")) else None
    low, high = (0.0, limit) if kind.startswith("less") else (limit, math.inf)
    hint = "" if limit is None else unit_hint(got, unit_of(name), low, high)
    return f"got {shown(list(got) if isinstance(got, tuple) else got)}, expected {expected}{hint}"


def _fields(kind: Any, key: Key) -> list[str]:
    """Names of the keys of the section at `key` in a model."""
    for name in key:
        if isinstance(name, str):
            annotation = kind.model_fields[name].annotation
            options = (annotation, *getattr(annotation, "__args__", ()))
            kind = next(option for option in options if hasattr(option, "model_fields"))
    return list(kind.model_fields)


def _parsed_key(text: str) -> Key:
    """`camera.size[0]` as a key path."""
    return tuple(int(part) if part.isdigit() else part for part in re.findall(r"[^.\[\]]+", text))
