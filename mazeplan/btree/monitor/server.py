"""The server of Groot2's monitoring protocol: the tree, the status of each node, blackboards, breakpoints, recordings.

A request has a header of 6 bytes (protocol, type, number) and at most one more part. A reply has the header, 16 bytes
that name the tree, and at most one more part. The tree's thread writes statuses into a buffer once a tick and waits for
nobody; a thread of the server answers. A breakpoint does not stop the run, because the plate would move on: the node
returns RUNNING and the plate goes level until somebody unlocks the breakpoint.
"""

from __future__ import annotations

import json
import struct
import threading
import time
import uuid
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import msgpack
import zmq

from mazeplan.btree.monitor.tree_xml import Instance, instances, tree_xml
from mazeplan.btree.node import TreeNode
from mazeplan.btree.status import FAILURE, INVALID, RUNNING, SUCCESS, Result
from mazeplan.btree.tree import BehaviorTree
from mazeplan.core.errors import InputError

PROTOCOL = 2
HEADER = struct.Struct("<BBI")  # protocol, type, number
NODE = struct.Struct("<HB")  # number of a node, status
CODES = {"INVALID": 0, "RUNNING": 1, "SUCCESS": 2, "FAILURE": 3, "SKIPPED": 4}
ENDED = 10  # added to the code of a node that ended with this status and is idle again
KEPT = 1000  # maximum number of transitions in a recording
POLL_MS = 20
BREAKPOINT, REPLACE = 0, 1
BEFORE = 0  # position of a hook
RESULTS: dict[str, Result] = {"SUCCESS": SUCCESS, "FAILURE": FAILURE}


@dataclass
class Hook:
    """A breakpoint, or a result that takes the place of a node's tick.

    uid: number of the node
    mode: BREAKPOINT or REPLACE
    once: whether the hook is removed after it has acted
    result: what the node returns; SKIPPED: the node is ticked
    waiting: whether the run is at the breakpoint
    unlocked: whether somebody has unlocked the breakpoint"""

    uid: int
    mode: int = BREAKPOINT
    once: bool = False
    enabled: bool = True
    result: str = "SKIPPED"
    waiting: bool = False
    unlocked: bool = False

    def document(self) -> dict[str, Any]:
        """The hook in the form that Groot2 lists."""
        return {
            "enabled": self.enabled, "uid": self.uid, "mode": self.mode, "once": self.once,
            "desired_status": self.result, "position": BEFORE,
        }  # fmt: skip


