"""`model list` and `model show`: the contents of a model of a rig."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any

import typer

from mazeplan.apps.cli import options as opt
from mazeplan.apps.cli.output import print_json

if TYPE_CHECKING:
    from mazeplan.learning.rig_model import RigModel

app = typer.Typer(help="List and show models of rigs.", no_args_is_help=True)
KINDS = {
    "p": "nominal physics",
    "pi": "fitted effects",
    "sp": "fitted effects, and a Gaussian process for the rest",
    "np": "a Gaussian process alone",
}
ModelArgument = Annotated[str, typer.Argument(metavar="MODEL", help="Folder of a model, or name of a packaged one.")]


@app.command("list")
def list_models(as_json: opt.AsJson = False) -> None:
    """List the packaged models: kind, rings and delay of the camera."""
    from mazeplan.learning.modelfile import load_model, model_names

    found = {name: load_model(name) for name in model_names()}
    if as_json:
        print_json([{"name": name, **_summary(model)} for name, model in found.items()])
        return
    width = max(map(len, found))
    for name, model in found.items():
        print(f"{name:{width}s}  {_sentence(model)}")


@app.command("show")
def show(name: ModelArgument, as_json: opt.AsJson = False) -> None:
    """Show a model: plate, camera, and the effects on the ball in each ring, with standard errors and units."""
    from mazeplan.learning.modelfile import load_model, model_document

    model = load_model(name)
    if as_json:
        print_json({**model_document(model), **_summary(model)})
        return
    document = model_document(model)
    print(f"{name}: {_sentence(model)}")
    for key in ("camera_delay_s", "stage", "camera", "tilt_sensor", "rings", "body"):
        if key in document:
            print("\n".join(_lines(key, document[key], "")))
    for ring, process in sorted(model.processes.items()):
        print(f"learned part of ring {ring}: {len(process)} rows")
    for entry in model.data:
        print("fitted on: " + ", ".join(f"{key} {value}" for key, value in entry.items()))


def _summary(model: RigModel) -> dict[str, Any]:
    return {"kind": model.kind, "rings_fitted": sorted(model.balls), "what": KINDS[model.kind],
            "process_rows": {ring: len(process) for ring, process in sorted(model.processes.items())}}  # fmt: skip


def _sentence(model: RigModel) -> str:
    rings = ", ".join(map(str, sorted(model.balls)))
    late = f"the camera's picture is {1e3 * model.camera_delay:.0f} ms old"
    return f"kind {model.kind}: {KINDS[model.kind]}; rings {rings}; {late}"


def _lines(key: Any, value: Any, indent: str) -> list[str]:
    """Lines for a key of model.yaml and all keys below it, with ± for the standard error."""
    if not isinstance(value, dict):
        return [f"{indent}{key}: {value}"]
    if "value" in value:
        error = f" ± {value['stderr']:g}" if "stderr" in value else ""
        unit = "" if value["unit"] == "1" else f" {value['unit']}"
        return [f"{indent}{key}: {value['value']:g}{error}{unit}"]
    title = f"ring {key}" if isinstance(key, int) else key
    inner = [line for name, part in value.items() for line in _lines(name, part, f"{indent}  ")]
    return [f"{indent}{title}:", *inner]
