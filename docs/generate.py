"""Writes the pages that are made from the program: functions.md, commands/*.md and made/*.md.

The first of them is kept in the repository, for those who read it there: python docs/generate.py"""

from __future__ import annotations

import inspect
import json
import math
from collections.abc import Callable, Iterable, Iterator
from itertools import groupby
from pathlib import Path
from typing import Any

LONGEST = 60  # maximum number of characters of a formula in a table
FUNCTIONS = ("navigate", "evaluate", "collect", "learn", "compare", "diagnose", "improve", "load_map", "check_rig")


def pages(folder: Path) -> None:
    """Write all pages into the folder of the documentation; a page that has not changed stays untouched."""
    texts = {f"commands/{name}.md": text for name, text in commands()}
    texts |= {
        "functions.md": functions(),
        "made/figures.md": figures(folder / "history.json"),
        "made/effects.md": effects(),
        "made/faults.md": faults(),
        "made/nodes.md": nodes(),
    }
    for name, lines in texts.items():
        page, text = folder / name, "\n".join(lines) + "\n"
        page.parent.mkdir(exist_ok=True)
        if not page.exists() or page.read_text(encoding="utf-8") != text:
            page.write_text(text, encoding="utf-8")


def table(columns: Iterable[str], rows: Iterable[Iterable[object]]) -> Iterator[str]:
    """Lines of a table."""
    columns = list(columns)
    yield f"| {' | '.join(columns)} |"
    yield "|---" * len(columns) + "|"
    for row in rows:
        yield f"| {' | '.join(str(cell).replace('|', chr(92) + '|') for cell in row)} |"
    yield ""


def commands() -> Iterator[tuple[str, list[str]]]:
    """Name and page of each command, from the program's own help."""
    from typer.main import get_command

    from mazeplan.apps.cli.app import app

    group: Any = get_command(app)  # typer promises a command; with several of them it is a group
    for name, command in group.commands.items():
        yield name, list(_command(f"mazeplan {name}", command, 1))


def _command(path: str, command: Any, level: int) -> Iterator[str]:
    """A command's heading, what it does, its parameters, and its own commands."""
    yield from (f"{'#' * level} {path}", "", *(command.help or "").splitlines(), "")
    if getattr(command, "commands", None):
        for name, inner in command.commands.items():
            yield from _command(f"{path} {name}", inner, 2)
        return
    rows = []
    for parameter in command.params:
        names = ", ".join(f"`{name}`" for name in (*parameter.opts, *parameter.secondary_opts))
        default = parameter.default
        shown = "" if default is None or callable(default) or default is False or default == () else f"`{default}`"
        rows.append((names, shown, (getattr(parameter, "help", None) or "").replace("<", "&lt;")))
    yield from table(("parameter", "default", "meaning"), rows)


def functions() -> Iterator[str]:
    """Signature and docstring of each function for Python programs."""
    import mazeplan

    yield from ("# Functions", "", "Made from the program. How to use them: [from Python](python.md).", "")
    for name in FUNCTIONS:
        function = getattr(mazeplan, name)
        signature, stars = inspect.signature(function), False
        yield from (f"## mazeplan.{name}", "", "```text", f"{name}(")
        for parameter in signature.parameters.values():
            if parameter.kind is parameter.KEYWORD_ONLY and not stars:
                yield "    *,"
                stars = True
            yield f"    {_argument(parameter)},"
        yield from (f") -> {signature.return_annotation}", "")
        yield from (*(inspect.getdoc(function) or "").splitlines(), "```", "")


def _argument(parameter: inspect.Parameter) -> str:
    """Name, type and default."""
    default: Callable[..., object] | object = parameter.default
    if default is parameter.empty:
        return f"{parameter.name}: {parameter.annotation}"
    shown = getattr(default, "__name__", None) or repr(default)
    return f"{parameter.name}: {parameter.annotation} = {shown}"


def figures(path: Path) -> Iterator[str]:
    """All figures of history.json."""
    yield from ("# All figures", "", "From docs/history.json, which `tools/bench.py` writes.", "")
    for section in json.loads(path.read_text(encoding="utf-8")).values():
        gone = " The program of this section has left." if section.get("gone") else ""
        how = f"{section['date']}, `{section['command']}`, {section['machine']}.{gone}"
        yield from (f"## {section['title']}", "", how, "", "\n\n".join(section["notes"]), "")
        for each in section["tables"]:
            yield from (each["caption"], "", *table(each["columns"], each["rows"]))


def effects() -> Iterator[str]:
    """The table of all effects; parameters with the same unit stand together: `cos1 .. sin3 (rad/s^2)`."""
    from mazeplan.physics.effect import BALL
    from mazeplan.physics.formulas.equation import text
    from mazeplan.physics.registry import EFFECTS

    yield from ("# All effects", "", "How a model uses them: [physical effects](../effects.md).", "")
    rows = []
    for effect in (effect for effect in EFFECTS.values() if effect.named):
        units = []
        for unit, items in groupby(effect.parameters.items(), key=lambda item: item[1].unit):
            names = [name for name, _ in items]
            units.append(f"{', '.join(names) if len(names) < 5 else f'{names[0]} .. {names[-1]}'} ({unit})")
        formula = text(effect)
        shown = f" `{formula}`" if formula and len(formula) <= LONGEST else ""
        planned = "yes" if effect.planned else f"no: {effect.why_not}"
        acts = "ball" if effect.acts in BALL else effect.acts
        rows.append((effect.name, acts, ", ".join(units), f"{effect.text}{shown} ({effect.source})", planned))
    yield from table(("name", "acts on", "parameters (unit)", "what, where from", "planned"), rows)


def faults() -> Iterator[str]:
    """Kinds of faults that can be injected."""
    from mazeplan.rigs.faults.kinds import KINDS

    def span(pair: tuple[float, float]) -> str:
        if math.isinf(pair[0]):
            return "for good"
        if pair == (0.0, 0.0):
            return "at once"
        return f"{pair[0]:g}" if pair[0] == pair[1] else f"{pair[0]:g} to {pair[1]:g}"

    yield from ("# Kinds of faults", "", "How to inject them: [fault injection](../faults.md).", "")
    yield from table(
        ("kind", "where", "what", "for s", "size", "can be survived"),
        (
            (
                f"`{name}`", kind.place, kind.what, span(kind.duration_s),
                "" if kind.size is None else f"{span(kind.size)} {kind.unit}",
                f"no: {kind.because}" if kind.because else "yes",
            )
            for name, kind in KINDS.items()
        ),
    )  # fmt: skip


def nodes() -> Iterator[str]:
    """Nodes of behaviour trees that the format has."""
    from mazeplan.btree.controls import CONTROLS
    from mazeplan.btree.decorators import DECORATORS
    from mazeplan.btree.leaf import BUILTIN_LEAVES

    yield from ("# All nodes of the format", "", "Attributes, scripts and differences: [nodes](../tree-nodes.md).", "")
    groups = {"Control nodes": CONTROLS, "Decorators": DECORATORS, "Leaves of the format": BUILTIN_LEAVES}
    for title, group in groups.items():
        yield from (f"## {title}", "")
        rows = []
        for name, kind in group.items():
            ports = ", ".join(f"`{port}`" for port in kind.ports)
            rows.append((f"`{name}`", " ".join((kind.__doc__ or "").split("\n\n")[0].split()), ports))
        yield from table(("node", "what it does", "ports"), rows)


if __name__ == "__main__":
    (Path(__file__).parent / "functions.md").write_text("\n".join(functions()) + "\n", encoding="utf-8")
