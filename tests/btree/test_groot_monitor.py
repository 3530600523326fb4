"""Groot2's protocol, asked by a client that was written from its description."""

from __future__ import annotations

import json
import socket
import struct

import pytest
from lxml import etree  # pyright: ignore[reportAttributeAccessIssue]  # compiled, without stubs

zmq = pytest.importorskip("zmq", reason="the extra groot is not installed")
msgpack = pytest.importorskip("msgpack", reason="the extra groot is not installed")

import mazeplan  # noqa: E402
from mazeplan.behavior.trees import load_tree  # noqa: E402
from mazeplan.btree.builtin_leaves import BUILTIN_LEAVES  # noqa: E402
from mazeplan.btree.monitor.server import Monitor  # noqa: E402
from mazeplan.btree.monitor.tree_xml import tree_xml  # noqa: E402
from mazeplan.btree.status import FAILURE, RUNNING, SUCCESS  # noqa: E402
from mazeplan.core.errors import InputError  # noqa: E402

TREE = """<root BTCPP_format="4" main_tree_to_execute="Main">
<BehaviorTree ID="Main"><Sequence name="both">
  <Script code="n := 3; word := 'red'"/>
  <SubTree ID="Inner" value="{n}"/>
  <Sleep msec="1000"/>
</Sequence></BehaviorTree>
<BehaviorTree ID="Inner"><ScriptCondition code="value == 3"/></BehaviorTree>
</root>"""


class Clock:
    now = 0.0

    def clock(self):
        return self.now

    def failed(self, failure):
        pass


class Client:
    """The asking side."""

    def __init__(self, port):
        self.zmq = zmq.Context()
        self.socket = self.zmq.socket(zmq.REQ)
        self.socket.setsockopt(zmq.RCVTIMEO, 5000)
        self.socket.setsockopt(zmq.LINGER, 0)
        self.socket.connect(f"tcp://127.0.0.1:{port}")
        self.news = self.zmq.socket(zmq.SUB)
        self.news.setsockopt(zmq.RCVTIMEO, 5000)
        self.news.setsockopt(zmq.LINGER, 0)
        self.news.subscribe(b"")
        self.news.connect(f"tcp://127.0.0.1:{port + 1}")

    def ask(self, kind, *more):
        self.socket.send_multipart([struct.pack("<BBI", 2, ord(kind), 77), *more])
        return self.socket.recv_multipart()

    def statuses(self):
        body = self.ask("S")[1]
        return [struct.unpack_from("<HB", body, at) for at in range(0, len(body), 3)]

    def close(self):
        self.zmq.destroy(linger=0)


def free_port():
    with socket.socket() as one:
        one.bind(("127.0.0.1", 0))
        return one.getsockname()[1]


@pytest.fixture
def watched():
    port = free_port()
    run = Clock()
    tree = load_tree(TREE, BUILTIN_LEAVES, run)
    with Monitor(port) as monitor:
        monitor.watch(tree)
        client = Client(port)
        yield tree, run, client
        client.close()


def test_the_tree_has_numbers_paths_and_models(watched):
    _, _, client = watched
    header, body = client.ask("T")
    assert len(header) == 22
    assert struct.unpack("<BBI", header[:6]) == (2, ord("T"), 77)
    root = etree.fromstring(body)
    trees = root.findall("BehaviorTree")
    assert [(t.get("ID"), t.get("_fullpath")) for t in trees] == [("Main", ""), ("Inner", "Inner::3")]
    assert [e.get("_uid") for t in trees for e in t.iter() if e is not t] == ["1", "2", "3", "5", "4"]
    assert root.find("TreeNodesModel/Action[@ID='Sleep']/input_port").get("name") == "msec"


TWICE = """<root BTCPP_format="4" main_tree_to_execute="Main">
<BehaviorTree ID="Main"><Sequence><SubTree ID="Inner"/><SubTree ID="Inner"/><SubTree ID="Inner" name="last"/></Sequence>
</BehaviorTree>
<BehaviorTree ID="Inner"><Sequence><SubTree ID="Deep"/><SubTree ID="Deep" name="deep"/></Sequence></BehaviorTree>
<BehaviorTree ID="Deep"><AlwaysSuccess/></BehaviorTree></root>"""


def test_each_use_of_a_tree_has_a_path_of_its_own_with_its_number_unless_it_has_a_name():
    root = etree.fromstring(tree_xml(load_tree(TWICE, BUILTIN_LEAVES, Clock())).encode())
    paths = [t.get("_fullpath") for t in root.findall("BehaviorTree")]
    assert paths == [
        "", "Inner::2", "Inner::2/Deep::4", "Inner::2/deep", "Inner::8", "Inner::8/Deep::10", "Inner::8/deep",
        "last", "last/Deep::16", "last/deep",
    ]  # fmt: skip
    assert [e.get("_fullpath") for e in root.iter("SubTree")][:3] == ["Inner::2", "Inner::8", "last"]
    assert [e.get("_uid") for e in root.iter("SubTree")][:2] == ["2", "8"]


