"""Checks each request to the page before viser sees it, because viser itself checks nothing.

A page of another origin can make a browser connect to any port of this machine, but it cannot forge these headers:

    Host     the name that the browser talks to. The loopback accepts only its own names, so that a stranger's name
             for 127.0.0.1 (DNS rebinding) is useless.
    Origin   the page that asks. It must be this page. A websocket, which carries the orders, must have one.
    token    beyond the loopback the first visit needs the printed URL, later visits need a cookie of this page.

No other page may show this page in a frame, because a visitor could press its buttons without seeing them. This page
may load nothing from elsewhere.
"""

from __future__ import annotations

import hmac
import ipaddress
import secrets
import socket
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any
from urllib.parse import parse_qs, urlsplit

from mazeplan.core.errors import InputError

BACKLOG = 64
POLICY = (
    "default-src 'self' 'unsafe-inline' 'unsafe-eval' blob: data:; connect-src 'self' ws://{host} blob: data:; "
    "frame-ancestors 'none'; form-action 'none'; base-uri 'none'; object-src 'none'"
)


@dataclass(frozen=True)
class Refusal:
    """The answer to a request that does not reach viser: a bad request, or a visit with the token.

    location, cookie: a visit with the token is redirected there, with this cookie"""

    status: int
    text: str
    location: str = ""
    cookie: str = ""


@dataclass(frozen=True)
class Door:
    """The check of a page at a host and port. token: None if none is needed"""

    host: str
    port: int
    token: str | None = None

    @staticmethod
    def at(host: str, port: int) -> Door:
        """The door at a host and port, with a new token unless the host is the loopback."""
        return Door(host, port, None if is_loopback(host) else secrets.token_urlsafe(24))

    @property
    def url(self) -> str:
        """The URL for a person, with the token."""
        everywhere = {"0.0.0.0": socket.gethostname(), "::": socket.gethostname()}
        name = everywhere.get(self.host, self.host)
        way = f"http://{f'[{name}]' if ':' in name else name}:{self.port}/"
        return way if self.token is None else f"{way}?token={self.token}"

    @property
    def cookie_name(self) -> str:
        """Name of the cookie. It contains the port, because a browser sends a cookie to all ports of a machine."""
        return f"mazeplan_{self.port}"

    def refusal(self, path: str, headers: Sequence[tuple[str, str]]) -> Refusal | None:
        """What is wrong with a request, judged by its path and headers; None for a good request."""
        hosts, origins, upgrades, cookies = (
            _all(headers, name) for name in ("host", "origin", "upgrade", "cookie")
        )  # fmt: skip
        if len(hosts) != 1 or len(origins) > 1:
            return Refusal(400, "one Host and at most one Origin are expected")
        if self.token is None and hosts[0].lower() not in self._names():
            return Refusal(403, f"this page is at {self.url}")
        if upgrades and not origins:
            return Refusal(403, "a websocket needs an Origin")
        if origins and origins[0].lower() != f"http://{hosts[0].lower()}":
            return Refusal(403, "pages of other origins may not come in")
        if self.token is None:
            return None
        return self._without_token(path, cookies)

    def _without_token(self, path: str, cookies: Sequence[str]) -> Refusal | None:
        token = str(self.token)
        shown = parse_qs(urlsplit(path).query).get("token", [])
        if any(_same(got, token) for got in shown):
            cookie = f"{self.cookie_name}={token}; Path=/; HttpOnly; SameSite=Strict"
            return Refusal(303, "come in", location="/", cookie=cookie)
        pairs = (part.strip().partition("=") for cookie in cookies for part in cookie.split(";"))
        if any(name == self.cookie_name and _same(value, token) for name, _, value in pairs):
            return None
        return Refusal(403, "open the page by the URL that mazeplan printed: it has a token")

    def _names(self) -> tuple[str, ...]:
        names = {"127.0.0.1", "localhost", "[::1]", f"[{self.host}]" if ":" in self.host else self.host.lower()}
        return tuple(f"{name}:{self.port}" for name in names) + (tuple(names) if self.port == 80 else ())

    def dress(self, headers: Any, host: str) -> None:
        """Add to an answer the headers that forbid frames and loading from elsewhere."""
        headers["Content-Security-Policy"] = POLICY.format(host=host)
        headers["X-Frame-Options"] = "DENY"
        headers["X-Content-Type-Options"] = "nosniff"
        headers["Referrer-Policy"] = "no-referrer"
        headers["Cross-Origin-Resource-Policy"] = "same-origin"
        headers["Cache-Control"] = "no-store"


def is_loopback(host: str) -> bool:
    """Whether only this machine can reach the host."""
    if host == "localhost":
        return True
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False


def listen(host: str, port: int) -> socket.socket:
    """A socket that listens at exactly this host and port. Raises InputError for a port that is taken."""
    if not 0 <= port <= 65535:
        raise InputError(f"--port: got {port}, expected 0 to 65535")
    try:
        family, kind, protocol, _, place = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0]
    except (OSError, UnicodeError):
        raise InputError(f"--host: got {host!r}, expected an address or a name of this machine") from None
    opened = socket.socket(family, kind, protocol)
    try:
        opened.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        opened.bind(place)
        opened.listen(BACKLOG)
    except OSError as problem:
        opened.close()
        why = problem.strerror or problem
        raise InputError(f"--port: {host}:{port} cannot be listened at: {why}; expected a free one") from None
    return opened


def _all(headers: Sequence[tuple[str, str]], name: str) -> list[str]:
    return [value.strip() for key, value in headers if key.lower() == name]


def _same(a: str, b: str) -> bool:
    return hmac.compare_digest(a.encode(), b.encode())
