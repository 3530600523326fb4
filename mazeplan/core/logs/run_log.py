"""Run logs: MCAP files in short chunks, so that other tools can read them and a killed process loses little.

A topic is JSON with a JSON schema, so that general MCAP viewers can read it. The log time is the rig's, in ns:

    /header  once: program, rig, map (its text), behaviour, start, goal, seed ..., and all that `log replay` needs
             started: wall-clock time in UTC, ISO 8601, for people
    /tick    each control tick: what was observed, estimated and commanded, by which leaf
             cut_off: after how many iterations the planner's deadline ended each search of the tick
             x2, y2, estimate_x2, estimate_y2, ring2: of the second ball; ball: number of the one that the tree steers
    /plan    each plan: states and controls by component, cost, why the solver stopped
    /tree    when a tree begins: its nodes, as `records.TreeOutline` explains
    /status  each tick that changes a status: how the last tick of every node ended, one letter each (`STATUSES`)
    /openings  each time an opening was tried: successes and failures at openings as they count at t
    /event   ring changes, openings chosen and passed, failures, recoveries
    /result  once at the end

The model of the run is an attachment, unless it is a packaged model or nominal physics (`modelfile.packed_model`).

An unfinished chunk is lost with everything in it. Therefore a chunk ends with the first message that comes CHUNK_S of
rig time after its first message, and goes to the operating system at once; header and result do not wait.

Unknown values are left out, and arrays have one dimension: viewers that plot refuse null and nested arrays.
"""

from __future__ import annotations

import json
import math
import os
import platform
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import asdict
from datetime import UTC, datetime
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import numpy as np
from mcap.writer import CompressionType, Writer

from mazeplan.core.errors import LogError
from mazeplan.core.events import RunEvent, TimedEvent
from mazeplan.core.logs.run_log_reader import FORMAT, PLAN_CONTROLS, PLAN_STATES, PROGRAM
from mazeplan.core.records import Command, Observation, Plan, State, TreeOutline
from mazeplan.core.results import finite
from mazeplan.core.whole_file import lock, save_at_hard_end

STATUSES = {"INVALID": "-", "RUNNING": "R", "SUCCESS": "S", "FAILURE": "F", "SKIPPED": "K"}
CHUNK_S = 0.25  # s of the rig's time in a chunk: a killed process loses no more
CHUNK_TICKS = 12  # maximum in a chunk, if the rig's clock stands still: 0.4 s at 30 Hz
CHUNK_BYTES = 64 * 2**20  # never reached, so that the MCAP writer does not end chunks by itself
AT_ONCE = ("/header", "/result")  # topics that end a chunk
COMPRESSION = CompressionType.ZSTD
Sink = Callable[[str, float, dict[str, Any]], None]  # topic, rig time in s, document


def _object(nested: dict[str, Any] | None = None, **names: str) -> dict[str, Any]:
    """The schema of an object. names: its fields of each type, as number="t x y", and strings="names" for lists"""
    fields = {name: TYPES[kind] for kind, listed in names.items() for name in listed.split()}
    return {"type": "object", "properties": fields | (nested or {})}


def _array(items: dict[str, Any]) -> dict[str, Any]:
    return {"type": "array", "items": items}


TYPES: dict[str, Any] = {name: {"type": name} for name in ("number", "integer", "string", "boolean")}
TYPES |= {f"{name}s": _array(kind) for name, kind in TYPES.items()}
ESTIMATE = ("t", "x", "y", "vx", "vy", "beta", "beta_dot", "gamma", "gamma_dot")
SCHEMAS: dict[str, dict[str, Any]] = {
    "/header": _object(
        {"replay": _object(integer="format", number="rate_hz", string="settings")},
        string="program version rig map map_name model behavior platform started",
        integer="format seed start_ring goal_ring",
        number="start_theta",
    ),
    "/tick": _object(
        {f"estimate_{name}": TYPES["number"] for name in (*ESTIMATE, "x2", "y2")},
        number="t x y beta gamma u_beta u_gamma planned_theta goal_theta planner_ms tick_ms x2 y2",
        integer="ring segment ball ring2",
        string="status leaf opening cut_off doubts",
    ),
    "/plan": _object(
        dict.fromkeys((*PLAN_STATES, *PLAN_CONTROLS), TYPES["numbers"]),
        number="t0 dt cost ms",
        string="reason",
        integer="iterations",
    ),
    "/tree": _object(number="t", strings="paths kinds names", integers="parents conditions"),
    "/status": _object(number="t", string="nodes"),
    "/openings": _object(number="t fading_s", strings="names", numbers="successes failures"),
    "/event": _object(
        {"detail": _object(string="kind where detail recovery opening", integer="ring")}, number="t", string="kind"
    ),
    "/result": _object(
        {
            "rings": _array(_object(integer="ring", number="time_s", string="opening")),
            "failures": _array(_object(number="t x y", string="kind recovery where words")),
            "start": _object(integer="ring", number="theta"),
        },
        boolean="success",
        string="reason",
        number="time_s",
        integer="replans",
    ),
}


