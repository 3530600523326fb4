"""Who may come in. Cases by word, and viser itself behind the door, asked over real connections."""

from __future__ import annotations

import gzip
import threading
import urllib.error
import urllib.request
from types import SimpleNamespace

import pytest
from soon import soon

from mazeplan.apps.view import server as server_module
from mazeplan.apps.view.door import Door, is_loopback, listen
from mazeplan.apps.view.server import check_installed
from mazeplan.apps.view.stop_bar import ARROWS
from mazeplan.core.errors import InputError
from mazeplan.core.resources import to_install

pytest.importorskip("viser")
from page_client import Viewer, joined

LOCAL = Door("127.0.0.1", 8080)
TOKEN = Door("192.0.2.7", 8080, "secret")
SOCKET = [("Upgrade", "websocket"), ("Connection", "Upgrade")]


def status(door, *headers, path="/"):
    refusal = door.refusal(path, headers)
    return 0 if refusal is None else refusal.status


@pytest.mark.parametrize("host", ["127.0.0.1:8080", "localhost:8080", "LOCALHOST:8080", "[::1]:8080"])
def test_the_page_itself_comes_in(host):
    assert status(LOCAL, ("Host", host)) == 0
    assert status(LOCAL, ("Host", host), ("Origin", f"http://{host}"), *SOCKET) == 0


@pytest.mark.parametrize(
    "origin", ["http://evil.example", "https://127.0.0.1:8080", "http://127.0.0.1:8081", "http://127.0.0.1", "null", ""]
)
def test_pages_of_other_origins_do_not(origin):
    assert status(LOCAL, ("Host", "127.0.0.1:8080"), ("Origin", origin), *SOCKET) == 403
    assert status(LOCAL, ("Host", "127.0.0.1:8080"), ("Origin", origin)) == 403


def test_a_websocket_without_an_origin_does_not_whatever_the_case_of_its_words():
    for upgrade in ("websocket", "WebSocket", "x, websocket"):
        assert status(LOCAL, ("host", "127.0.0.1:8080"), ("UPGRADE", upgrade)) == 403


@pytest.mark.parametrize("host", ["evil.example:8080", "127.0.0.1", "127.0.0.1:80", "127.0.0.1:8080.evil.example", ""])
def test_a_name_that_was_made_to_mean_this_machine_does_not(host):
    assert status(LOCAL, ("Host", host), ("Origin", f"http://{host}"), *SOCKET) == 403
    assert status(LOCAL, ("Host", host)) == 403


def test_two_hosts_or_origins_are_none():
    host = ("Host", "127.0.0.1:8080")
    assert status(LOCAL) == 400
    assert status(LOCAL, host, ("Host", "evil.example")) == 400
    assert status(LOCAL, host, ("Origin", "http://127.0.0.1:8080"), ("origin", "http://evil.example")) == 400


def test_elsewhere_than_on_the_loopback_a_token_opens_and_a_cookie_keeps_open():
    host = ("Host", "192.0.2.7:8080")
    assert status(TOKEN, host) == 403
    assert status(TOKEN, host, path="/?token=guess") == 403
    refusal = TOKEN.refusal("/?token=secret", [host])
    assert (refusal.status, refusal.location) == (303, "/")
    assert {"HttpOnly", "SameSite=Strict", "Path=/"} <= set(refusal.cookie.split("; "))
    cookie = ("Cookie", f"other=1; {refusal.cookie.split(';')[0]}")
    assert status(TOKEN, host, cookie) == 0
    assert status(TOKEN, host, cookie, ("Origin", "http://192.0.2.7:8080"), *SOCKET) == 0
    assert status(TOKEN, host, cookie, ("Origin", "http://evil.example"), *SOCKET) == 403
    assert status(TOKEN, host, ("Cookie", "mazeplan_8080=guess"), ("Origin", "http://192.0.2.7:8080"), *SOCKET) == 403


def test_a_token_is_made_where_others_could_come():
    assert Door.at("127.0.0.1", 1).token is None
    assert Door.at("::1", 1).token is None
    assert Door.at("localhost", 1).token is None
    for host in ("0.0.0.0", "::", "192.0.2.7", "example.org"):
        one, other = Door.at(host, 1), Door.at(host, 1)
        assert one.token != other.token
        assert len(one.token) >= 32
        assert one.url.endswith(f"?token={one.token}")
    assert not is_loopback("127.0.0.1.evil.example")


