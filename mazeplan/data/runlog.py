"""Run logs: MCAP files, written message by message as the run goes, so that a killed process loses at most the last tick.

Topics (JSON with a JSON schema each, so that general MCAP viewers read them); the log time is the rig's, in ns:

    /header  once: program, version, rig, map (its text), behaviour, start, goal, seed ...
    /tick    each control tick: what was observed, estimated and commanded, by which leaf
    /plan    each plan: states, controls, cost, why the solver stopped
    /event   ring changes, openings chosen and passed, failures, recoveries
    /result  once at the end

The file is not chunked and flushed after each message: a chunk that was not finished would be lost with everything in it.
"""

from __future__ import annotations

import json
import math
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import numpy as np
from mcap.exceptions import EndOfFile, McapError
from mcap.stream_reader import StreamReader
from mcap.records import Channel, Message
from mcap.writer import CompressionType, Writer

from mazeplan.errors import LogError
from mazeplan.records import Command, Observation, Plan, State

TOPICS = ("/header", "/tick", "/plan", "/event", "/result")
NUMBER, TEXT = {"type": ["number", "null"]}, {"type": ["string", "null"]}
SCHEMAS: dict[str, dict[str, Any]] = {
    "/header": {},
    "/tick": {
        **dict.fromkeys(("t", "x", "y", "beta", "gamma", "u_beta", "u_gamma"), NUMBER),
        **{f"estimate_{name}": NUMBER for name in ("t", "x", "y", "vx", "vy", "beta", "beta_dot", "gamma", "gamma_dot")},
        **dict.fromkeys(("ring", "goal_theta", "planner_ms", "tick_ms", "segment"), NUMBER),
        **dict.fromkeys(("leaf", "opening"), TEXT),
    },
    "/plan": {"t0": NUMBER, "dt": NUMBER, "states": {"type": "array"}, "controls": {"type": "array"}, "reason": TEXT},
    "/event": {"t": NUMBER, "kind": TEXT, "detail": {"type": "object"}},
    "/result": {},
}
MAGIC = b"\x89MCAP0\r\n"


def _encode(document: Any) -> bytes:
    return json.dumps(document, separators=(",", ":"), allow_nan=False).encode()


class RunLogWriter:
    """Writes one run; a context manager. Raises LogError when the file cannot be made."""

    def __init__(self, path: str | Path, header: dict[str, Any]) -> None:
        self.path, self._closed, self._sequence, self._t = Path(path), False, 0, 0.0
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            self._stream = self.path.open("wb")
        except OSError as problem:
            raise LogError(f"cannot be written: {problem.strerror}", file=self.path) from None
        self._writer = Writer(self._stream, compression=CompressionType.NONE, use_chunking=False)
        self._writer.start(profile="", library="mazeplan")
        self._channels: dict[str, int] = {}
        for topic in TOPICS:
            schema = {"type": "object", "properties": SCHEMAS[topic]}
            schema_id = self._writer.register_schema(f"mazeplan{topic.replace('/', '.')}", "jsonschema", _encode(schema))
            self._channels[topic] = self._writer.register_channel(topic, "json", schema_id)
        self._add("/header", header)

    def _add(self, topic: str, document: Any) -> None:
        if self._closed:
            return
        nanoseconds = round(self._t * 1e9)
        self._sequence += 1
        self._writer.add_message(
            self._channels[topic], nanoseconds, _encode(document), nanoseconds, self._sequence
        )
        self._stream.flush()

    def sample(self, observation: Observation, command: Command, **more: Any) -> None:
        """One tick without an estimate, as `collect` writes it."""
        self._t = observation.t
        self._add(
            "/tick",
            {
                "t": observation.t,
                "x": observation.x,
                "y": observation.y,
                "beta": observation.beta,
                "gamma": observation.gamma,
                "u_beta": command.u_beta,
                "u_gamma": command.u_gamma,
                **more,
            },
        )

    def tick(self, observation: Observation, command: Command, state: State, **more: Any) -> None:
        """One control tick: observed, commanded, estimated, and `more` (leaf, opening, goal_theta, planner_ms, tick_ms)."""
        self.sample(
            observation,
            command,
            ring=state.ring,
            estimate_t=state.t,
            estimate_x=state.x,
            estimate_y=state.y,
            estimate_vx=state.vx,
            estimate_vy=state.vy,
            estimate_beta=state.beta,
            estimate_beta_dot=state.beta_dot,
            estimate_gamma=state.gamma,
            estimate_gamma_dot=state.gamma_dot,
            **more,
        )

    def plan(self, plan: Plan) -> None:
        """One plan (its gains are left out: they follow from the rest)."""
        finite = bool(np.all(np.isfinite(plan.states))) and math.isfinite(plan.cost)
        self._add(
            "/plan",
            {
                "t0": plan.t0,
                "dt": plan.dt,
                "states": np.round(plan.states, 6).tolist() if finite else [],
                "controls": np.round(plan.controls, 6).tolist() if finite else [],
                "cost": plan.cost if finite else None,
                "reason": str(plan.reason),
                "iterations": plan.iterations,
                "ms": plan.ms,
            },
        )

    def event(self, t: float, kind: str, detail: dict[str, Any]) -> None:
        """Something that happened."""
        self._add("/event", {"t": t, "kind": kind, "detail": detail})

    def result(self, document: dict[str, Any]) -> None:
        """The outcome of the run."""
        self._add("/result", json.loads(json.dumps(document)))

    def close(self) -> None:
        """Finish the file; may be called twice."""
        if not self._closed:
            self._closed = True
            self._writer.finish()
            self._stream.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self.close()


