"""`effect list`, `effect show`: what can be named, as the registry has it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import typer

from mazeplan.cli.arguments import EffectModule
from mazeplan.cli.output import print_json

if TYPE_CHECKING:
    from mazeplan.physics.effect import Effect, Parameter

app = typer.Typer(help="Physical effects: what a model can have and a diagnosis can name.", no_args_is_help=True)
SHORT = 60  # letters of a formula that stands in a table


@app.command("list")
def list_effects(
    effects: EffectModule = None,
    markdown: Annotated[bool, typer.Option("--markdown", help="Print the table of the documentation.")] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON document on stdout.")] = False,
) -> None:
    """All effects: where each acts, what it is, and whether a plan can use it."""
    from mazeplan.physics.registry import document

    found = _known(effects)
    if as_json:
        print_json([document(effect) for effect in found.values()])
        return
    if markdown:
        print("\n".join(table(list(found.values()))))
        return
    width = max(map(len, found))
    for effect in found.values():
        note = "" if effect.planned else f" (not planned with: {effect.why_not})"
        print(f"{effect.name:{width}s}  {_where(effect):13s} {effect.text}{note}")


@app.command("show")
def show(
    name: Annotated[str, typer.Argument(help="Name of an effect (effect list).")],
    effects: EffectModule = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON document on stdout.")] = False,
) -> None:
    """One effect: formula, source, parameters with unit and bounds, and how to write it into a model."""
    from mazeplan.errors import InputError
    from mazeplan.physics.registry import document

    found = _known(effects)
    if name not in found:
        raise InputError(f"got effect {name!r}, expected one of {', '.join(found)}")
    effect = found[name]
    told = document(effect)
    if as_json:
        print_json({**told, "text": effect.text, "source": effect.source})
        return
    print(f"{name}: {effect.text}")
    print(f"acts on    {_where(effect)}")
    print(f"formula    {told['formula']}")
    print(f"source     {effect.source}")
    print(f"planned    {'yes' if effect.planned else f'no: {effect.why_not}'}")
    print("parameters (unit; without the effect; bounds; smallest size worth a word):")
    width = max(map(len, effect.parameters))
    for key, p in effect.parameters.items():
        print(f"  {key:{width}s}  {_row(p)}")
    print("in model.yaml" + "".join(f"\n  {line}" for line in _entry(effect)))


def table(effects: list[Effect]) -> list[str]:
    """Lines of the table in docs/effects.md."""
    rows = ["| name | acts on | parameters (unit) | what, where from | planned |", "|---|---|---|---|---|"]
    for effect in effects:
        from mazeplan.physics.equation import text

        formula = text(effect)
        shown = f" `{formula}`" if formula and len(formula) <= SHORT else ""
        planned = "yes" if effect.planned else f"no: {effect.why_not}"
        what = f"{effect.text}{shown} ({effect.source})"
        rows.append(f"| {effect.name} | {_where(effect)} | {_units(effect)} | {what} | {planned} |")
    return rows


def _known(spec: str | None) -> dict[str, Effect]:
    """Effects by name: of the package, of installed packages, and of a user's module."""
    from mazeplan.cli.owneffects import installed_effects
    from mazeplan.physics.registry import EFFECTS, own_effects

    installed_effects()
    own_effects(spec)
    return {name: effect for name, effect in EFFECTS.items() if effect.named}


def _where(effect: Effect) -> str:
    from mazeplan.physics.effect import BALL

    return "ball" if effect.acts in BALL else effect.acts


def _units(effect: Effect) -> str:
    """`cos1 .. sin3 (rad/s^2)`: parameters that share a unit stand together."""
    groups: list[tuple[str, list[str]]] = []
    for name, p in effect.parameters.items():
        if groups and groups[-1][0] == p.unit:
            groups[-1][1].append(name)
        else:
            groups.append((p.unit, [name]))
    shown = [(unit, names if len(names) < 5 else [f"{names[0]} .. {names[-1]}"]) for unit, names in groups]
    return ", ".join(f"{', '.join(names)} ({unit})" for unit, names in shown)


def _row(p: Parameter) -> str:
    size = f"; {p.smallest:g}" if p.smallest > 0.0 else ""
    words = f"; {p.words}" if p.words else ""
    return f"{p.unit}; {p.default:g}; {p.low:g} to {p.high:g}{size}{words}"


def _entry(effect: Effect) -> list[str]:
    """How it stands in a model file."""
    if effect.entry:
        return [f"{place}: {key}" for key, place in effect.entry.items()]
    values = ", ".join(f"{key}: {p.default:g}" for key, p in effect.parameters.items())
    return ["rings:", "  1:", "    effects:", f"    - {{type: {effect.name}, {values}}}"]
