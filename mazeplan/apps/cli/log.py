"""`log info`, `export` and `replay`; `report`: one HTML file; `data import-cme`: measurements of the published rig."""

from __future__ import annotations

import sys
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from mazeplan.apps.cli import options as opt
from mazeplan.apps.cli.output import print_result, say
from mazeplan.apps.cli.progress import ProgressBar
from mazeplan.core.whole_file import write_text

if TYPE_CHECKING:
    from mazeplan.core.logs.run_log_reader import RunLog

app = typer.Typer(help="Summarise, export and replay logs.", no_args_is_help=True)
data_app = typer.Typer(help="Import measured data.", no_args_is_help=True)

CsvFile = Annotated[Path, opt.output_file("CSV file to write, or /dev/stdout.", ".csv")]
RunModel = Annotated[str | None, opt.value("--model", "MODEL", "Model of the run, for a log that does not hold it.")]
ModelsFolder = Annotated[
    Path, typer.Argument(metavar="DIR", help="Folder of the model files, CircularMaze/Models in PyRoboCOP.")
]
TablesFolder = Annotated[Path, opt.output_folder("Folder for ring1.csv, ring2.csv ...")]
Inputs = Annotated[
    list[Path],
    typer.Argument(
        metavar="INPUT", help="Run logs; JSON of evaluate, compare, diagnose or improve; folders of diagnose -o."
    ),
]
ReportFile = Annotated[Path, opt.output_file("HTML file to write.", ".html", ".htm")]
FIRST = ("t", "theta", "x", "y", "r", "beta", "gamma", "u_beta", "u_gamma", "ring", "segment")
WHOLE_NUMBERS = ("ring", "segment")
HEADER = ("rig", "map_name", "model", "behavior", "start_ring", "goal_ring", "seed", "version", "platform")


@app.command("info")
def info(log: opt.RunLogFile, as_json: opt.AsJson = False) -> None:
    """Summarise a run log, also an incomplete one."""
    from mazeplan.core.logs.run_log_reader import read_log

    document, lines = _summary(read_log(log))
    print_result(as_json, document, *lines)


@app.command("export")
def export(log: opt.RunLogFile, output: CsvFile, force: opt.Force = False) -> None:
    """Write the ticks of a run log as CSV, in SI units and radians."""
    from mazeplan.core.logs.run_log_reader import read_log, warn_if_cut

    read = read_log(log)
    warn_if_cut(read)
    write_text(output, _csv_text(read))
    say(f"wrote {len(read.ticks['t'])} rows to {output}")


@app.command("replay")
def replay(log: opt.RunLogFile, model: RunModel = None, as_json: opt.AsJson = False) -> None:
    """Run the tree again on a recorded run, and check that every tick decides the same.

    Exit status 1: a tick decides otherwise; the first one is shown."""
    from mazeplan.run.replay import replay as run

    with ProgressBar("replaying") as bar:
        outcome = run(log, model=model, advance=bar.advance)
    if (first := outcome.difference) is None:
        cut_off = f" ({outcome.cut_off} searches ended by the deadline)" if outcome.cut_off else ""
        line = f"{log}: identical: {outcome.ticks} ticks, {outcome.plans} plans{cut_off}, {outcome.events} events"
    else:
        where = f"t = {first.t:.3f} s, tick {first.tick}, {first.what}"
        line = f"{log}: different at {where}: {', '.join(first.fields)}"
    print_result(as_json, {"log": str(log), **asdict(outcome), "identical": outcome.identical}, line)
    sys.exit(0 if outcome.identical else 1)


def report(inputs: Inputs, output: ReportFile, force: opt.Force = False) -> None:
    """Draw runs, evaluations, models and diagnoses into one HTML file without external content."""
    from mazeplan.apps.report.inputs import read_input
    from mazeplan.apps.report.write import write_inputs

    with ProgressBar("drawing", compiles=False) as bar:
        write_inputs([part for path in inputs for part in read_input(path)], output, show=bar.show)
    say(f"wrote {output}")