def test_a_taken_port_is_an_error():
    with listen("127.0.0.1", 0) as taken:
        port = taken.getsockname()[1]
        with pytest.raises(InputError, match=f"--port: 127.0.0.1:{port} cannot be listened at") as caught:
            listen("127.0.0.1", port)
        assert caught.value.exit_status == 2
    with pytest.raises(InputError, match="expected 0 to 65535"):
        listen("127.0.0.1", 70000)
    with pytest.raises(InputError, match="--host"):
        listen("no such host", 8080)


def test_without_viser_one_line_tells_how_to_have_it(monkeypatch):
    monkeypatch.setattr(server_module, "find_spec", lambda name: None)
    with pytest.raises(InputError, match=r"needs viser: ") as refused:
        check_installed()
    assert to_install("view") in str(refused.value)


@pytest.fixture(scope="module")
def served():
    """viser behind a door, in this process."""
    listening = listen("127.0.0.1", 0)
    door = Door.at("127.0.0.1", listening.getsockname()[1])
    ready, answers = threading.Event(), []
    server = server_module.open_server(door, listening, ready)
    early = threading.Thread(target=lambda: answers.append(urllib.request.urlopen(door.url, timeout=10).status))
    early.start()
    pressed = []
    button = server.gui.add_button("Press")
    button.on_click(lambda event: pressed.append(event))
    assert not answers  # who comes before all is there waits
    ready.set()
    early.join(10.0)
    assert answers == [200]
    yield SimpleNamespace(door=door, server=server, button=button, pressed=pressed)
    server.stop()


@pytest.mark.parametrize("origin", [None, "http://evil.example", "null", "http://localhost:1"])
def test_a_forged_origin_presses_no_button(served, origin):
    from websockets.exceptions import InvalidStatus

    with pytest.raises(InvalidStatus) as caught:
        joined(served.door.port, origin)
    assert caught.value.response.status_code == 403


def test_the_page_itself_presses(served):
    """So that the refusals above are of the origin, and of nothing else."""
    viewer = Viewer(served.door.port)
    assert soon(lambda: "Press" in viewer.buttons and served.server.get_clients())
    viewer.press("Press")
    assert soon(lambda: served.pressed)
    viewer.close()


def test_the_page_is_for_no_frame_and_loads_from_nowhere_else(served):
    with urllib.request.urlopen(served.door.url, timeout=10) as answer:
        headers = dict(answer.headers)
        body = answer.read()
    assert headers["X-Frame-Options"] == "DENY"
    policy = dict(part.strip().split(" ", 1) for part in headers["Content-Security-Policy"].split(";"))
    assert policy["frame-ancestors"] == "'none'"
    assert "http" not in policy["default-src"]
    assert policy["connect-src"].split() == ["'self'", f"ws://127.0.0.1:{served.door.port}", "blob:", "data:"]
    assert b"<html" in body


def test_another_name_for_this_machine_gets_no_page(served):
    request = urllib.request.Request(served.door.url, headers={"Host": f"evil.example:{served.door.port}"})
    with pytest.raises(urllib.error.HTTPError) as caught:
        urllib.request.urlopen(request, timeout=10)
    assert caught.value.code == 403
    caught.value.close()


def test_nothing_leads_through_a_computer_of_others(served):
    assert served.server.request_share_url() is None


def test_the_page_begins_with_the_script_packed_or_not(served):
    pages = []
    for packing in ("identity", "gzip"):
        request = urllib.request.Request(served.door.url, headers={"Accept-Encoding": packing})
        with urllib.request.urlopen(request, timeout=10) as answer:
            body = answer.read()
            assert int(answer.headers["Content-Length"]) == len(body)
        pages.append(gzip.decompress(body) if packing == "gzip" else body)
    assert pages[0] == pages[1]
    assert pages[0].index(ARROWS.encode()) < pages[0].index(b"<meta")
    assert pages[0].count(b"<script>") == 1
    with urllib.request.urlopen(served.door.url, timeout=10) as answer:  # once more, as another browser does
        assert answer.read() == pages[0]
