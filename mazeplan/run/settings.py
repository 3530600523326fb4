"""How the ball is driven: costs, gains and windows of a run, from one YAML file (settings.yaml explains every key).

A file has only the keys whose values differ from the packaged file. Each section is a frozen dataclass of options,
defined beside its algorithm; its fields are the keys.
"""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass, fields, is_dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any, get_type_hints

from mazeplan.behavior.context import LeafOptions
from mazeplan.control.estimation.estimator import EstimatorOptions
from mazeplan.core.errors import SettingsError, one_of
from mazeplan.maze.yamltree import Tree, check_format, key_path, parse_yaml, read_yaml, shown

PACKAGED = Path(__file__).resolve().parent / "settings.yaml"
FORMAT = 1  # format number; also that of a file without `format`


@dataclass(frozen=True)
class Settings:
    """Options of the leaves (with planner and control at openings), and of the estimator."""

    leaves: LeafOptions
    estimator: EstimatorOptions

    def with_values(self, sections: dict[str, dict[str, Any]]) -> Settings:
        """A copy with other values for some keys, {section: {name: value}}. Raises SettingsError with the key
        `section.name`."""
        leaves, estimator = self.leaves, self.estimator
        for section, values in sections.items():
            try:
                if section == "estimator":
                    estimator = replace(estimator, **values)
                else:
                    leaves = replace(leaves, **{section: replace(getattr(leaves, section), **values)})
            except SettingsError as problem:
                raise SettingsError(problem.problem, key=f"{section}.{problem.key}") from None
        return Settings(leaves, estimator)

    def text(self) -> str:
        """All settings as one line of JSON, exact to the last bit; `settings_from_text` reads it."""
        return json.dumps(asdict(self))


def settings_from_text(text: str) -> Settings:
    """Read what `Settings.text` returned.

    Keys of older versions are left out. Raises ValueError for any other text, SettingsError for values out of range."""
    return _filled(load_settings(), json.loads(text))


def _filled(options: Any, values: Any) -> Any:
    held = {f.name: getattr(options, f.name) for f in fields(options)}
    sections = {name for name, value in held.items() if is_dataclass(value)}
    if not isinstance(values, dict) or not values.keys() >= held.keys():
        raise ValueError(f"expected {', '.join(sorted(held))}")
    return replace(options, **{n: _filled(held[n], values[n]) if n in sections else values[n] for n in held})


def load_settings(source: str | Path | None = None) -> Settings:
    """The packaged settings, changed by the keys of a file. Raises SettingsError with file, line and key."""
    packaged = _packaged()
    if source is None:
        return packaged
    path = Path(source)
    return _apply(packaged, read_yaml(path, error=SettingsError, what="settings (YAML)"), path)


@cache
def _packaged() -> Settings:
    data = parse_yaml(PACKAGED.read_text(encoding="utf-8"), file=PACKAGED, error=SettingsError).data
    leaves = {name: kind(**data[name]) for name, kind in get_type_hints(LeafOptions).items()}
    return Settings(LeafOptions(**leaves), EstimatorOptions(**data["estimator"]))


def _apply(base: Settings, tree: Tree, path: Path) -> Settings:
    sections = [*(f.name for f in fields(base.leaves)), "estimator"]
    check_format(tree, FORMAT, file=path, error=SettingsError)
    data = {name: values for name, values in _mapping(tree.data, tree, path, ()).items() if name != "format"}
    for section, values in data.items():
        if section not in sections:
            expected = f"unknown section, expected {one_of(sections, section)}"
            raise SettingsError(expected, file=path, line=tree.line((section,)), key=key_path((section,)))
        options = base.estimator if section == "estimator" else getattr(base.leaves, section)
        known = [f.name for f in fields(options) if f.type in ("int", "float", "bool")]
        for name in _mapping(values, tree, path, (section,)):
            if name not in known:
                problem = f"unknown key, expected {one_of(known, name)}"
                raise SettingsError(problem, file=path, line=tree.line((section, name)), key=key_path((section, name)))
    try:
        return base.with_values(data)
    except SettingsError as problem:
        key = tuple((problem.key or "").split("."))
        raise SettingsError(problem.problem, file=path, line=tree.line(key), key=problem.key) from None


def _mapping(value: Any, tree: Tree, path: Path, key: tuple[str, ...]) -> dict[str, Any]:
    if not isinstance(value, dict):
        expected = f"got {shown(value)}, expected `key: value` lines"
        raise SettingsError(expected, file=path, line=tree.line(key), key=key_path(key) or None)
    return value
