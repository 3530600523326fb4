"""`log info`, `log export`, `log replay`."""

from __future__ import annotations

import csv
import json
import math
import sys
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, TextIO

import typer

from mazeplan.cli.output import finite, print_json, say
from mazeplan.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Iterable

    from mazeplan.data.runlog import RunLog
    from mazeplan.replay import Difference, Replay

app = typer.Typer(help="Run logs: summary, export, replay.", no_args_is_help=True)

LogFile = Annotated[Path, typer.Argument(help="Run log (MCAP).")]
FIRST = ("t", "theta", "x", "y", "r", "beta", "gamma", "u_beta", "u_gamma", "ring", "segment")
SHOWN = 200  # characters of a message that differs
WHOLE_NUMBERS = ("ring", "segment")
TOLD = ("rig", "map_name", "model", "behavior", "start_ring", "goal_ring", "seed", "version", "platform")


@app.command("info")
def info(
    log: LogFile,
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON document on stdout.")] = False,
) -> None:
    """Summary of a run log; one that was cut is read up to where it ends."""
    from mazeplan.cli.progress import log_read

    document = summary(log_read(log))
    if as_json:
        print_json(document)
    else:
        print("\n".join(lines(document)))


@app.command("export")
def export(
    log: LogFile,
    output: Annotated[str, typer.Option("-o", "--output", help="CSV file, or - for stdout.")],
    force: Annotated[bool, typer.Option("--force", help="Overwrite the file.")] = False,
) -> None:
    """The ticks of a run log as CSV, in SI units and radians."""
    from mazeplan.cli.progress import log_read

    columns = table_columns(log_read(log))
    if output == "-":
        _write(sys.stdout, columns)
        return
    path = Path(output)
    if path.exists() and path.samefile(log):
        raise InputError("is the log itself, expected another file for the table", file=path)
    if path.exists() and not force:
        raise InputError("exists already; give --force to overwrite it", file=path)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with path.open("w", newline="", encoding="utf-8") as stream:
            _write(stream, columns)
    except OSError as problem:
        raise InputError(f"cannot be written: {problem.strerror}", file=path) from None
    say(f"wrote {len(columns['t'])} rows to {path}")