@dataclass(frozen=True)
class RunLog:
    """A log that was read. ticks: column -> array of N (float with NaN for missing, or object for text); complete: whether
    the file was finished; False after a crash, when the last message may be missing."""

    path: Path
    header: dict[str, Any]
    ticks: dict[str, np.ndarray]
    plans: tuple[dict[str, Any], ...]
    events: tuple[dict[str, Any], ...]
    result: dict[str, Any] | None
    complete: bool


def read_log(path: str | Path) -> RunLog:
    """Read a log, also one that was cut. Raises LogError when the file is missing or is no run log of ours."""
    path = Path(path)
    try:
        with path.open("rb") as stream:
            if stream.read(len(MAGIC)) != MAGIC:
                raise LogError("not a run log: expected an MCAP file", file=path)
            stream.seek(0)
            messages, complete = _messages(stream, path)
    except OSError as problem:
        raise LogError(f"cannot be read: {problem.strerror}", file=path) from None
    by_topic: dict[str, list[dict[str, Any]]] = {topic: [] for topic in TOPICS}
    for topic, document in messages:
        if topic in by_topic:
            by_topic[topic].append(document)
    if not by_topic["/header"] or by_topic["/header"][0].get("program") != "mazeplan":
        raise LogError("not a run log: it has no header of mazeplan", file=path)
    return RunLog(
        path,
        by_topic["/header"][0],
        _columns(by_topic["/tick"]),
        tuple(by_topic["/plan"]),
        tuple(by_topic["/event"]),
        by_topic["/result"][-1] if by_topic["/result"] else None,
        complete,
    )


def _messages(stream: Any, path: Path) -> tuple[list[tuple[str, dict[str, Any]]], bool]:
    """(topic, document) of all messages, and whether the file was finished. The non-seeking reader stops where the file does."""
    topics: dict[int, str] = {}
    found: list[tuple[str, dict[str, Any]]] = []
    try:
        for record in StreamReader(stream).records:
            if isinstance(record, Channel):
                topics[record.id] = record.topic
            elif isinstance(record, Message):
                document = json.loads(record.data)
                if isinstance(document, dict):
                    found.append((topics.get(record.channel_id, ""), document))
    except EndOfFile:
        return found, False
    except (McapError, ValueError, KeyError, AssertionError) as problem:
        if found and isinstance(problem, McapError | AssertionError):
            return found, False
        raise LogError(f"damaged: {problem or type(problem).__name__}", file=path) from None
    return found, True


def _columns(ticks: list[dict[str, Any]]) -> dict[str, np.ndarray]:
    names = list(dict.fromkeys(name for tick in ticks for name in tick))
    columns = {}
    for name in names:
        values = [tick.get(name) for tick in ticks]
        if any(isinstance(value, str) for value in values):
            columns[name] = np.array(["" if value is None else str(value) for value in values], dtype=object)
        else:
            columns[name] = np.array([math.nan if value is None else float(value) for value in values])
    return columns
