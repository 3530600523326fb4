"""`log info`, `log export`."""

from __future__ import annotations

import csv
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, TextIO

import typer

from mazeplan.cli.output import print_json, say
from mazeplan.errors import InputError

if TYPE_CHECKING:
    from mazeplan.data.runlog import RunLog

app = typer.Typer(help="Run logs: summary, export.", no_args_is_help=True)

FIRST = ("t", "theta", "x", "y", "r", "beta", "gamma", "u_beta", "u_gamma", "segment", "ring")


def summary(log: RunLog) -> dict[str, Any]:
    """What `log info --json` prints."""
    import numpy as np

    t = log.ticks.get("t", np.zeros(0))
    seen = np.isfinite(log.ticks["x"]) if "x" in log.ticks else np.zeros(0, dtype=bool)

    def spread(column: str) -> dict[str, float] | None:
        values = log.ticks.get(column, np.zeros(0))
        values = values[np.isfinite(values)]
        if not values.size:
            return None
        p50, p99 = np.percentile(values, [50, 99])
        return {"p50": float(p50), "p99": float(p99), "max": float(values.max())}

    return {
        "file": str(log.path),
        "complete": log.complete,
        "header": {key: value for key, value in log.header.items() if key != "map"},
        "ticks": len(t),
        "duration_s": float(t[-1] - t[0]) if len(t) > 1 else 0.0,
        "rate_hz": float((len(t) - 1) / (t[-1] - t[0])) if len(t) > 1 and t[-1] > t[0] else None,
        "ball_seen": float(seen.mean()) if seen.size else None,
        "rings": [
            {"t": event["t"], "ring": event["detail"].get("ring")} for event in log.events if event["kind"] == "ring"
        ],
        "passed": [event["detail"].get("opening") for event in log.events if event["kind"] == "passed"],
        "failures": [{"t": event["t"], **event["detail"]} for event in log.events if event["kind"] == "failure"],
        "recoveries": [event["detail"].get("recovery") for event in log.events if event["kind"] == "recovery"],
        "plans": len(log.plans),
        "planner_ms": spread("planner_ms"),
        "tick_ms": spread("tick_ms"),
        "result": log.result,
    }


@app.command("info")
def info(
    log: Annotated[Path, typer.Argument(help="Run log (MCAP).")],
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON document on stdout.")] = False,
) -> None:
    """Summary of a run log; one that was cut is read up to where it ends."""
    from mazeplan.data.runlog import read_log

    document = summary(read_log(log))
    if as_json:
        print_json(document)
        return
    print(f"{document['file']}: {'complete' if document['complete'] else 'cut off before its end'}")
    header = document["header"]
    for key in ("rig", "map_name", "behavior", "start_ring", "goal_ring", "seed"):
        if key in header:
            print(f"  {key:12s} {header[key]}")
    seen = "" if document["ball_seen"] is None else f", ball seen in {100 * document['ball_seen']:.1f} %"
    print(f"  {document['ticks']} ticks over {document['duration_s']:.2f} s{seen}, {document['plans']} plans")
    print("  rings        " + ", ".join(f"{entry['ring']} at {entry['t']:.2f} s" for entry in document["rings"]))
    print("  openings     " + (", ".join(str(name) for name in document["passed"]) or "none"))
    for failure in document["failures"]:
        print(f"  failure      {failure['t']:.2f} s {failure['kind']} in {failure['where']}: {failure['detail']}")
    for key in ("planner_ms", "tick_ms"):
        if document[key]:
            print(f"  {key:12s} " + ", ".join(f"{name} {value:.2f}" for name, value in document[key].items()))
    if document["result"]:
        print(f"  result       {document['result']['reason']} after {document['result']['time_s']:.2f} s")


@app.command("export")
def export(
    log: Annotated[Path, typer.Argument(help="Run log (MCAP).")],
    output: Annotated[str, typer.Option("-o", "--output", help="CSV file, or - for stdout.")],
    force: Annotated[bool, typer.Option("--force", help="Overwrite the file.")] = False,
) -> None:
    """The ticks of a run log as CSV, in SI units and radians."""
    from mazeplan.data.runlog import read_log

    columns = table_columns(read_log(log))
    if output == "-":
        _write(sys.stdout, columns)
        return
    path = Path(output)
    if path.exists() and not force:
        raise InputError("exists already; give --force to overwrite it", file=path)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with path.open("w", newline="", encoding="utf-8") as stream:
            _write(stream, columns)
    except OSError as problem:
        raise InputError(f"cannot be written: {problem.strerror}", file=path) from None
    rows = len(next(iter(columns.values()), []))
    say(f"wrote {rows} rows to {path}")


def table_columns(log: RunLog) -> dict[str, Any]:
    """Columns of a log in the order of a brought table: the known ones first, theta and r worked out."""
    import numpy as np

    columns = dict(log.ticks)
    if "x" in columns:
        columns["theta"] = np.arctan2(columns["y"], columns["x"])
        columns["r"] = np.hypot(columns["x"], columns["y"])
    order = [name for name in FIRST if name in columns]
    return {name: columns[name] for name in [*order, *(name for name in columns if name not in order)]}


def _write(stream: TextIO, columns: dict[str, Any]) -> None:
    writer = csv.writer(stream)
    writer.writerow(columns)
    for row in zip(*columns.values(), strict=True):
        writer.writerow(["" if value != value else value for value in row])
