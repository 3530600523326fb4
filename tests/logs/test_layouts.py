"""The layouts in docs/layouts name only what a log has; the program of docs/logs.md reads one."""

from __future__ import annotations

import subprocess
import sys
import xml.etree.ElementTree as ET
from pathlib import Path

import pages

from mazeplan.core.logs.run_log import SCHEMAS, RunLogWriter
from mazeplan.core.records import Command, Observation

LAYOUTS = Path(__file__).resolve().parents[2] / "docs" / "layouts"


def test_plotjuggler_shows_fields_that_there_are():
    curves = [curve.attrib["name"] for curve in ET.parse(LAYOUTS / "plotjuggler.xml").getroot().iter("curve")]
    assert len(curves) > 10
    for curve in curves:
        assert curve.removeprefix("/tick/") in SCHEMAS["/tick"]["properties"], curve


def test_the_program_of_the_page_reads_a_log(tmp_path):
    with RunLogWriter(tmp_path / "runs" / "first.mcap", {}) as log:
        for k in range(90):
            log.sample(Observation(k / 30, 0.08, None, 0.0, 0.0), Command(0.0, 0.0))
    (program,) = [block.text for block in pages.blocks("docs/logs.md") if block.file == "read_log.py"]
    done = subprocess.run(
        [sys.executable, "-c", program], cwd=tmp_path, capture_output=True, text=True, check=False, timeout=60
    )
    assert done.returncode == 0, done.stderr
    first, *rows = done.stdout.splitlines()
    assert first.endswith(" messages, 2.97 s")
    assert rows == [f"{k / 30} 0.08 None" for k in range(30, 60)]