_ENCODER = json.JSONEncoder(separators=(",", ":"), allow_nan=False)


def encode(document: dict[str, Any]) -> bytes:
    """A message as the log holds it (JSON), without values that JSON cannot hold."""
    try:
        text = _ENCODER.encode(document)
    except (TypeError, ValueError):  # rare, so that the usual tick does not pay for it
        known = {key: value for key, value in finite(document).items() if value is not None}
        text = json.dumps(known, separators=(",", ":"), default=str)
    return text.encode()


class RunMessages:
    """Turns what happens in a run into messages, and hands each to all sinks: topic, rig time in s, document.

    path: the name of the log for the result, None without a log."""

    def __init__(self, *sinks: Sink, path: str | None = None) -> None:
        self.path = path
        self._sinks = sinks
        self._t = 0.0  # rig time of the last tick, s

    def write(self, topic: str, t: float, document: dict[str, Any]) -> None:
        """Hand one message to all sinks."""
        for sink in self._sinks:
            sink(topic, t, document)

    def sample(self, observation: Observation, command: Command, **more: Any) -> None:
        """One tick without an estimate, as `collect` writes it. more: further values; None is left out."""
        self._t = observation.t
        o = observation  # written out, because `asdict` takes as long as all the rest
        document = {"t": o.t, "x": o.x, "y": o.y, "beta": o.beta, "gamma": o.gamma, "u_beta": command.u_beta}
        document |= {"u_gamma": command.u_gamma, **more}
        self.write("/tick", o.t, {name: value for name, value in document.items() if value is not None})

    def tick(self, observation: Observation, command: Command, state: State, **more: Any) -> None:
        """One control tick: observed, commanded, estimated. more: further values; None is left out."""
        estimate = {f"estimate_{name}": getattr(state, name) for name in ESTIMATE}
        self.sample(observation, command, ring=state.ring, **estimate, **more)

    def plan(self, plan: Plan) -> None:
        """One plan (its gains are left out: they follow from the rest); no trajectory when it is not finite."""
        document = {name: getattr(plan, name) for name in ("t0", "dt", "cost", "reason", "iterations", "ms")}
        if np.isfinite(plan.states).all() and np.isfinite(plan.controls).all():
            # rounding to 1 urad halves the file; no sensor of the rig has such a fine resolution
            document |= zip(PLAN_STATES, np.round(plan.states, 6).T.tolist(), strict=True)
            document |= zip(PLAN_CONTROLS, np.round(plan.controls, 6).T.tolist(), strict=True)
        self.write("/plan", plan.t0, document)

    def tree(self, t: float, outline: TreeOutline) -> None:
        """The nodes of a tree that begins at t."""
        known = {name: value for name, value in asdict(outline).items() if value is not None}
        self.write("/tree", t, {"t": t, **known})

    def statuses(self, t: float, nodes: str) -> None:
        """How the last tick of each node of the tree ended, letters of `STATUSES`."""
        self.write("/status", t, {"t": t, "nodes": nodes})

    def openings(self, t: float, counts: Mapping[str, tuple[float, float]], fading_s: float) -> None:
        """Successes and failures at openings as they count now; fading_s: time in which they fall to 1/e."""
        names, successes, failures = list(counts), [c[0] for c in counts.values()], [c[1] for c in counts.values()]
        document = {"t": t, "fading_s": fading_s, "names": names, "successes": successes, "failures": failures}
        self.write("/openings", t, document)

    def event(self, t: float, event: RunEvent) -> None:
        """An event at rig time t."""
        self.write("/event", t, TimedEvent(t, event).document)

    def result(self, document: dict[str, Any]) -> None:
        """The outcome of the run."""
        self.write("/result", self._t, document)


