"""What a user hands in: which kind of report it is for, checked so far that pictures can rely on it.

FILE.mcap            a run's log
FILE.json            what `evaluate`, `compare`, `diagnose` or `improve` printed with --json
FOLDER               what `diagnose -o` wrote (report.json, evidence.json), or a model (model.yaml)
FILE.csv             a table, on which a model is judged
"""

from __future__ import annotations

import json
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from mazeplan import filekinds
from mazeplan.errors import InputError

KINDS = "a run log, or the JSON of evaluate, compare, diagnose or improve, or the folder of diagnose -o or of a model"
MOST = 200 * 2**20  # bytes of a document


@dataclass(frozen=True)
class Input:
    """kind: run, table, model, evaluation, comparison, diagnosis; name: what a reader calls it; document: its JSON,
    none of what is a file of another kind; evidence: of a diagnosis, what its pictures show."""

    kind: str
    path: Path
    name: str
    document: dict[str, Any]
    evidence: dict[str, Any] | None = None


def read_input(path: Path) -> list[Input]:
    """What is in a file or folder; of the document of `improve` several. Raises InputError."""
    if (path / "model.yaml").is_file():
        return [Input("model", path, path.name, {})]
    if path.is_dir():
        if not (path / "report.json").is_file():
            raise InputError(f"got a folder without report.json or model.yaml, expected {KINDS}", file=path)
        document = read_document(path / "report.json")
        evidence = path / "evidence.json"
        shown = read_document(evidence) if evidence.is_file() else None
        check_diagnosis(document, path / "report.json")
        if shown is not None:
            check_evidence(shown, evidence)
            if is_rig_document(document) != (shown.get("kind") == "rig"):
                raise InputError("belongs to another report.json than the one beside it", file=evidence, key="kind")
        return [Input("diagnosis", path, path.name, document, shown)]
    if path.suffix.lower() == ".mcap":
        return [Input("run", path, path.stem, {})]
    if path.suffix.lower() == ".csv":
        return [Input("table", path, path.stem, {})]
    return of_document(read_document(path), path)


def read_document(path: Path) -> dict[str, Any]:
    """A JSON file with an object in it. Raises InputError."""
    try:
        if path.stat().st_size > MOST:
            raise InputError(
                f"got {path.stat().st_size / 2**20:.0f} MB, expected at most {MOST / 2**20:.0f}", file=path
            )
        text = path.read_bytes().decode()
    except (OSError, ValueError):
        raise InputError(filekinds.refused(path, KINDS), file=path) from None
    try:
        document = json.loads(text)
    except json.JSONDecodeError as problem:
        if filekinds.got(path) != "JSON":
            raise InputError(filekinds.refused(path, KINDS), file=path) from None
        raise InputError(f"is no JSON: {problem.msg}; expected {KINDS}", file=path, line=problem.lineno) from None
    except RecursionError:
        raise InputError(f"is nested too deeply; expected {KINDS}", file=path) from None
    if not isinstance(document, dict):
        raise InputError(f"got a {type(document).__name__}, expected {KINDS}", file=path)
    return document


def of_document(document: dict[str, Any], path: Path) -> list[Input]:
    """By what is in it."""
    if "results" in document:
        check_evaluation(document, path)
        return [Input("evaluation", path, path.stem, document)]
    if "verdict" in document:
        check_diagnosis(document, path)
        return [Input("diagnosis", path, path.stem, document)]
    if "rounds" in document:
        return _of_rounds(document, path)
    if document and all(key.startswith("ring") for key in document):
        check_comparison(document, path)
        return [Input("comparison", path, path.stem, document)]
    if "rings" in document and "success" in document:
        raise InputError("got the document of one run, expected its log (navigate --log FILE.mcap)", file=path)
    raise InputError(f"got JSON with {_keys(document)}, expected {KINDS}", file=path)


