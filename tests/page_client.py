"""What a browser does with the page, without a browser: takes its messages over a websocket and presses its buttons.

Also clients that do not read: one that is connected and lets everything lie.
"""

from __future__ import annotations

import socket
import threading
from time import monotonic
from typing import Any

import msgspec
import zstandard
from viser import __version__
from websockets.sync.client import ClientConnection, connect
from websockets.typing import Subprotocol

CAMERA = {
    "type": "ViewerCameraMessage", "wxyz": (1.0, 0.0, 0.0, 0.0), "position": (0.0, -2.0, 3.0), "fov": 0.75,
    "near": 0.01, "far": 1000.0, "image_height": 600, "image_width": 800, "look_at": (0.0, 0.0, 0.0),
    "up_direction": (0.0, 0.0, 1.0),
}  # fmt: skip


def joined(port: int, origin: str | None = "", **more: Any) -> ClientConnection:
    """A connection as the page's own script makes it; origin: None sends none, "" that of the page."""
    own = f"http://127.0.0.1:{port}"
    headers = {} if origin is None else {"Origin": origin or own}
    return connect(
        f"ws://127.0.0.1:{port}", subprotocols=[Subprotocol(f"viser-v{__version__}")], open_timeout=20,
        compression=None, max_size=None, additional_headers=headers, **more,
    )  # fmt: skip


def messages(data: bytes) -> list[dict[str, Any]]:
    """Those of one frame of viser: sizes, packed messages, numbers."""
    size, packed = int.from_bytes(data[:8], "little"), int.from_bytes(data[8:16], "little")
    inner = zstandard.ZstdDecompressor().decompress(data[16 : 16 + packed], max_output_size=size)
    return msgspec.msgpack.decode(inner)["messages"]


class Viewer:
    """Reads and counts, in a thread of its own. moved: times (monotonic, s) at which a scene node of a name was moved;
    buttons, commands: label -> uuid; html: uuid -> what is written there."""

    def __init__(self, port: int) -> None:
        self.connection = joined(port)
        self.moved: dict[str, list[float]] = {}
        self.buttons: dict[str, str] = {}
        self.commands: dict[str, str] = {}
        self.html: dict[str, str] = {}
        self.bytes = 0
        self._done = False
        self.say(CAMERA)
        self._thread = threading.Thread(target=self._read, daemon=True)
        self._thread.start()

    def say(self, message: dict[str, Any]) -> None:
        """Send one."""
        self.connection.send(msgspec.msgpack.encode(message))

    def press(self, label: str) -> None:
        """Click the button of that label."""
        self.say({"type": "GuiUpdateMessage", "uuid": self.buttons[label], "updates": {"value": True}})

    def trigger(self, label: str) -> None:
        """Press the key of the command of that label."""
        self.say({"type": "CommandTriggerMessage", "uuid": self.commands[label]})

    def choose(self, label: str, value: str) -> None:
        """Click one button of a group."""
        self.say({"type": "GuiUpdateMessage", "uuid": self.buttons[label], "updates": {"value": value}})

    def _read(self) -> None:
        while not self._done:
            try:
                data = self.connection.recv(timeout=0.2, decode=False)
            except TimeoutError:
                continue
            except Exception:  # the page is closed
                return
            self.bytes += len(data)
            now = monotonic()
            for message in messages(data):
                self._take(message, now)

    def _take(self, message: dict[str, Any], now: float) -> None:
        kind, props = message.get("type"), message.get("props", {})
        if kind in ("SetPositionMessage", "SetOrientationMessage"):
            self.moved.setdefault(message["name"], []).append(now)
        elif kind in ("GuiButtonMessage", "GuiButtonGroupMessage"):
            self.buttons[props["label"]] = message["uuid"]
        elif kind == "RegisterCommandMessage":
            self.commands[props["label"]] = message["uuid"]
        elif kind == "GuiHtmlMessage":
            self.html[message["uuid"]] = props["content"]
        elif kind == "GuiUpdateMessage" and "content" in message.get("updates", {}):
            self.html[message["uuid"]] = message["updates"]["content"]

    def close(self) -> None:
        """Leave."""
        self._done = True
        self.connection.close()
        self._thread.join(5.0)


class HungClient:
    """Joins, and never reads a byte: its buffers fill, and whoever sends to it and waits, hangs."""

    def __init__(self, port: int) -> None:
        self._socket = socket.create_connection(("127.0.0.1", port))
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        lines = (
            "GET / HTTP/1.1", f"Host: 127.0.0.1:{port}", f"Origin: http://127.0.0.1:{port}", "Upgrade: websocket",
            "Connection: Upgrade", "Sec-WebSocket-Version: 13", "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==",
            f"Sec-WebSocket-Protocol: viser-v{__version__}", "", "",
        )  # fmt: skip
        self._socket.sendall("\r\n".join(lines).encode())

    def close(self) -> None:
        """Leave."""
        self._socket.close()
