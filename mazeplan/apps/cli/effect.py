"""`effect list` and `effect show`: the effects of the registry."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import typer

from mazeplan.apps.cli import options as opt
from mazeplan.apps.cli.output import print_json
from mazeplan.core.errors import InputError, one_of

if TYPE_CHECKING:
    from mazeplan.physics.effect import Effect

app = typer.Typer(help="List and show physical effects of models and diagnoses.", no_args_is_help=True)

EffectName = Annotated[str, typer.Argument(metavar="EFFECT", help="Name of an effect (see `effect list`).")]


@app.command("list")
def list_effects(effects: opt.EffectModule = None, as_json: opt.AsJson = False) -> None:
    """List all effects: what each acts on, its meaning, and whether plans use it."""
    from mazeplan.physics.registry import document

    found = _known(effects)
    if as_json:
        print_json([document(effect) for effect in found.values()])
    else:
        width = max(map(len, found))
        for effect in found.values():
            note = "" if effect.planned else f" (not planned with: {effect.why_not})"
            print(f"{effect.name:{width}s}  {_acts_on(effect):13s} {effect.text}{note}")


@app.command("show")
def show(name: EffectName, effects: opt.EffectModule = None, as_json: opt.AsJson = False) -> None:
    """Show an effect: formula, source, parameters with unit and bounds, and its entry in a model."""
    from mazeplan.physics.registry import document

    effect = (found := _known(effects)).get(name)
    if effect is None:
        raise InputError(f"got effect {name!r}, expected {one_of(found, name)}")
    if as_json:
        print_json({**document(effect), "text": effect.text, "source": effect.source})
        return
    print(f"{name}: {effect.text}\nacts on    {_acts_on(effect)}\nformula    {document(effect)['formula']}")
    print(f"source     {effect.source}\nplanned    {'yes' if effect.planned else f'no: {effect.why_not}'}")
    print("parameters (unit; value without the effect; bounds; smallest relevant size):")
    width = max(map(len, effect.parameters))
    for key, p in effect.parameters.items():
        size, words = f"; {p.smallest:g}" if p.smallest > 0.0 else "", f"; {p.words}" if p.words else ""
        print(f"  {key:{width}s}  {p.unit}; {p.default:g}; {p.low:g} to {p.high:g}{size}{words}")
    print("in model.yaml" + "".join(f"\n  {line}" for line in _entry(effect)))


def _known(spec: str | None) -> dict[str, Effect]:
    """Effects by name: of mazeplan, and of a user's module."""
    from mazeplan.physics.registry import EFFECTS, own_effects

    own_effects(spec)
    return {name: effect for name, effect in EFFECTS.items() if effect.named}


def _acts_on(effect: Effect) -> str:
    from mazeplan.physics.effect import BALL

    return "ball" if effect.acts in BALL else effect.acts


def _entry(effect: Effect) -> list[str]:
    """The lines of a model file that hold the effect."""
    if effect.entry:
        return [f"{place}: {key}" for key, place in effect.entry.items()]
    values = ", ".join(f"{key}: {p.default:g}" for key, p in effect.parameters.items())
    return ["rings:", "  1:", "    effects:", f"    - {{type: {effect.name}, {values}}}"]