class RunLogWriter(RunMessages):
    """Writes one run; a context manager.

    header: facts about the run; the writer adds program, format, platform and started (UTC, ISO 8601)

    If the file cannot be written, a method raises LogError, but only once. The run may go on; later messages are not
    written."""

    def __init__(self, path: str | Path, header: dict[str, Any]) -> None:
        super().__init__(path=str(path))
        self._closed = False
        self._sequence = 0
        self._whole = True  # False while a chunk is being written, and for good after a write that failed
        self._pending: list[tuple[str, int, bytes, int]] = []  # topic, ns, content, sequence
        self._pending_ticks = 0
        try:
            Path(path).parent.mkdir(parents=True, exist_ok=True)
            self._stream = Path(path).open("ab")  # noqa: SIM115  (closed in `close`)
            if not lock(self._stream):  # nothing of the file has changed yet
                self._stream.close()
                raise LogError("another process writes this log", file=self.path)
            if os.fstat(self._stream.fileno()).st_size:
                self._stream.truncate(0)
        except (OSError, ValueError) as problem:
            raise self._failed(problem) from None
        self._writer = Writer(self._stream, chunk_size=CHUNK_BYTES, compression=COMPRESSION, enable_data_crcs=True)
        self._flush = self._writer.flush
        self._writer.start(profile="", library=PROGRAM)
        self._channels: dict[str, int] = {}
        for topic, schema in SCHEMAS.items():
            schema_id = self._writer.register_schema(f"{PROGRAM}.{topic[1:]}", "jsonschema", encode(schema))
            self._channels[topic] = self._writer.register_channel(topic, "json", schema_id)
        started = datetime.now(UTC).isoformat(timespec="milliseconds")
        save_at_hard_end(self)
        facts = {"program": PROGRAM, "format": FORMAT, "platform": platform.platform(), "started": started}
        try:
            self.write("/header", 0.0, {**header, **facts})
        except LogError:
            self.close()
            raise

    def _failed(self, problem: Exception) -> LogError:
        return LogError(f"cannot be written: {getattr(problem, 'strerror', None) or problem}", file=self.path)

    def write(self, topic: str, t: float, document: dict[str, Any]) -> None:
        """Write one message; it is in the file when its chunk ends."""
        if self._closed or not self._whole:
            return
        ns = round(t * 1e9) if math.isfinite(t) and t > 0.0 else 0
        self._sequence += 1
        self._pending.append((topic, ns, encode(document), self._sequence))
        self._pending_ticks += topic == "/tick"
        full = self._pending_ticks >= CHUNK_TICKS or abs(ns - self._pending[0][1]) >= CHUNK_S * 1e9
        if full or topic in AT_ONCE:
            self._safely(self._end_chunk)

    def attach(self, name: str, media_type: str, data: bytes) -> None:
        """Attach a file to the log. Raises LogError like the other methods."""
        if not self._closed and self._whole:
            self._safely(self._writer.add_attachment, 0, 0, name, media_type, data)

    def _end_chunk(self) -> None:
        for topic, ns, content, sequence in self._pending:
            self._writer.add_message(self._channels[topic], ns, content, ns, sequence)
        self._pending.clear()
        self._pending_ticks = 0

    def _safely(self, add: Callable[..., None], *record: Any) -> None:
        # Ctrl-C may strike anywhere in here; half a chunk must not be followed by another one
        self._whole = False
        try:
            add(*record)
            self._flush()
        except OSError as problem:
            raise self._failed(problem) from None
        self._whole = True

    def save(self) -> None:
        """End the chunk, before another thread ends the process."""
        if not self._closed and self._whole:
            self._safely(self._end_chunk)

    def close(self) -> None:
        """Finish the file; a second call does nothing. After a write that failed, the file stays like a cut file."""
        if self._closed:
            return
        self._closed = True
        try:
            if self._whole:
                self._end_chunk()
                self._writer.finish()
            self._stream.close()
        except OSError as problem:
            with suppress(OSError):
                self._stream.close()
            if self._whole:  # else an error was raised already
                raise self._failed(problem) from None

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()