def _summary(log: RunLog) -> tuple[dict[str, Any], list[str]]:
    """The document of `log info --json` for a run, and its lines."""
    import numpy as np

    from mazeplan.apps.report.runs import lead, logged_failures, visits

    t = log.ticks["t"]
    duration, seen = (float(t[-1] - t[0]), float(np.isfinite(log.ticks["x"]).mean())) if len(t) else (0.0, None)
    rings, failures = visits(log), logged_failures(log)
    document = {
        "file": str(log.path),
        "complete": log.complete,
        "header": {key: value for key, value in log.header.items() if key not in ("map", "replay")},
        "summary": lead(log),
        "ticks": len(t),
        "duration_s": duration,
        "ball_seen": seen,
        "rings": [asdict(visit) for visit in rings],
        "failures": [asdict(failure) for failure in failures],
        "plans": len(log.plans),
        "result": log.result,
    }
    rows = [(key, log.header[key]) for key in HEADER if log.header.get(key) is not None]
    share = "" if seen is None else f", ball seen in {100 * seen:.1f} %"
    rows.append(("ticks", f"{len(t)} over {duration:.2f} s{share}; {len(log.plans)} plans"))
    for visit in rings:
        left = f", left by {visit.opening}" if visit.opening else ""
        rows.append(("ring", f"{visit.ring} from {visit.start:.2f} to {visit.end:.2f} s{left}"))
    for failure in failures:
        parts = [part for part in (failure.kind, failure.where, failure.detail, failure.recovery) if part]
        rows.append(("failure", f"{failure.t:.2f} s {', '.join(parts)}"))
    rows.append(("result", lead(log)))
    state = "complete" if log.complete else "cut off: the program did not finish it"
    return document, [f"{log.path}: {state}", *(f"  {name:11s} {text}" for name, text in rows)]


def _csv_text(log: RunLog) -> str:
    """The ticks as a table (CSV), with theta and r computed from x and y. An empty cell is an unknown value.

    The columns of FIRST come first."""
    import numpy as np
    import pandas as pd

    x, y = log.ticks["x"], log.ticks["y"]
    table = pd.DataFrame({**log.ticks, "theta": np.arctan2(y, x), "r": np.hypot(x, y)})
    for name in WHOLE_NUMBERS:
        if name in table:
            table[name] = table[name].astype("Int64")
    first = [name for name in FIRST if name in table]
    return table[[*first, *(name for name in table if name not in first)]].to_csv(index=False, lineterminator="\n")


@data_app.command("import-cme")
def import_cme(
    folder: ModelsFolder, output: TablesFolder, force: opt.Force = False, as_json: opt.AsJson = False
) -> None:
    """Recover the measurements from the published model files of the rig, one table per ring.

    The files are not part of mazeplan. Their licence applies to the tables, too."""
    from mazeplan.core.progress import piece
    from mazeplan.learning.published_rig import find_models, import_ring, read_model, write_ring

    models = {ring: read_model(folder, ring, ending) for ring, ending in find_models(folder).items()}
    paths = {ring: output / f"ring{ring}.csv" for ring in models}
    document: dict[str, dict[str, Any]] = {}
    with ProgressBar("importing") as bar:
        for i, (ring, model) in enumerate(models.items()):
            bar.show(f"ring {ring}")
            table, figures = import_ring(model, advance=piece(bar.advance, i, 1, len(models)))
            write_ring(table, paths[ring])
            document[f"ring{ring}"] = {"file": str(paths[ring]), "source": model.file.name, **figures}
    lines = [
        f"{ring}: {row['published']} rows published (1 sample in {row['step']}), {row['recovered']} recovered, "
        f"{row['segments']} segments; noise {row['noise']:.4g} rad/s^2"
        for ring, row in document.items()
    ]
    print_result(as_json, document, *lines)
    say(f"wrote {', '.join(path.name for path in paths.values())} to {output}")
