"""Sections of files as pydantic models, and the words for pydantic's errors: the value, and what is allowed."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any, TypeVar

from pydantic import BaseModel, ConfigDict, ValidationError

from mazeplan.core.errors import InputError, one_of, unknown_keys_first
from mazeplan.maze.yamltree import Key, Tree, check_format, key_path, shown

M = TypeVar("M", bound=BaseModel)

MAPPING = "a mapping of keys to values"
MISSING = "is missing"
EXPECTED = {  # pydantic's kind of error: what to expect
    "model_type": MAPPING, "model_attributes_type": MAPPING, "dict_type": MAPPING, "tuple_type": "a list",
    "list_type": "a list", "string_type": "text (in quotes if it looks like a number)", "bool_type": "true or false",
    "float_type": "a number", "int_type": "a whole number", "int_from_float": "a whole number",
    "finite_number": "a finite number",
}  # fmt: skip


class Section(BaseModel):
    """Base of all sections. Refuses unknown keys, NaN, and text for a number."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True, allow_inf_nan=False)


def as_tuples(value: Any) -> Any:
    """The value with tuples in place of lists, as strict validation expects."""
    if isinstance(value, Mapping):
        return {key: as_tuples(item) for key, item in value.items()}
    return tuple(as_tuples(item) for item in value) if isinstance(value, list | tuple) else value


def problems(kind: type[BaseModel], error: ValidationError) -> list[tuple[Key, str]]:
    """(key path, message) of each error that pydantic found in a section of the class `kind`."""
    found = []
    for item in unknown_keys_first(error.errors(include_url=False)):
        key = tuple(part for part in item["loc"] if not str(part).startswith("function-"))
        found.append((key, _sentence(kind, key, item)))
    return found


def _sentence(kind: type[BaseModel], key: Key, error: Any) -> str:
    message, what, got = str(error["msg"]), error["type"], error.get("input")
    if what == "extra_forbidden":
        return f"unknown key, expected {one_of(_keys(kind, key[:-1]), key[-1])}"
    if what == "value_error":  # from a validator of this program
        return message.removeprefix("Value error, ")
    if what == "missing":
        return MISSING
    if what == "literal_error":
        names = re.findall(r"'([^']*)'", error["ctx"]["expected"])
        return f"got {shown(got)}, expected {one_of(names, got)}"
    if what in ("too_long", "too_short"):
        most = error["ctx"].get("max_length", error["ctx"].get("min_length"))
        return f"got {len(got)} entries, expected {'at most' if what == 'too_long' else 'at least'} {most}"
    expected = EXPECTED.get(what) or message.removeprefix("Input should be ").removeprefix("Field ")
    return f"got {shown(list(got) if isinstance(got, tuple) else got)}, expected {expected}"


def _keys(kind: Any, key: Key) -> list[str]:
    """Names of the keys of the section at `key` in a model."""
    for name in key:
        if isinstance(name, str) and name in kind.model_fields:  # other names are keys of a dict of sections
            kind = _section(kind.model_fields[name].annotation)
    return list(kind.model_fields)


def _section(annotation: Any) -> Any:
    """The model in an annotation such as `tuple[Model, ...] | None`."""
    if hasattr(annotation, "model_fields"):
        return annotation
    return next((found for part in getattr(annotation, "__args__", ()) if (found := _section(part))), None)


def read_section(kind: type[M], tree: Tree, file: str | Path, error: type[InputError], reads: int = 1) -> M:
    """The whole content of a file as a section; `reads`: its format number. Raises `error` with file, line and key."""
    check_format(tree, reads, file=file, error=error)
    data = tree.data
    if isinstance(data, dict):
        data = {key: value for key, value in data.items() if key not in ("format", "version")}
    try:
        return kind.model_validate(data)
    except ValidationError as wrong:
        key, said = problems(kind, wrong)[0]
        raise error(said, file=file, line=tree.line(key), key=key_path(key) or None) from None