def test_the_statuses_are_those_of_the_last_tick(watched):
    tree, run, client = watched
    assert client.statuses() == [(i, 0) for i in range(1, 6)]
    assert tree.tick() is RUNNING
    assert client.statuses() == [(1, 1), (2, 2), (3, 2), (4, 12), (5, 1)]
    run.now = 2.0
    assert tree.tick() is SUCCESS
    assert client.statuses() == [(1, 12), (2, 12), (3, 12), (4, 12), (5, 12)]


def test_blackboards_by_the_names_of_their_trees(watched):
    tree, _, client = watched
    tree.tick()
    dump = msgpack.unpackb(client.ask("B", b"Main;Inner::3")[1])
    assert dump["Main"] == {"n": 3, "word": "red"}
    assert dump["Inner::3"] == {}


def hook(uid, mode, result="SUCCESS", once=False, position=0):
    given = {"enabled": True, "uid": uid, "mode": mode, "once": once, "desired_status": result, "position": position}
    return json.dumps(given).encode()


def test_a_breakpoint_holds_its_node_and_not_the_run(watched):
    tree, _, client = watched
    client.ask("S")
    assert client.news.poll(10) == 0
    client.ask("I", hook(2, 0))
    for _ in range(3):
        assert tree.tick() is RUNNING
    assert client.statuses()[1] == (2, 1)
    assert "n" not in tree.blackboard
    assert client.news.recv_multipart()[1] == b"2"
    unlock = {"uid": 2, "position": 0, "desired_status": "SKIPPED", "remove_when_done": True}
    client.ask("U", json.dumps(unlock).encode())
    tree.tick()
    assert tree.blackboard.get("n") == 3
    assert json.loads(client.ask("D")[1]) == []


def test_a_hook_may_take_the_place_of_a_node(watched):
    tree, _, client = watched
    client.ask("I", b"[" + hook(2, 1, "FAILURE") + b"]")
    assert json.loads(client.ask("D")[1])[0]["uid"] == 2
    assert tree.tick() is FAILURE
    client.ask("X", b"")
    assert tree.tick() is RUNNING
    client.ask("A")
    assert json.loads(client.ask("D")[1]) == []


def test_a_recording_has_each_change_of_status(watched):
    tree, _, client = watched
    assert int(client.ask("r", b"start")[1]) > 0
    tree.tick()
    body = client.ask("t")[1]
    changes = [struct.unpack_from("<HB", body, at + 6) for at in range(0, len(body), 9)]
    assert changes == [(1, 1), (2, 2), (3, 2), (4, 2), (5, 1)]
    assert len(client.ask("r", b"stop")) == 1


@pytest.mark.parametrize(
    ("kind", "more", "said"),
    [
        ("?", (), b"not recognized"),
        ("I", (b"nothing",), b"JSONDecodeError"),
        ("I", (hook(99, 0),), b"Node ID not found"),
        ("I", (hook(1, 0, position=1),), b"expected position 0"),
        ("R", (b'{"uid": 1}',), b"Node ID not found"),
        ("U", (b'{"uid": 1}',), b"Node ID not found"),
    ],
)
def test_a_bad_request_is_answered_by_an_error(watched, kind, more, said):
    answer = watched[2].ask(kind, *more)
    assert answer[0] == b"error"
    assert said in answer[1]


def test_a_header_of_another_size_is_answered_by_an_error(watched):
    client = watched[2]
    client.socket.send(b"nothing")
    assert client.socket.recv_multipart() == [b"error", b"wrong request header"]


def test_a_port_in_use_is_named():
    port = free_port()
    with Monitor(port), pytest.raises(InputError, match=f"port {port} of 127.0.0.1 cannot be used"):
        Monitor(port)


@pytest.mark.slow
def test_a_client_that_hangs_does_not_hold_a_run():
    port = free_port()
    with Monitor(port) as monitor:
        hanging = Client(port)
        hanging.socket.send_multipart([struct.pack("<BBI", 2, ord("T"), 1)])  # and never takes the answer
        seen = mazeplan.navigate("ring1", "ring5", seed=3, watch=monitor.watch)
        hanging.close()
    plain = mazeplan.navigate("ring1", "ring5", seed=3)
    assert seen.success
    assert seen.time_s == pytest.approx(plain.time_s, abs=0.5)  # plans end by the clock on a busy machine
