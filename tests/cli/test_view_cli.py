"""`view`: bad input, its end, and the map that it edits."""

from __future__ import annotations

import signal
import socket
import sys

import pytest
from commands import start

from mazeplan.core.logs.run_log import RunLogWriter

pytest.importorskip("viser")


def test_logs_that_cannot_be_shown(refused, tmp_path):
    log, other = tmp_path / "run.mcap", tmp_path / "other.mcap"
    with RunLogWriter(log, {}):
        pass
    other.write_text("no log")
    for words, message in (
        ((log,), "run.mcap: holds no tick"),
        ((other,), "other.mcap: got "),
        ((tmp_path / "none.mcap",), "none.mcap: no such file, expected a run log"),
        ((log, log, log), "got 3 logs, expected one, or two"),
        ((log, "--edit"), "run.mcap, a log, expected a map; to see the log, leave out --edit"),
    ):
        assert message in refused("view", *words)


def test_maps_that_cannot_be_edited(refused, tmp_path):
    bad = tmp_path / "bad.yaml"
    bad.write_text("name: a\nrings: [\n")
    assert "bad.yaml:3: not valid YAML" in refused("view", "--map", bad, "--edit")
    assert "packaged" in refused("view", "--map", "nowhere", "--edit")
    assert "bad.yaml:3: not valid YAML" in refused("view", "--edit", bad)
    assert "expected one map" in refused("view", "--edit", bad, "--map", "cme")
    assert "expected one map" in refused("view", "--edit", bad, bad)


def test_the_map_to_edit_may_be_the_argument_or_that_of_the_option(call, monkeypatch):
    edited = []
    monkeypatch.setattr("mazeplan.apps.view.serving.edit_map", lambda source, host, port: edited.append(source))
    for words in (("mine.yaml",), ("--map", "mine.yaml"), ("seven",), ()):
        assert call("view", "--edit", *words)[0] == 0
    assert edited == ["mine.yaml", "mine.yaml", "seven", "cme"]


def test_a_map_in_the_place_of_a_log_is_told_how_to_edit_it(refused, tmp_path):
    mine = tmp_path / "mine.yaml"
    mine.write_text("name: a\n")
    assert f"to edit a map: mazeplan view --edit {mine}" in refused("view", mine)


def test_a_port_that_is_taken(refused):
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        message = f"127.0.0.1:{port} cannot be listened at"
        assert message in refused("view", "--map", "cme", "--edit", "--port", port)


@pytest.mark.slow
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_closes_the_page_with_status_0_and_cme_is_the_default_map(tmp_path, number):
    with start("view", "--edit", "--port", "0", cwd=tmp_path, stdout=None) as running:
        assert running.stderr is not None
        assert running.stderr.readline() == f"map: cme, saved as {tmp_path / 'cme.yaml'}\n"
        assert running.stderr.readline().startswith("page: http://127.0.0.1:")
        if number == signal.SIGTERM:
            running.stderr.close()  # nobody reads any more
        running.send_signal(number)
        try:
            assert running.wait(60) == 0
        finally:
            running.kill()


def test_a_page_needs_no_reader_of_its_messages(monkeypatch):
    refused = []

    class Gone:
        def write(self, text=""):
            refused.append(text)
            raise BrokenPipeError

        flush = write

    from mazeplan.apps.view.serving import edit_map

    monkeypatch.setattr(sys, "stderr", Gone())
    edit_map("cme", "127.0.0.1", 0, on=lambda: False)
    assert any(refused)  # it printed, and went on to its end