def _of_rounds(document: dict[str, Any], path: Path) -> list[Input]:
    found = []
    for i, entry in enumerate(_a(list, document, "rounds", path, "rounds")):
        key = f"rounds[{i}].diagnosis"
        done = _a(dict, _is(dict, entry, f"rounds[{i}]", path), "diagnosis", path, key)
        check_diagnosis(done, path, f"{key}.")
        navigation = entry.get("navigation")
        if navigation is not None:
            _check_navigation(_is(dict, navigation, f"rounds[{i}].navigation", path), f"rounds[{i}].navigation", path)
        found.append(Input("diagnosis", path, f"{path.stem}, round {i + 1}", {**done, "navigation": navigation}))
    if not found:
        raise InputError("got no rounds, expected one or more", file=path, key="rounds")
    return found


def _check_navigation(navigation: dict[str, Any], key: str, path: Path) -> None:
    for when in ("before", "after"):
        part = _a(dict, navigation, when, path, f"{key}.{when}")
        for name in ("runs", "success"):
            _a(int, part, name, path, f"{key}.{when}.{name}")
        for name, value in _a(dict, part, "time_s", path, f"{key}.{when}.time_s").items():
            if value is not None:
                _is(NUMBER, value, f"{key}.{when}.time_s.{name}", path)


def _keys(document: dict[str, Any]) -> str:
    names = [repr(key[:20]) for key in list(document)[:4]]
    return f"the keys {', '.join(names)}" if names else "nothing in it"


# -- what pictures rely on -----------------------------------------------------------------------------------------


def _is(kind: Any, value: Any, key: str, path: Path) -> Any:
    """The value, which must be of a kind; numbers must be finite. Raises InputError."""
    right = isinstance(value, kind) and (kind is bool or not isinstance(value, bool))
    if right and isinstance(value, float):
        right = math.isfinite(value)
    if not right:
        words = {dict: "an object", list: "a list", str: "text", bool: "true or false", int: "a whole number"}
        shown = json.dumps(value)[:40]
        raise InputError(f"got {shown}, expected {words.get(kind, 'a finite number')}", file=path, key=key)
    return value


def _a(kind: Any, document: dict[str, Any], name: str, path: Path, key: str) -> Any:
    if name not in document:
        raise InputError("is not there", file=path, key=key)
    return _is(kind, document[name], key, path)


NUMBER = (int, float)


def check_evaluation(document: dict[str, Any], path: Path) -> None:
    """Raises InputError at the first thing that is not as `evaluate --json` prints it."""
    results = _a(list, document, "results", path, "results")
    if not results:
        raise InputError("got no runs, expected one or more", file=path, key="results")
    for i, run in enumerate(results):
        key = f"results[{i}]"
        _is(dict, run, key, path)
        for name, kind in (("success", bool), ("reason", str), ("time_s", NUMBER), ("rings", list), ("failures", list)):
            _a(kind, run, name, path, f"{key}.{name}")
        for j, ring in enumerate(run["rings"]):
            _is(dict, ring, f"{key}.rings[{j}]", path)
            _a(int, ring, "ring", path, f"{key}.rings[{j}].ring")
            _a(NUMBER, ring, "time_s", path, f"{key}.rings[{j}].time_s")
        for j, failure in enumerate(run["failures"]):
            _is(dict, failure, f"{key}.failures[{j}]", path)
            _a(str, failure, "kind", path, f"{key}.failures[{j}].kind")
            for name in ("x", "y"):
                if failure.get(name) is not None:
                    _is(NUMBER, failure[name], f"{key}.failures[{j}].{name}", path)
        if run.get("start") is not None:
            start = _is(dict, run["start"], f"{key}.start", path)
            _a(NUMBER, start, "theta", path, f"{key}.start.theta")
    if document.get("setup") is not None:
        setup = _is(dict, document["setup"], "setup", path)
        for name in ("map", "rig", "model"):
            if name in setup:
                _is(str, setup[name], f"setup.{name}", path)
        for i, run in enumerate(_is(list, setup.get("changes", []), "setup.changes", path)):
            _is(int, run, f"setup.changes[{i}]", path)
    if document.get("learning") is not None:
        learning = _is(dict, document["learning"], "learning", path)
        for i, lesson in enumerate(_a(list, learning, "runs", path, "learning.runs")):
            key = f"learning.runs[{i}]"
            _is(dict, lesson, key, path)
            _a(int, lesson, "run", path, f"{key}.run")
            for name in ("error_m_s2", "fixed_error_m_s2"):
                if lesson.get(name) is not None:
                    _is(NUMBER, lesson[name], f"{key}.{name}", path)