class Monitor:
    """Answers Groot2 at `port`, and publishes the breakpoints that the run reaches at `port` + 1.

    Call `watch` with each tree before the tree begins. Raises InputError if a port cannot be used."""

    def __init__(self, port: int, host: str = "127.0.0.1") -> None:
        self._lock = threading.Lock()
        self._tree: BehaviorTree | None = None
        self._nodes: list[TreeNode] = []
        self._instances: tuple[Instance, ...] = ()
        self._xml, self._id = "", bytes(16)
        self._statuses: list[int] = []
        self._numbers: dict[int, int] = {}
        self._hooks: dict[int, Hook] = {}
        self._reached: deque[int] = deque()
        self._recording: float | None = None
        self._transitions: deque[bytes] = deque(maxlen=KEPT)
        self._zmq = zmq.Context()
        self._server, self._news = self._zmq.socket(zmq.REP), self._zmq.socket(zmq.PUB)
        for socket, number in ((self._server, port), (self._news, port + 1)):
            socket.setsockopt(zmq.LINGER, 0)
            try:
                socket.bind(f"tcp://{host}:{number}")
            except zmq.ZMQError as problem:
                self._zmq.destroy(linger=0)
                raise InputError(f"port {number} of {host} cannot be used: {problem}", key="--groot") from None
        self._open = True
        self._thread = threading.Thread(target=self._serve, name="groot", daemon=True)
        self._thread.start()

    def __enter__(self) -> Monitor:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Stop answering."""
        self._open = False
        self._thread.join(timeout=2.0)
        self._zmq.destroy(linger=0)

    # -- the tree's thread ------------------------------------------------------------------------------------------

    def watch(self, tree: BehaviorTree, context: object = None) -> None:
        """Show this tree from now on."""
        xml, nodes = tree_xml(tree), list(tree.nodes())
        with self._lock:
            self._tree, self._nodes, self._instances = tree, nodes, instances(tree)
            self._xml, self._id = xml, uuid.uuid4().bytes
            self._statuses = [0] * len(nodes)
            self._numbers = {id(node): i for i, node in enumerate(nodes, 1)}
            self._hooks.clear()
        tick = tree.tick

        def watched() -> Result:
            try:
                return tick()
            finally:
                self._note()

        tree.tick = watched

    def _note(self) -> None:
        """Store the statuses of this tick."""
        statuses = [
            CODES[node.last.name] + (ENDED if node.status is INVALID and node.last in (SUCCESS, FAILURE) else 0)
            for node in self._nodes
        ]
        if self._recording is not None:
            self._record(statuses)
        self._statuses = statuses  # one assignment: the server's thread reads the old list or the new one

    def _record(self, statuses: list[int]) -> None:
        since = int(1e6 * (time.monotonic() - (self._recording or 0.0)))  # us; Groot2 replays in wall time
        for i, (before, now) in enumerate(zip(self._statuses, statuses, strict=True), 1):
            if before != now:
                self._transitions.append(since.to_bytes(6, "little") + NODE.pack(i, now % ENDED))

    def before(self, node: TreeNode) -> Result | None:
        """The result that a node's hook gives in place of its tick; None: the node is ticked."""
        hook = self._hooks.get(self._numbers.get(id(node), 0))
        if hook is None or not hook.enabled:
            return None
        if hook.mode == BREAKPOINT and not hook.unlocked:
            if not hook.waiting:
                hook.waiting = True
                self._reached.append(hook.uid)
            return RUNNING
        hook.waiting = hook.unlocked = False
        if hook.once:
            self._drop(hook.uid)
        return RESULTS.get(hook.result)

    def after(self, node: TreeNode, result: Result) -> Result | None:
        """None: the result of a node stays as it is."""

    def _drop(self, uid: int) -> None:
        self._hooks.pop(uid, None)
        self._nodes[uid - 1].probe = None

    # -- the server's thread ----------------------------------------------------------------------------------------

    def _serve(self) -> None:
        while self._open:
            while self._reached:
                header = HEADER.pack(PROTOCOL, ord("N"), uuid.uuid4().int & 0xFFFFFFFF)
                self._news.send_multipart([header, str(self._reached.popleft()).encode()], zmq.NOBLOCK)
            if self._server.poll(POLL_MS):
                self._server.send_multipart(self._answer(self._server.recv_multipart()))

    def _answer(self, parts: list[bytes]) -> list[bytes]:
        if len(parts[0]) != HEADER.size:
            return [b"error", b"wrong request header"]
        _, kind, number = HEADER.unpack(parts[0])
        answer = ANSWERS.get(chr(kind))
        if answer is None:
            return [b"error", b"Request not recognized"]
        try:
            with self._lock:
                body = answer(self, parts[1] if len(parts) > 1 else b"")
        except (ValueError, KeyError, IndexError, TypeError) as problem:
            return [b"error", f"{type(problem).__name__}: {problem}".encode()]
        return [HEADER.pack(PROTOCOL, kind, number) + self._id, *([] if body is None else [body])]

    def _full_tree(self, _: bytes) -> bytes:
        return self._xml.encode()

    def _status(self, _: bytes) -> bytes:
        return b"".join(NODE.pack(i, status) for i, status in enumerate(self._statuses, 1))

    def _blackboard(self, names: bytes) -> bytes:
        wanted = names.decode().split(";")
        return msgpack.packb({i.label: _plain(i.board.values()) for i in self._instances if i.label in wanted}) or b""

    def _insert(self, text: bytes) -> None:
        given = json.loads(text)
        for document in given if isinstance(given, list) else [given]:
            if int(document["position"]) != BEFORE:
                raise ValueError("a hook behind a node: the plate has moved on; expected position 0")
            uid = int(document["uid"])
            hook = Hook(
                uid, int(document["mode"]), bool(document["once"]), bool(document["enabled"]),
                str(document["desired_status"]),
            )  # fmt: skip
            self._node(uid).probe = self
            self._hooks[uid] = hook

    def _node(self, uid: int) -> TreeNode:
        if not 1 <= uid <= len(self._nodes):
            raise ValueError("Node ID not found")
        return self._nodes[uid - 1]

    def _remove(self, text: bytes) -> None:
        uid = int(json.loads(text)["uid"])
        if uid not in self._hooks:
            raise ValueError("Node ID not found")
        self._drop(uid)

    def _unlock(self, text: bytes) -> None:
        document = json.loads(text)
        hook = self._hooks.get(int(document["uid"]))
        if hook is None:
            raise ValueError("Node ID not found")
        hook.result = str(document["desired_status"])
        hook.once = hook.once or bool(document["remove_when_done"])
        hook.unlocked = True

    def _remove_all(self, _: bytes) -> None:
        for uid in list(self._hooks):
            self._drop(uid)

    def _disable_all(self, _: bytes) -> None:
        for hook in self._hooks.values():
            hook.enabled = False

    def _dump(self, _: bytes) -> bytes:
        return json.dumps([hook.document() for hook in self._hooks.values()]).encode()

    def _toggle(self, text: bytes) -> bytes | None:
        if text == b"start":
            self._transitions.clear()
            self._recording = time.monotonic()  # the same clock as in `_record`
            return str(int(1e6 * time.time())).encode()  # the protocol asks for the time; no run depends on it
        self._recording = None
        return None

    def _changes(self, _: bytes) -> bytes:
        out = b"".join(self._transitions)
        self._transitions.clear()
        return out


ANSWERS: dict[str, Callable[[Monitor, bytes], bytes | None]] = {
    "T": Monitor._full_tree,
    "S": Monitor._status,
    "B": Monitor._blackboard,
    "I": Monitor._insert,
    "R": Monitor._remove,
    "U": Monitor._unlock,
    "A": Monitor._remove_all,
    "X": Monitor._disable_all,
    "D": Monitor._dump,
    "r": Monitor._toggle,
    "t": Monitor._changes,
}


def _plain(values: dict[str, Any]) -> dict[str, Any]:
    """The values, with those that MessagePack cannot hold as text."""
    return {
        name: value if isinstance(value, bool | int | float | str) else str(value) for name, value in values.items()
    }
