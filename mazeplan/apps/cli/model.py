"""Models and effects, list and show; `score`: how well a model predicts a log; `compare`: kinds of models."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any

import typer

from mazeplan.apps.cli import options as opt
from mazeplan.apps.cli.output import print_result, say
from mazeplan.apps.cli.progress import ProgressBar
from mazeplan.core.errors import InputError, one_of

if TYPE_CHECKING:
    from mazeplan.learning.rig_model import RigModel
    from mazeplan.physics.effect import Effect


app = typer.Typer(help="List and show models of rigs.", no_args_is_help=True)
effect_app = typer.Typer(help="List and show physical effects of models and diagnoses.", no_args_is_help=True)
KINDS = {
    "p": "nominal physics",
    "pi": "fitted effects",
    "sp": "fitted effects, and a Gaussian process for the rest",
    "np": "a Gaussian process alone",
}
CELL = 20  # characters of a number with its standard error
ModelArgument = Annotated[str, typer.Argument(metavar="MODEL", help="Folder of a model, or name of a packaged one.")]
EffectName = Annotated[str, typer.Argument(metavar="EFFECT", help="Name of an effect (see `effect list`).")]


@app.command("list")
def list_models(as_json: opt.AsJson = False) -> None:
    """List the packaged models: kind, rings and delay of the camera."""
    from mazeplan.learning.modelfile import load_model, model_names

    found = {name: load_model(name) for name in model_names()}
    document = [{"name": name, **_summary(model)} for name, model in found.items()]
    print_result(as_json, document, *(f"{name:10s}  {_sentence(model)}" for name, model in found.items()))


@app.command("show")
def show(name: ModelArgument, as_json: opt.AsJson = False) -> None:
    """Show a model: plate, camera, and the effects on the ball in each ring, with standard errors and units."""
    from mazeplan.learning.modelfile import load_model, model_document

    model = load_model(name)
    lines = [f"{name}: {_sentence(model)}", *model_lines(model)]
    lines += ["fitted on: " + ", ".join(f"{key} {value}" for key, value in entry.items()) for entry in model.data]
    print_result(as_json, {**model_document(model), **_summary(model)}, *lines)


def model_lines(model: RigModel) -> list[str]:
    """Plate, camera and effects in each ring, with standard errors and units."""
    from mazeplan.learning.modelfile import model_document
    from mazeplan.learning.rigid_body_entries import PARAMETERS

    document, lines = model_document(model), list[str]()
    body = document.get("body", {})
    body.pop("of", None)  # a stamp, for programs
    for key in ("camera_delay_s", "stage", "camera", "tilt_sensor", "rings"):
        if key in document:
            lines += _ring_lines(document[key]) if key == "rings" else _lines(key, document[key], "")
    lines += ["body (a rigid ball; forces by its mass: its spin makes accelerations smaller):"] if body else []
    words = {name: parameter.words for name, parameter in PARAMETERS.items()}
    words["delay"] = "camera, beyond camera_delay_s"
    for name, value in body.items():
        lines += [f"{line:48s}{words.get(name, '')}".rstrip() for line in _lines(name, value, "  ")]
    return lines + [f"learned part of ring {n}: {len(part)} rows" for n, part in sorted(model.processes.items())]


def _summary(model: RigModel) -> dict[str, Any]:
    return {"kind": model.kind, "rings_fitted": sorted(model.balls), "what": KINDS[model.kind],
            "process_rows": {ring: len(process) for ring, process in sorted(model.processes.items())}}  # fmt: skip


def _sentence(model: RigModel) -> str:
    late = f"the camera's picture is {1e3 * model.camera_delay:.0f} ms old"
    return f"kind {model.kind}: {KINDS[model.kind]}; rings {', '.join(map(str, sorted(model.balls)))}; {late}"


def _ring_lines(rings: dict[int, dict[str, Any]]) -> list[str]:
    """A line for each number of the rings' effects that is not 0 everywhere, with its values from ring to ring."""
    numbers: dict[str, dict[int, dict[str, Any]]] = {}
    for ring, effects in rings.items():
        for effect, parts in effects.items():
            for name, number in parts.items():
                numbers.setdefault(f"{effect}.{name}", {})[ring] = number
    kept = {name: row for name, row in numbers.items() if any(number["value"] for number in row.values())}
    first = max(map(len, kept), default=0) + 2
    lines = [f"{'rings:':{first + 2}s}" + "".join(f"{ring:<{CELL}}" for ring in rings).rstrip()]
    for name, row in kept.items():
        unit = next(iter(row.values()))["unit"]
        cells = "".join(f"{_value(row[ring], '.4g', '.2g') if ring in row else '':{CELL}s}" for ring in rings)
        lines.append(f"  {name:{first}s}{cells}{unit if unit != '1' else ''}".rstrip())
    return lines


def _value(number: dict[str, Any], as_value: str = "g", as_error: str = "g") -> str:
    """A number with its standard error."""
    error = f" ± {number['stderr']:{as_error}}" if "stderr" in number else ""
    return f"{number['value']:{as_value}}{error}"