def check_comparison(document: dict[str, Any], path: Path) -> None:
    """Raises InputError at the first thing that is not as `compare --json` prints it."""
    for ring, scores in document.items():
        _is(dict, scores, ring, path)
        if not ring.removeprefix("ring").isdecimal():
            raise InputError(f"got the key {ring[:20]!r}, expected ring1, ring2 ...", file=path)
        for name in ("nrmse_train", "nrmse_test"):
            for kind, value in _a(dict, scores, name, path, f"{ring}.{name}").items():
                if value is not None:
                    _is(NUMBER, value, f"{ring}.{name}.{kind}", path)
        for kind, errors in _a(dict, scores, "rollout", path, f"{ring}.rollout").items():
            _is(dict, errors, f"{ring}.rollout.{kind}", path)
            for step in ("20", "40"):
                _a(NUMBER, errors, step, path, f"{ring}.rollout.{kind}.{step}")
        for kind, curve in _is(dict, scores.get("curve", {}), f"{ring}.curve", path).items():
            _table(curve, 2, f"{ring}.curve.{kind}", path)
        for kind, bands in _is(dict, scores.get("bands", {}), f"{ring}.bands", path).items():
            _same_length(_is(dict, bands, f"{ring}.bands.{kind}", path), ("mean", "p10", "p90"), path, ring)
        if "residual" in scores:
            _check_residual(_is(dict, scores["residual"], f"{ring}.residual", path), f"{ring}.residual", path)


def _check_residual(found: dict[str, Any], key: str, path: Path) -> None:
    rows = len(_a(list, found, "rate", path, f"{key}.rate")) - 1
    count = _a(list, found, "count", path, f"{key}.count")
    columns = len(_is(list, count[0], f"{key}.count[0]", path)) if count else 0
    _table(count, columns, f"{key}.count", path, rows)
    for name in ("mean", "rms"):
        for kind, cells in _a(dict, found, name, path, f"{key}.{name}").items():
            _table(cells, columns, f"{key}.{name}.{kind}", path, rows)


def _table(cells: Any, columns: int, key: str, path: Path, rows: int | None = None) -> None:
    """Rows of numbers (null: not known), all as long. Raises InputError."""
    _is(list, cells, key, path)
    if rows is not None and len(cells) != rows:
        raise InputError(f"got {len(cells)} rows, expected {rows}", file=path, key=key)
    for i, row in enumerate(cells):
        if len(_is(list, row, f"{key}[{i}]", path)) != columns:
            raise InputError(f"got {len(row)} numbers, expected {columns}", file=path, key=f"{key}[{i}]")
        for value in row:
            if value is not None:
                _is(NUMBER, value, f"{key}[{i}]", path)


def _same_length(lists: dict[str, Any], names: tuple[str, ...], path: Path, key: str) -> None:
    """Lists of numbers, one for each name, all as long. Raises InputError."""
    lengths = set()
    for name in names:
        values = _a(list, lists, name, path, f"{key}.{name}")
        for value in values:
            if value is not None:
                _is(NUMBER, value, f"{key}.{name}", path)
        lengths.add(len(values))
    if len(lengths) > 1:
        raise InputError(f"got lists of {sorted(lengths)} numbers, expected as many in each", file=path, key=key)


def is_rig_document(document: dict[str, Any]) -> bool:
    """Whether a diagnosis is one of a whole rig."""
    return "reference" in document and "advice" in document


