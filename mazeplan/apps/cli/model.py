"""`model list` and `show`; `score`: how well a model predicts a log; `compare`: kinds of models on the same data."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Annotated, Any

import typer

from mazeplan.apps.cli import options as opt
from mazeplan.apps.cli.output import plural, print_json, say

if TYPE_CHECKING:
    from mazeplan.learning.rig_model import RigModel
    from mazeplan.learning.ring_scores import RingScores


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
    from mazeplan.learning.model_document import model_document
    from mazeplan.learning.modelfile import load_model

    model = load_model(name)
    if as_json:
        print_json({**model_document(model), **_summary(model)})
        return
    print("\n".join([f"{name}: {_sentence(model)}", *model_lines(model)]))
    for entry in model.data:
        print("fitted on: " + ", ".join(f"{key} {value}" for key, value in entry.items()))


def model_lines(model: RigModel) -> list[str]:
    """Plate, camera and effects in each ring, with standard errors and units."""
    from mazeplan.learning.model_document import model_document

    document, lines = model_document(model), list[str]()
    for key in ("camera_delay_s", "stage", "camera", "tilt_sensor", "rings", "body"):
        if key in document:
            lines += _lines(key, document[key], "")
    return lines + [f"learned part of ring {n}: {len(part)} rows" for n, part in sorted(model.processes.items())]


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


def score(
    model: ModelArgument, logs: opt.Logs, map_: opt.MapOfLog = None, columns: opt.Columns = None,
    as_json: opt.AsJson = False,
) -> None:  # fmt: skip
    """Judge how well a model predicts logs: its error of theta after 40 samples, beside no model and the noise."""
    from mazeplan.apps.cli.progress import ProgressBar
    from mazeplan.core.logs.column_units import parse_columns
    from mazeplan.core.logs.table import read_table
    from mazeplan.learning.fits import fits_words
    from mazeplan.learning.model_score import learned_from, ring_errors, score_document
    from mazeplan.learning.modelfile import load_model
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
    if as_json:
        print_json(document)
    else:
        print("\n".join(score_lines(document)))


def score_lines(document: dict[str, Any]) -> list[str]:
    """A table of the rings, and the verdict."""
    from mazeplan.apps.report.words import verdict_lines

    lines = ["mean absolute error of theta after 40 samples, rad", "ring  windows   model  without  noise  verdict"]
    lines += [
        f"{ring:>4s}  {r['windows']:7d}  {r['error']:6.3f}  {r['persistence']:7.3f}  {r['noise']:5.3f}  {r['verdict']}"
        for ring, r in document["rings"].items()
    ]
    return [*lines, *verdict_lines(document)]


def compare(
    logs: opt.Logs,
    test: opt.TestLogs = None,
    map_: opt.MapOfLog = None,
    columns: opt.Columns = None,
    ring: opt.Ring = None,
    radius: opt.Radius = None,
    kinds: opt.CompareKinds = "rf,p,pi,np,sp",
    most: opt.CompareRows = 5000,
    page: opt.Report = None,
    seed: opt.Seed = 0,
    force: opt.Force = False,
    as_json: opt.AsJson = False,
) -> None:
    """Compare kinds of ball models in each ring: nRMSE of theta_dd and roll-out errors."""
    from mazeplan.core.logs.table import check_there

    for log in (*logs, *(test or ())):
        check_there(log)
    from mazeplan.apps.cli.progress import ProgressBar
    from mazeplan.apps.cli.report import write_report
    from mazeplan.run.commands.compare import compare as score

    with ProgressBar("comparing") as bar:
        done = score(
            logs, test=test, map=map_, columns=columns or [], ring=ring, radius=radius, kinds=kinds, most=most,
            seed=seed, progress=bar.show, advance=bar.advance, say=say,
        )  # fmt: skip
    document, scores = done.document, done.scores
    if as_json:
        print_json(document)
    else:
        report(scores)
    # the files come last: one that cannot be written loses no result
    if page is not None:
        write_report("comparison", document, page, ", ".join(log.name for log in logs))


def report(scores: Sequence[RingScores]) -> None:
    """Print the tables. If there are too few windows or blocks of time for an interval, print this instead."""
    from mazeplan.learning.split import TOO_FEW, enough

    kinds = list(scores[0].nrmse_test)
    print(f"{'nRMSE of theta_dd':24s}" + "".join(f"{kind:>16s}" for kind in kinds))
    for s in scores:
        cells = "".join(f"{s.nrmse_train[kind]:8.3f}/{s.nrmse_test[kind]:.3f}  " for kind in kinds)
        print(f"ring {s.ring} train/test          {cells}")
        low = "".join(f"   [{a:.3f}, {b:.3f}]" for a, b in (s.interval["nrmse_test"][kind] for kind in kinds))
        few = f"   {TOO_FEW}: {plural(s.blocks['test'], 'block')} of time"
        print(f"   95 % of the test      {low if enough(blocks=s.blocks['test']) else few}")
    print("\nmean absolute error of theta after 20 / 40 samples, degrees (± half of the 95 % interval)")
    for s in scores:
        if not len(s.windows):
            print(f"ring {s.ring}  0 windows: no stretch of test rows is long enough")
            continue
        cells = "".join(f"  {kind} {_error(s, kind, '20')}/{_error(s, kind, '40')}" for kind in s.rollout)
        few = "" if _enough(s) else f" in {plural(s.blocks['windows'], 'block')} of time ({TOO_FEW} for ±)"
        print(f"ring {s.ring}  {plural(len(s.windows), 'window')}{few}, {s.windows.chosen}: {cells}")
    for s in scores:
        if s.best is not None:
            print(f"ring {s.ring}  {verdict(s)}")
    for index, name in enumerate(("beta", "gamma")):
        if any(s.signs[index] < 0 for s in scores):
            print(
                f"note: these data count {name} the other way round (gravity would pull uphill); its sign was changed"
            )
    off = [f"ring {s.ring} {1e3 * s.centre[0]:.1f}, {1e3 * s.centre[1]:.1f}" for s in scores if any(s.centre)]
    if off:
        print(f"note: the camera counts the angle about another point than the rings' centre, in mm: {'; '.join(off)}")
    print(f"rates: {scores[0].rates}; ball {1e3 * scores[0].delay:.0f} ms behind the tilt")
    print(f"training rows: {', '.join(str(s.n_train) for s in scores)}")


def verdict(s: RingScores) -> str:
    """A sentence on the kind that predicts best after 40 samples: by how much, and how certain the difference is."""
    from mazeplan.learning.split import TOO_FEW

    best = s.best
    if best is None:
        return "no two kinds to compare"
    less, low, high = (math.degrees(value) for value in (best.less, *best.interval))
    led = f"{less:.2f} degrees less error after 40 samples than {best.next}"
    if not _enough(s) or not math.isfinite(low):
        return f"least error: {best.kind}, {led}; {TOO_FEW} blocks of time to tell"
    interval = f"95 % interval {low:.2f} to {high:.2f}"
    return f"best: {best.kind}, {led} ({interval})" if low > 0.0 else (
        f"no clear best: {best.kind} has {led} ({interval})"
    )  # fmt: skip


def _error(s: RingScores, kind: str, steps: str) -> str:
    """A roll-out error with half of its 95 % interval, if there is one."""
    low, high = s.interval[steps].get(kind, (math.nan, math.nan))
    half = f" ± {math.degrees(0.5 * (high - low)):.2f}" if math.isfinite(high - low) and _enough(s) else ""
    return f"{math.degrees(s.rollout[kind][steps]):.2f}{half}"


def _enough(s: RingScores) -> bool:
    """Whether a ring has enough windows, in enough blocks of time, for an interval."""
    from mazeplan.learning.split import enough

    return enough(len(s.windows), s.blocks["windows"])
