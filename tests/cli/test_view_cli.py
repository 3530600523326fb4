"""`mazeplan view`: with what cannot be shown one line and exit status 2; how it ends, and which map it edits."""

from __future__ import annotations

import signal
import socket
import subprocess
import sys

import pytest
from commands import call

from mazeplan.data.runlog import RunLogWriter

pytest.importorskip("viser")


@pytest.fixture
def log(tmp_path):
    path = tmp_path / "run.mcap"
    with RunLogWriter(path, {}):
        pass
    return path


@pytest.fixture
def refused(monkeypatch, capsys):
    def view(*arguments: object) -> str:
        code, out, err = call(monkeypatch, capsys, "view", *arguments)
        assert (code, out, err.count("\n")) == (2, "", 1)
        return err

    return view


def test_logs_that_cannot_be_shown(refused, log, tmp_path):
    other = tmp_path / "other.mcap"
    other.write_text("no log")
    assert "run.mcap: holds no tick" in refused(log)
    assert "other.mcap: got " in refused(other)
    assert "none.mcap: no such file, expected a run log" in refused(tmp_path / "none.mcap")
    assert "got 3 logs, expected one, or two" in refused(log, log, log)
    assert "--edit: got a log as well" in refused(log, "--edit")


def test_maps_that_cannot_be_edited(refused, tmp_path):
    bad = tmp_path / "bad.yaml"
    bad.write_text("name: a\nrings: [\n")
    assert "bad.yaml:3: not valid YAML" in refused("--map", bad, "--edit")
    assert "packaged" in refused("--map", "nowhere", "--edit")


def test_a_port_that_is_taken_is_an_error(refused):
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        assert f"127.0.0.1:{port} cannot be listened at" in refused("--map", "cme", "--edit", "--port", port)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_an_open_page_ends_with_0_by_whatever_signal_and_edits_cme_where_no_map_is_named(tmp_path, number):
    command = [sys.executable, "-m", "mazeplan", "view", "--edit", "--port", "0"]
    with subprocess.Popen(
        command, cwd=tmp_path, stderr=subprocess.PIPE, text=True,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler),
    ) as running:  # fmt: skip
        assert running.stderr is not None
        told = [running.stderr.readline() for _ in range(2)]
        assert told[0] == f"map: cme, saved as {tmp_path / 'cme.yaml'}\n"
        assert told[1].startswith("page: http://127.0.0.1:")
        if number == signal.SIGTERM:
            running.stderr.close()  # nobody reads any more
        running.send_signal(number)
        try:
            assert running.wait(60) == 0
        finally:
            running.kill()


def test_nobody_has_to_read_what_a_page_says(monkeypatch):
    refused = []

    class Gone:
        def write(self, text=""):
            refused.append(text)
            raise BrokenPipeError

        flush = write

    from mazeplan.view.serving import edit_map

    monkeypatch.setattr(sys, "stderr", Gone())
    edit_map("cme", "127.0.0.1", 0, on=lambda: False)
    assert any(refused)  # it had something to say, and went on to its end