def _lines(key: Any, value: Any, indent: str) -> list[str]:
    """Lines for a key of model.yaml and all keys below it, with ± for the standard error."""
    if not isinstance(value, dict):
        return [f"{indent}{key}: {value}"]
    if "value" in value:
        unit = "" if value["unit"] == "1" else f" {value['unit']}"
        return [f"{indent}{key}: {_value(value)}{unit}"]
    return [f"{indent}{key}:", *(line for name, part in value.items() for line in _lines(name, part, f"{indent}  "))]


def score(
    model: ModelArgument, logs: opt.Logs, map_: opt.MapOfLog = None, columns: opt.Columns = None,
    as_json: opt.AsJson = False,
) -> None:  # fmt: skip
    """Judge how well a model predicts logs: its error of theta after 40 samples, beside no model and the noise."""
    from mazeplan.apps.report.models import score_section
    from mazeplan.apps.report.page import section_text
    from mazeplan.core.logs.columns import parse_columns
    from mazeplan.core.logs.table import read_table
    from mazeplan.learning.model_score import learned_from, ring_errors, score_document
    from mazeplan.learning.modelfile import load_model
    from mazeplan.learning.rig_model import fits_words
    from mazeplan.run.commands.log_context import logged_map

    found, maze = load_model(model), logged_map(map_, *logs).maze
    with ProgressBar("scoring") as bar:
        bar.show("reading")
        tables = [read_table(log, parse_columns(columns or [])) for log in logs]
        bar.show("rolling out")
        document = score_document(
            ring_errors(found, tables, maze), model, str(logs[0]), [r.number for r in maze.rings[:-1]]
        )
    document["learned_from"] = learned_from(found, logs)
    document["fits"] = found.scores.get("fits")
    if words := fits_words(found):
        say(words)
    if document["learned_from"]:
        say(f"the model was learned from {', '.join(document['learned_from'])}: on new logs it may be worse")
    print_result(as_json, document, section_text(score_section(model, document)))


def compare(
    logs: opt.Logs,
    test: opt.TestLogs = None,
    map_: opt.MapOfLog = None,
    columns: opt.Columns = None,
    ring: opt.Ring = None,
    radius: opt.Radius = None,
    kinds: opt.CompareKinds = "rf,p,pi,np,sp",
    most: opt.Most = 5000,
    page: opt.Report = None,
    seed: opt.Seed = 0,
    force: opt.Force = False,
    as_json: opt.AsJson = False,
) -> None:
    """Compare kinds of ball models in each ring: nRMSE of theta_dd and roll-out errors."""
    from mazeplan.apps.report.inputs import Input
    from mazeplan.apps.report.models import models_section
    from mazeplan.apps.report.page import section_text
    from mazeplan.run.commands.compare import compare as score

    with ProgressBar("comparing") as bar:
        done = score(
            logs, test=test, map=map_, columns=columns or [], ring=ring, radius=radius, kinds=kinds, most=most,
            seed=seed, progress=bar.show, advance=bar.advance, say=say,
        )  # fmt: skip
    name = ", ".join(log.name for log in logs)
    print_result(
        as_json, done.document, section_text(models_section(Input("comparison", logs[0], name, done.document)))
    )
    if page is not None:  # comes last: a file that cannot be written loses no result
        say(f"wrote {done.report(page)}")


@effect_app.command("list")
def list_effects(effects: opt.EffectModule = None, as_json: opt.AsJson = False) -> None:
    """List all effects: what each acts on, its meaning, and whether plans use it."""
    from mazeplan.physics.registry import document

    found = _known(effects)
    width, lines = max(map(len, found)), list[str]()
    for effect in found.values():
        note = "" if effect.planned else f" (not planned with: {effect.why_not})"
        lines.append(f"{effect.name:{width}s}  {_acts_on(effect):13s} {effect.text}{note}")
    print_result(as_json, [document(effect) for effect in found.values()], *lines)


@effect_app.command("show")
def show_effect(name: EffectName, effects: opt.EffectModule = None, as_json: opt.AsJson = False) -> None:
    """Show an effect: formula, source, parameters with unit and bounds, and its entry in a model."""
    from mazeplan.physics.registry import document

    effect = (found := _known(effects)).get(name)
    if effect is None:
        raise InputError(f"got effect {name!r}, expected {one_of(found, name)}")
    known, width = document(effect), max(map(len, effect.parameters))
    lines = [
        f"{name}: {effect.text}",
        f"acts on    {_acts_on(effect)}",
        f"formula    {known['formula']}",
        f"source     {effect.source}",
        f"planned    {'yes' if effect.planned else f'no: {effect.why_not}'}",
        "parameters (unit; value without the effect; bounds; smallest relevant size):",
    ]
    for key, p in effect.parameters.items():
        size, words = f"; {p.smallest:g}" if p.smallest > 0.0 else "", f"; {p.words}" if p.words else ""
        lines.append(f"  {key:{width}s}  {p.unit}; {p.default:g}; {p.low:g} to {p.high:g}{size}{words}")
    lines += ["in model.yaml", *(f"  {line}" for line in _entry(effect))]
    print_result(as_json, {**known, "text": effect.text, "source": effect.source}, *lines)


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
