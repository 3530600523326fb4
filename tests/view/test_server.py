"""Who may come in: headers by word, and viser itself behind the check, asked over real connections."""

from __future__ import annotations

import gzip
import threading
import urllib.error
import urllib.request
from types import SimpleNamespace

import pytest

from mazeplan.apps.view import server as server_module
from mazeplan.apps.view.page import html
from mazeplan.apps.view.server import HOST, listen, port_of, refusal, url_of
from mazeplan.core.errors import InputError

pytest.importorskip("viser")
from page_client import joined

HERE = ("Host", "127.0.0.1:8080")
SOCKET = ("Upgrade", "websocket")


@pytest.mark.parametrize(
    ("headers", "status"),
    [
        ([HERE], 0),
        ([("Host", "LOCALHOST:8080"), ("Origin", "http://localhost:8080"), SOCKET], 0),
        ([HERE, ("Origin", "http://127.0.0.1:8080"), SOCKET], 0),
        ([HERE, ("Origin", "http://evil.example"), SOCKET], 403),
        ([HERE, ("Origin", "https://127.0.0.1:8080")], 403),
        ([HERE, ("Origin", "http://127.0.0.1:8081")], 403),
        ([HERE, ("Origin", "null")], 403),
        ([("host", "127.0.0.1:8080"), ("UPGRADE", "x, WebSocket")], 403),
        ([("Host", "evil.example:8080"), ("Origin", "http://evil.example:8080"), SOCKET], 403),
        ([("Host", "127.0.0.1:8080.evil.example")], 403),
        ([("Host", "127.0.0.1")], 403),
        ([], 400),
        ([HERE, ("Host", "evil.example")], 400),
        ([HERE, ("Origin", "http://127.0.0.1:8080"), ("origin", "http://evil.example")], 400),
    ],
)
def test_only_the_page_itself_comes_in(headers, status):
    wrong = refusal(8080, headers)
    assert (0 if wrong is None else wrong[0]) == status


def test_a_taken_port_is_an_error():
    with listen(0) as taken, pytest.raises(InputError, match="cannot be listened at") as caught:
        listen(port_of(taken))
    assert caught.value.exit_status == 2
    assert taken.family.name == "AF_INET"


@pytest.fixture(scope="module")
def served():
    """viser behind the check, in this process."""
    listening = listen(0)
    url, port = url_of(listening), port_of(listening)
    ready, answers = threading.Event(), []
    server = server_module.open_server(listening, ready, html("stop_bar"))
    early = threading.Thread(target=lambda: answers.append(urllib.request.urlopen(url, timeout=10).status))
    early.start()
    pressed = []
    button = server.gui.add_button("Press")
    button.on_click(lambda event: pressed.append(event))
    assert not answers  # who comes before all is there waits
    ready.set()
    early.join(10.0)
    assert answers == [200]
    yield SimpleNamespace(url=url, port=port, server=server, pressed=pressed)
    server.stop()


@pytest.mark.parametrize("origin", [None, "http://evil.example", "null", "http://localhost:1"])
def test_a_forged_origin_presses_no_button(served, origin):
    from websockets.exceptions import InvalidStatus

    with pytest.raises(InvalidStatus) as caught:
        joined(served.port, origin)
    assert caught.value.response.status_code == 403


def test_the_page_is_for_no_frame_and_loads_from_nowhere_else(served):
    with urllib.request.urlopen(served.url, timeout=10) as answer:
        headers = dict(answer.headers)
        body = answer.read()
    assert headers["X-Frame-Options"] == "DENY"
    policy = dict(part.strip().split(" ", 1) for part in headers["Content-Security-Policy"].split(";"))
    assert policy["frame-ancestors"] == "'none'"
    assert "http" not in policy["default-src"]
    assert policy["connect-src"].split() == ["'self'", f"ws://{HOST}:{served.port}", "blob:", "data:"]
    assert b"<html" in body


def test_the_page_has_the_bar_packed_or_not(served):
    pages = []
    for packing in ("identity", "gzip"):
        request = urllib.request.Request(served.url, headers={"Accept-Encoding": packing})
        with urllib.request.urlopen(request, timeout=10) as answer:
            body = answer.read()
            assert int(answer.headers["Content-Length"]) == len(body)
        pages.append(gzip.decompress(body) if packing == "gzip" else body)
    assert pages[0] == pages[1]
    assert pages[0].count(html("stop_bar").encode()) == 1
