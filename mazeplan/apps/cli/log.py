"""`log info`, `export` and `replay`."""

from __future__ import annotations

import sys
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from mazeplan.apps.cli import options as opt
from mazeplan.apps.cli.output import print_json, say
from mazeplan.core.whole_file import write_text

if TYPE_CHECKING:
    from mazeplan.core.logs.run_log_reader import RunLog

app = typer.Typer(help="Summarise, export and replay logs.", no_args_is_help=True)

CsvFile = Annotated[Path, opt.output_file("CSV file to write, or /dev/stdout.", ".csv")]
RunModel = Annotated[str | None, opt.value("--model", "MODEL", "Model of the run, for a log that does not hold it.")]
FIRST = ("t", "theta", "x", "y", "r", "beta", "gamma", "u_beta", "u_gamma", "ring", "segment")
WHOLE_NUMBERS = ("ring", "segment")
HEADER = ("rig", "map_name", "model", "behavior", "start_ring", "goal_ring", "seed", "version", "platform")


@app.command("info")
def info(log: opt.RunLogFile, as_json: opt.AsJson = False) -> None:
    """Summarise a run log, also an incomplete one."""
    from mazeplan.core.logs.run_log_reader import read_log

    document, lines = _summary(read_log(log))
    if as_json:
        print_json(document)
    else:
        print("\n".join(lines))


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
    from mazeplan.apps.cli.progress import ProgressBar
    from mazeplan.run.replay import replay as run

    with ProgressBar("replaying") as bar:
        outcome = run(log, model=model, advance=bar.advance)
    if as_json:
        print_json({"log": str(log), **asdict(outcome), "identical": outcome.identical})
    elif (first := outcome.difference) is None:
        cut_off = f" ({outcome.cut_off} searches ended by the deadline)" if outcome.cut_off else ""
        print(f"{log}: identical: {outcome.ticks} ticks, {outcome.plans} plans{cut_off}, {outcome.events} events")
    else:
        where = f"t = {first.t:.3f} s, tick {first.tick}, {first.what}"
        print(f"{log}: different at {where}: {', '.join(first.fields)}")
    sys.exit(0 if outcome.identical else 1)


def _summary(log: RunLog) -> tuple[dict[str, Any], list[str]]:
    """The document of `log info --json` for a run, and its lines."""
    import numpy as np

    from mazeplan.apps.report.run import lead, logged_failures, visits

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
