"""`log info`, `export` and `replay`."""

from __future__ import annotations

import sys
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from mazeplan.apps.cli import options as opt
from mazeplan.apps.cli.option_checks import file_or_stdout
from mazeplan.apps.cli.output import print_json, say
from mazeplan.core.whole_file import write_text

if TYPE_CHECKING:
    from mazeplan.core.logs.run_log import RunLog
    from mazeplan.core.logs.table import Table
    from mazeplan.run.replay import Replay

app = typer.Typer(help="Summarise, export and replay logs.", no_args_is_help=True)

CsvFile = Annotated[
    str,
    typer.Option(
        "-o", "--output", parser=file_or_stdout(".csv"), callback=opt.new_file, metavar="FILE",
        help="CSV file to write, or - for stdout.",
    ),
]  # fmt: skip
RunModel = Annotated[
    str | None, typer.Option("--model", metavar="MODEL", help="Model of the run, for a log that does not hold it.")
]
FIRST = ("t", "theta", "x", "y", "r", "beta", "gamma", "u_beta", "u_gamma", "ring", "segment")
WHOLE_NUMBERS = ("ring", "segment")
HEADER = ("rig", "map_name", "model", "behavior", "start_ring", "goal_ring", "seed", "version", "platform")


@app.command("info")
def info(
    log: Annotated[Path, typer.Argument(metavar="LOG", help="Run log (MCAP) or table (CSV).")],
    columns: opt.Columns = None, as_json: opt.AsJson = False,
) -> None:  # fmt: skip
    """Summarise a run log, also an incomplete one; or show what is understood of a table."""
    from mazeplan.core import file_kinds
    from mazeplan.core.logs.column_units import parse_columns
    from mazeplan.core.logs.run_log import read_log
    from mazeplan.core.logs.table import read_table

    if columns or log.suffix == ".csv" or file_kinds.got(log) == "text":
        document, lines = table_summary(read_table(log, parse_columns(columns or ()))), table_lines
    else:
        document, lines = summary(read_log(log)), summary_lines
    if as_json:
        print_json(document)
    else:
        print("\n".join(lines(document)))


@app.command("export")
def export(log: opt.RunLogFile, output: CsvFile, force: opt.Force = False) -> None:
    """Write the ticks of a run log as CSV, in SI units and radians."""
    from mazeplan.core.logs.run_log import read_log
    from mazeplan.core.logs.run_log_reader import warn_if_cut

    read = read_log(log)
    warn_if_cut(read)
    if output == "-":
        sys.stdout.write(csv_text(read))
        return
    path = Path(output)
    write_text(path, csv_text(read))
    say(f"wrote {len(read.ticks['t'])} rows to {path}")


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
    else:
        print("\n".join(replay_lines(log, outcome)))
    sys.exit(0 if outcome.identical else 1)


def replay_lines(log: Path, outcome: Replay) -> list[str]:
    """The comparison of a run with its replay, as lines."""
    cut_off = f" ({outcome.cut_off} searches ended by the deadline)" if outcome.cut_off else ""
    same = f"{outcome.ticks} ticks, {outcome.plans} plans{cut_off}, {outcome.events} events"
    first = outcome.difference
    if first is None:
        return [f"{log}: identical: {same}"]
    return [f"{log}: different at t = {first.t:.3f} s, tick {first.tick}, {first.what}: {', '.join(first.fields)}"]


def summary(log: RunLog) -> dict[str, Any]:
    """The document of `log info --json`."""
    import numpy as np

    from mazeplan.apps.report.run import lead, logged_failures, visits

    t = log.ticks["t"]
    return {
        "file": str(log.path),
        "complete": log.complete,
        "header": {key: value for key, value in log.header.items() if key not in ("map", "replay")},
        "summary": lead(log),
        "ticks": len(t),
        "duration_s": float(t[-1] - t[0]) if len(t) else 0.0,
        "ball_seen": float(np.isfinite(log.ticks["x"]).mean()) if len(t) else None,
        "rings": [asdict(visit) for visit in visits(log)],
        "failures": [asdict(failure) for failure in logged_failures(log)],
        "plans": len(log.plans),
        "result": log.result,
    }


def summary_lines(document: dict[str, Any]) -> list[str]:
    """The summary, one fact per line."""
    rows = [(key, document["header"][key]) for key in HEADER if document["header"].get(key) is not None]
    seen = "" if document["ball_seen"] is None else f", ball seen in {100 * document['ball_seen']:.1f} %"
    rows.append(("ticks", f"{document['ticks']} over {document['duration_s']:.2f} s{seen}; {document['plans']} plans"))
    for visit in document["rings"]:
        left = f", left by {visit['opening']}" if visit["opening"] else ""
        rows.append(("ring", f"{visit['ring']} from {visit['start']:.2f} to {visit['end']:.2f} s{left}"))
    for failure in document["failures"]:
        parts = [failure[key] for key in ("kind", "where", "detail", "recovery") if failure[key]]
        rows.append(("failure", f"{failure['t']:.2f} s {', '.join(parts)}"))
    rows.append(("result", document["summary"]))
    state = "complete" if document["complete"] else "cut off: the program did not finish it"
    return [f"{document['file']}: {state}", *(f"  {name:11s} {text}" for name, text in rows)]


def table_summary(table: Table) -> dict[str, Any]:
    """The document of `log info TABLE --json`."""
    import numpy as np

    from mazeplan.core.logs.table import stretches
    from mazeplan.core.logs.table_checks import UNITS

    known, columns = list(UNITS), list[dict[str, Any]]()
    for name in sorted(table.columns, key=lambda name: known.index(name) if name in known else len(known)):
        values = table[name]
        seen = values[np.isfinite(values)]
        ends = (float(seen.min()), float(seen.max())) if len(seen) else (None, None)
        columns.append({
            "name": name, "column": table.named.get(name, name), "known": name in UNITS, "unit": UNITS.get(name, ""),
            "min": ends[0], "max": ends[1], "missing": 1.0 - len(seen) / len(values),
        })  # fmt: skip
    parts = stretches(table)
    lengths = [float(table["t"][part][-1] - table["t"][part][0]) for part in parts]
    return {
        "file": table.place, "rows": len(table), "duration_s": sum(lengths), "rate_hz": 1.0 / table.dt,
        "stretches": len(parts), "columns": columns,
    }  # fmt: skip


def table_lines(document: dict[str, Any]) -> list[str]:
    """What is understood of a table, one column per line."""
    count = document["stretches"]
    lines = [
        f"{document['file']}: {document['rows']} rows, {document['rate_hz']:.1f} a second, "
        f"{document['duration_s']:.1f} s in {count} uninterrupted stretch{'es' * (count > 1)}"
    ]
    read = {c["column"] for c in document["columns"] if c["column"] != c["name"]}
    for c in document["columns"]:
        if c["known"]:
            ends = "no number" if c["min"] is None else f"{c['min']:.4g} to {c['max']:.4g} {c['unit']}".rstrip()
            origin = f", from {c['column']}" if c["column"] != c["name"] else ""
            missing = f", missing in {100 * c['missing']:.1f} %" if c["missing"] else ""
            lines.append(f"  {c['name']:11s} {ends}{origin}{missing}")
    unknown = [c["name"] for c in document["columns"] if not c["known"] and c["name"] not in read]
    if unknown:
        lines.append(f"  not used    {', '.join(unknown)}; --columns names a column and its unit")
    return lines


def csv_text(log: RunLog) -> str:
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