def check_diagnosis(document: dict[str, Any], path: Path, before: str = "") -> None:
    """Raises InputError at the first thing that is not as `diagnose --json` prints it."""
    _a(str, document, "verdict", path, f"{before}verdict")
    if is_rig_document(document):
        for name in ("sentence", "reference"):
            _a(str, document, name, path, f"{before}{name}")
        for i, text in enumerate(_a(list, document, "advice", path, f"{before}advice")):
            _is(str, text, f"{before}advice[{i}]", path)
        for name in ("before", "after"):
            _a(dict, document, name, path, f"{before}{name}")
    for name in ("before", "after"):
        for key, value in _is(dict, document.get(name, {}), f"{before}{name}", path).items():
            if value is not None:
                _is(NUMBER, value, f"{before}{name}.{key}", path)
    for i, effect in enumerate(_is(list, document.get("effects", []), f"{before}effects", path)):
        key = f"{before}effects[{i}]"
        _a(str, _is(dict, effect, key, path), "name", path, f"{key}.name")
        for name, parameter in _a(dict, effect, "parameters", path, f"{key}.parameters").items():
            _is(dict, parameter, f"{key}.parameters.{name}", path)
            _a(NUMBER, parameter, "value", path, f"{key}.parameters.{name}.value")
    for i, group in enumerate(_is(list, document.get("ambiguous_with", []), f"{before}ambiguous_with", path)):
        _is(list, group, f"{before}ambiguous_with[{i}]", path)
    for i, way in enumerate(_is(list, document.get("separate_by", []), f"{before}separate_by", path)):
        _is(dict, way, f"{before}separate_by[{i}]", path)


def _check_rig_evidence(document: dict[str, Any], path: Path) -> None:
    """The same of a whole rig."""
    for key in ("title", "map"):
        _a(str, document, key, path, key)
    for key in ("block_s", "white", "alike_from"):
        _a(NUMBER, document, key, path, key)
    count = len(_a(list, document, "ahead_s", path, "ahead_s"))
    _same_length(document, ("gain",), path, "gain")
    if document["gain"] and len(_a(list, document, "gain_t", path, "gain_t")) != len(document["gain"]):
        raise InputError(
            f"got {len(document['gain_t'])} times, expected {len(document['gain'])}", file=path, key="gain_t"
        )
    for key in ("error", "low", "quartile", "correlation"):
        part = _a(dict, document, key, path, key)
        _same_length(part, ("before", "after"), path, key)
        if key != "correlation" and len(part["before"]) != count:
            raise InputError(f"got {len(part['before'])} values, expected {count}", file=path, key=f"{key}.before")
    if document.get("spectrum") is not None:
        _same_length(_a(dict, document, "spectrum", path, "spectrum"), ("hz", "before", "after"), path, "spectrum")
    _check_places(_a(dict, document, "places", path, "places"), count, path)
    for i, mark in enumerate(_a(list, document, "marks", path, "marks")):
        names = ("x", "y", "width") if "x" in _is(dict, mark, f"marks[{i}]", path) else ("centre", "inner", "outer")
        for name in names:
            _a(NUMBER, mark, name, path, f"marks[{i}].{name}")


def _check_places(places: dict[str, Any], count: int, path: Path) -> None:
    """The map of errors: a row of sectors for each ring."""
    ahead = _a(NUMBER, places, "ahead", path, "places.ahead")
    if not (isinstance(ahead, int) and 1 <= ahead <= count):
        raise InputError(f"got {ahead}, expected a number of samples from 1 to {count}", file=path, key="places.ahead")
    rings = _a(list, places, "rings", path, "places.rings")
    _table(rings, 2, "places.rings", path)
    for when in ("before", "after"):
        rows = _a(list, places, when, path, f"places.{when}")
        columns = len(_is(list, rows[0], f"places.{when}[0]", path)) if rows else 0
        _table(rows, columns, f"places.{when}", path, rows=len(rings))


def check_evidence(document: dict[str, Any], path: Path) -> None:
    """Raises InputError at the first thing that is not as `diagnose -o` writes it."""
    if document.get("kind") == "rig":
        _check_rig_evidence(document, path)
        return
    for i, entry in enumerate(_a(list, document, "candidates", path, "candidates")):
        _a(str, _is(dict, entry, f"candidates[{i}]", path), "name", path, f"candidates[{i}].name")
        _a(NUMBER, entry, "gain", path, f"candidates[{i}].gain")
    _a(list, document, "axes", path, "axes")
    for when in ("before", "after"):
        part = _a(dict, document, when, path, when)
        _same_length({"correlations": _a(list, part, "correlations", path, when)}, ("correlations",), path, when)
        _a(NUMBER, part, "white", path, f"{when}.white")
        for name in ("position", "speed", "time"):
            _same_length(_a(dict, part, name, path, f"{when}.{name}"), ("at", "mean", "stderr"), path, f"{when}.{name}")
        _same_length(_a(dict, part, "spectrum", path, when), ("hz", "highest", "mean"), path, f"{when}.spectrum")