@app.command("replay")
def replay(
    log: LogFile,
    model: Annotated[
        str | None, typer.Option("--model", help="Where the run's model is, if the log does not hold it.")
    ] = None,
    behavior: Annotated[
        str | None, typer.Option("--behavior", help="Where the run's behaviour tree is now, if it was moved.")
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON document on stdout.")] = False,
) -> None:
    """Run the tree again on what a navigation observed: whether every tick decides as it did.

    Exit status 1 where one does not; the first is shown."""
    from mazeplan.cli.progress import Working
    from mazeplan.replay import replay as run

    with Working("replaying") as shown:
        outcome = run(log, model=model, behavior=behavior, advance=shown.advance)
    if as_json:
        print_json({"log": str(log), **asdict(outcome), "identical": outcome.identical})
    else:
        print("\n".join(replay_lines(log, outcome)))
    sys.exit(0 if outcome.identical else 1)


def replay_lines(log: Path, outcome: Replay) -> list[str]:
    """The comparison for people."""
    from mazeplan.replay import told_by_another_version

    cut_off = f" ({outcome.cut_off} searches ended by the deadline)" if outcome.cut_off else ""
    same = f"{outcome.ticks} ticks, {outcome.plans} plans{cut_off}, {outcome.events} events"
    if outcome.difference is None:
        return [f"{log}: identical: {same}"]
    first = outcome.difference
    told = [f"{log}: different at t = {first.t:.3f} s, tick {first.tick}, {first.what}: {', '.join(first.fields)}"]
    told += [f"  {name}  {_decision(first, name)}" for name in ("recorded", "replayed")]
    told.append(f"  the same until then: {same}")
    if told_by_another_version(outcome):
        told.append(f"  recorded by version {outcome.recorded_by} of mazeplan, which is not this one")
    return told


def _decision(difference: Difference, which: str) -> str:
    """Status, leaf, command of the tick, and the message where it is another one that differs."""
    d = getattr(difference, which)
    if d:
        degrees = ", ".join(f"{math.degrees(d[name]):+.3f}" for name in ("u_beta", "u_gamma"))
        told = f"{d['status']} {d['leaf'] or 'no leaf'} ({degrees}) deg, opening {d['opening'] or 'none'}"
    else:
        told = "the run was over"
    message = difference.messages[which == "replayed"]
    if difference.what == "tick" or message is None:
        return told if message is not None else f"{told}; no such {difference.what}"
    fields = {name: message[name] for name in difference.fields if name in message} or message
    text = json.dumps(fields)
    return f"{told}; {difference.what} {text if len(text) <= SHOWN else text[:SHOWN] + '...'}"


def summary(log: RunLog) -> dict[str, Any]:
    """What `log info --json` prints."""
    import numpy as np

    t = log.ticks["t"]
    duration = float(t[-1] - t[0]) if len(t) > 1 else 0.0
    planner_ms = [plan["ms"] for plan in log.plans if isinstance(plan.get("ms"), int | float)]
    document = {
        "file": str(log.path),
        "complete": log.complete,
        "header": {key: value for key, value in log.header.items() if key not in ("map", "replay")},
        "ticks": len(t),
        "duration_s": duration,
        "rate_hz": (len(t) - 1) / duration if duration > 0.0 else None,
        "ball_seen": float(np.isfinite(log.ticks["x"]).mean()) if len(t) else None,
        "rings": _rings(log),
        "passed": [{"t": t, "opening": detail.get("opening")} for t, detail in _events(log, "passed")],
        "failures": [{"t": t, **detail} for t, detail in _events(log, "failure")],
        "recoveries": [{"t": t, "recovery": detail.get("recovery")} for t, detail in _events(log, "recovery")],
        "plans": len(log.plans),
        "planner_ms": _spread(planner_ms),
        "tick_ms": _spread(log.ticks.get("tick_ms", ())),
        "result": log.result,
    }
    return finite(document)


def _events(log: RunLog, kind: str) -> list[tuple[float, dict[str, Any]]]:
    return [(event["t"], event["detail"]) for event in log.events if event["kind"] == kind]


def _rings(log: RunLog) -> list[dict[str, Any]]:
    """Each stay in a ring: when it began, how long it was (to the last tick for the last one), s."""
    entered = _events(log, "ring")
    last = max((float(log.ticks["t"][-1]) if len(log.ticks["t"]) else 0.0, *(t for t, _ in entered)))
    ends = [*(t for t, _ in entered[1:]), last]
    return [
        {"ring": detail.get("ring"), "t": t, "time_s": end - t} for (t, detail), end in zip(entered, ends, strict=False)
    ]


def _spread(values: Iterable[float]) -> dict[str, float] | None:
    import numpy as np

    known = np.array([value for value in values if math.isfinite(value)])
    if not known.size:
        return None
    p50, p99 = np.percentile(known, [50, 99])
    return {"p50": float(p50), "p99": float(p99), "max": float(known.max())}


def lines(document: dict[str, Any]) -> list[str]:
    """The summary for people, a line each."""
    whole = "complete" if document["complete"] else "cut off: the program did not finish it"
    told = [f"{document['file']}: {whole}"]

    def tell(name: str, text: str) -> None:
        told.append(f"  {name:11s} {text}")

    for key in TOLD:
        if document["header"].get(key) is not None:
            tell(key, str(document["header"][key]))
    seen = "" if document["ball_seen"] is None else f", ball seen in {100 * document['ball_seen']:.1f} %"
    rate = "" if document["rate_hz"] is None else f" at {document['rate_hz']:.2f} Hz"
    tell("ticks", f"{document['ticks']} over {document['duration_s']:.2f} s{rate}{seen}")
    stays = [f"{stay['ring']} from {stay['t']:.2f} s for {stay['time_s']:.2f} s" for stay in document["rings"]]
    tell("rings", "; ".join(stays) or "not told")
    tell("openings", "; ".join(f"{p['opening']} at {p['t']:.2f} s" for p in document["passed"]) or "none passed")
    for failure in document["failures"]:
        parts = [str(failure.get(key)) for key in ("kind", "where", "detail") if failure.get(key)]
        tell("failure", f"{failure['t']:.2f} s {', '.join(parts)}")
    for recovery in document["recoveries"]:
        tell("recovery", f"{recovery['t']:.2f} s {recovery['recovery']}")
    for key, name in (("planner_ms", f"{document['plans']} plans"), ("tick_ms", "tick")):
        if document[key]:
            tell(name, ", ".join(f"{figure} {value:.2f} ms" for figure, value in document[key].items()))
    result = document["result"]
    tell("result", "none" if result is None else f"{result.get('reason')} after {result.get('time_s')} s")
    return told


def table_columns(log: RunLog) -> dict[str, Any]:
    """Columns of a log in the order of a brought table: the known ones first; theta and r worked out from x and y."""
    import numpy as np

    x, y = log.ticks["x"], log.ticks["y"]
    columns = {**log.ticks, "theta": np.arctan2(y, x), "r": np.hypot(x, y)}
    order = [name for name in FIRST if name in columns]
    return {name: columns[name] for name in (*order, *(name for name in columns if name not in order))}


def _write(stream: TextIO, columns: dict[str, Any]) -> None:
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(columns)
    whole = [name in WHOLE_NUMBERS for name in columns]
    for row in zip(*columns.values(), strict=True):
        writer.writerow([_cell(value, as_int) for value, as_int in zip(row, whole, strict=True)])


def _cell(value: Any, as_int: bool) -> Any:
    if value != value:  # NaN: not known
        return ""
    return int(value) if as_int and math.isfinite(value) else value
