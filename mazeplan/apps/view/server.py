"""viser's server behind the check of `door`, on a socket that listens already.

viser has no place for a check. It serves with `serve` of websockets. While viser starts, a function of this module
replaces `serve`. The function uses our socket, and for each request it asks the door before viser.
"""

from __future__ import annotations

import asyncio
import socket
from collections.abc import Iterator
from contextlib import contextmanager
from http import HTTPStatus
from importlib.util import find_spec
from threading import Event
from typing import TYPE_CHECKING, Any

from mazeplan.apps.view.door import Door, Refusal
from mazeplan.apps.view.stop_bar import add_bar
from mazeplan.core.errors import InputError
from mazeplan.core.resources import to_install

if TYPE_CHECKING:
    from viser import ViserServer

LOOK_S = 0.02  # s between checks whether the page is ready


def check_installed() -> None:
    """Raises InputError, with the command that installs viser, if viser is missing."""
    if find_spec("viser") is None:
        raise InputError(f"the page needs viser: {to_install('view')}")


def open_server(door: Door, listening: socket.socket, ready: Event, bar: str = "") -> ViserServer:
    """viser's server. It gets a request only after the door's check.

    ready: requests wait until it is set
    bar: HTML above viser's client

    Raises RuntimeError for a viser that starts in another way and would skip the check."""
    import rich
    import viser

    rich.get_console().quiet = True  # viser prints its address on stdout, where results belong

    class Server(viser.ViserServer):
        def request_share_url(self, verbose: bool = True) -> None:
            """Do nothing: a share URL would lead through somebody else's computer."""

        def disconnect_share_url(self) -> None:
            """Nothing to disconnect."""

    with _behind(door, listening, ready, bar) as served:
        server = Server(host=door.host, port=door.port, verbose=False)
    if not served:
        server.stop()
        raise RuntimeError(f"viser {viser.__version__} does not start as expected: the page would be open to everybody")
    return server


@contextmanager
def _behind(door: Door, listening: socket.socket, ready: Event, bar: str) -> Iterator[list[bool]]:
    import websockets.asyncio.server as asyncio_server

    before, served = asyncio_server.serve, []

    def serve(handler: Any, host: Any = None, port: Any = None, **more: Any) -> Any:
        served.append(True)
        more["process_request"] = _checked(door, ready, bar, more.get("process_request"))
        return before(handler, sock=listening, **more)

    asyncio_server.serve = serve  # pyright: ignore[reportAttributeAccessIssue]
    try:
        yield served
    finally:
        asyncio_server.serve = before


def _checked(door: Door, ready: Event, bar: str, then: Any) -> Any:
    """The function that answers a request: with the door's refusal, otherwise with viser's answer."""
    from websockets.datastructures import Headers
    from websockets.http11 import Response

    def answer(refusal: Refusal) -> Response:
        body = f"{refusal.text}\n".encode()
        headers = Headers([("Content-Type", "text/plain; charset=utf-8"), ("Content-Length", str(len(body)))])
        if refusal.location:
            headers["Location"], headers["Set-Cookie"] = refusal.location, refusal.cookie
        return Response(refusal.status, HTTPStatus(refusal.status).phrase, headers, body)

    async def process_request(connection: Any, request: Any) -> Any:
        while not ready.is_set():
            await asyncio.sleep(LOOK_S)
        given = list(request.headers.raw_items())
        refusal = door.refusal(request.path, given)
        response = then(connection, request) if refusal is None else answer(refusal)
        if response is not None:
            add_bar(response, bar)
            hosts = [value for name, value in given if name.lower() == "host"]
            door.dress(response.headers, hosts[0] if hosts else f"{door.host}:{door.port}")
        return response

    return process_request
