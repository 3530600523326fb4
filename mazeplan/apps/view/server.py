"""viser's server on this machine alone, behind a check of each request; and the bar with the emergency stop.

viser itself checks nothing. A page of another origin can make a browser connect to any port of this machine, but it
cannot forge these headers:

    Host     the name that the browser talks to: only names of this machine, so that a stranger's name for 127.0.0.1
             (DNS rebinding) is useless.
    Origin   the page that asks. It must be this page. A websocket, which carries the orders, must have one.

No other page may show this page in a frame, because a visitor could press its buttons without seeing them. This page
may load nothing from elsewhere.

viser has no place for a check. It serves with `serve` of websockets. While viser starts, a function of this module
replaces `serve`. The function uses our socket, and checks each request before viser.

The bar is no part of viser's client: no panel covers, scrolls or folds it. The bar and the Escape key trigger viser's
command for Escape, also while a text field has the focus.
"""

from __future__ import annotations

import asyncio
import gzip
import socket
from collections.abc import Sequence
from http import HTTPStatus
from importlib.util import find_spec
from threading import Event
from typing import TYPE_CHECKING, Any

from mazeplan.core.errors import InputError
from mazeplan.core.resources import to_install

if TYPE_CHECKING:
    from viser import ViserServer

HOST = "127.0.0.1"
BACKLOG = 64
LOOK_S = 0.02  # s between checks whether the page is ready
POLICY = (
    "default-src 'self' 'unsafe-inline' 'unsafe-eval' blob: data:; connect-src 'self' ws://{host} blob: data:; "
    "frame-ancestors 'none'; form-action 'none'; base-uri 'none'; object-src 'none'"
)
ROOT = b'<div id="root">'  # the bar precedes it


def check_installed() -> None:
    """Raises InputError, with the command that installs viser, if viser is missing."""
    if find_spec("viser") is None:
        raise InputError(f"the page needs viser: {to_install('view')}")


def listen(port: int) -> socket.socket:
    """A socket that listens at a port of this machine; 0: any free one. Raises InputError for a port that is taken."""
    opened = socket.socket()
    try:
        opened.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        opened.bind((HOST, port))
        opened.listen(BACKLOG)
    except OSError as problem:
        opened.close()
        raise InputError(f"--port: {port} cannot be listened at: {problem.strerror}; expected a free one") from None
    return opened


def port_of(listening: socket.socket) -> int:
    """The port of a socket."""
    return int(listening.getsockname()[1])


def url_of(listening: socket.socket) -> str:
    """The address of the page, for a person."""
    return f"http://{HOST}:{port_of(listening)}/"


def refusal(port: int, headers: Sequence[tuple[str, str]]) -> tuple[int, str] | None:
    """Status and text of the answer to a bad request, judged by its headers; None for a good request."""
    hosts, origins, upgrades = (
        [value.strip().lower() for key, value in headers if key.lower() == name]
        for name in ("host", "origin", "upgrade")
    )
    if len(hosts) != 1 or len(origins) > 1:
        return 400, "one Host and at most one Origin are expected"
    if hosts[0] not in (f"{HOST}:{port}", f"localhost:{port}"):
        return 403, f"this page is at http://{HOST}:{port}/"
    if upgrades and not origins:
        return 403, "a websocket needs an Origin"
    if origins and origins[0] != f"http://{hosts[0]}":
        return 403, "pages of other origins may not come in"
    return None


def open_server(listening: socket.socket, ready: Event, bar: str = "") -> ViserServer:
    """viser's server. It gets a request only after the check.

    ready: requests wait until it is set
    bar: HTML above viser's client

    Raises RuntimeError for a viser that starts in another way and would skip the check."""
    import rich
    import viser
    import websockets.asyncio.server as asyncio_server

    rich.get_console().quiet = True  # viser prints its address on stdout, where results belong
    before, served = asyncio_server.serve, []

    def serve(handler: Any, host: Any = None, port: Any = None, **more: Any) -> Any:
        served.append(True)
        more["process_request"] = _checked(port_of(listening), ready, bar, more.get("process_request"))
        return before(handler, sock=listening, **more)

    asyncio_server.serve = serve  # pyright: ignore[reportAttributeAccessIssue]
    try:
        server = viser.ViserServer(host=HOST, port=port_of(listening), verbose=False)
    finally:
        asyncio_server.serve = before
    if not served:
        server.stop()
        raise RuntimeError(f"viser {viser.__version__} does not start as expected: the page would be open to everybody")
    return server


def _checked(port: int, ready: Event, bar: str, then: Any) -> Any:
    """The function that answers a request: with a refusal, otherwise with viser's answer."""
    from websockets.datastructures import Headers
    from websockets.http11 import Response

    async def process_request(connection: Any, request: Any) -> Any:
        while not ready.is_set():
            await asyncio.sleep(LOOK_S)
        wrong = refusal(port, list(request.headers.raw_items()))
        if wrong is not None:
            status, text = wrong
            headers = Headers([("Content-Type", "text/plain; charset=utf-8"), ("Content-Length", str(len(text)))])
            return Response(status, HTTPStatus(status).phrase, headers, text.encode())
        response = then(connection, request)
        if response is not None:
            _add_bar(response, bar)
            response.headers["Content-Security-Policy"] = POLICY.format(host=request.headers["Host"])
            response.headers["X-Frame-Options"] = "DENY"
            response.headers["Cache-Control"] = "no-store"
        return response

    return process_request


def _add_bar(response: Any, bar: str) -> None:
    """If viser's answer is its page, put the bar above the client."""
    if not bar or not response.body or not response.headers.get("Content-Type", "").startswith("text/html"):
        return
    packed = response.headers.get("Content-Encoding") == "gzip"
    page = gzip.decompress(response.body) if packed else response.body
    before, root, after = page.rpartition(ROOT)
    page = before + bar.encode() + root + after
    response.body = gzip.compress(page, mtime=0) if packed else page
    del response.headers["Content-Length"]
    response.headers["Content-Length"] = str(len(response.body))
