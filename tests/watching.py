"""A page of `mazeplan view` in a headless Chromium: the program is a process of its own, the browser as it comes."""

from __future__ import annotations

import os
import re
import shutil
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager

import pytest

CHROMIUM = shutil.which("chromium")
NEEDED = os.environ.get("MAZEPLAN_BROWSER") == "needed"  # set where the browser is: nothing is skipped there
FLAGS = ["--no-sandbox", "--enable-unsafe-swiftshader", "--disable-gpu"]
LONG = 120_000  # ms; the machine may be slow, and busy
SIZE = {"width": 1300, "height": 620}


@contextmanager
def program(*arguments: str) -> Iterator[tuple[subprocess.Popen, str]]:
    """`mazeplan view ...` on a free port, and the URL it tells; ended by Ctrl-C."""
    command = [sys.executable, "-m", "mazeplan", "view", *arguments, "--port", "0"]
    process = subprocess.Popen(command, stderr=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    try:
        told = []
        for line in process.stderr:
            told.append(line)
            if line.startswith("page: "):
                break
        assert told, process.poll()
        url = re.search(r"http://\S+", told[-1])
        assert url, "".join(told)
        yield process, url[0]
    finally:
        if process.poll() is None:
            process.send_signal(signal.SIGINT)
        process.communicate(timeout=60)
    assert process.returncode == 0


@contextmanager
def browser() -> Iterator:
    """Chromium without a window; the test is skipped where there is none."""
    if CHROMIUM is None:
        if NEEDED:
            pytest.fail("there is no chromium")
        pytest.skip("needs a browser: apt-get install chromium")
    pytest.importorskip("viser")
    playwright = pytest.importorskip("playwright.sync_api")
    with playwright.sync_playwright() as driver:
        opened = driver.chromium.launch(executable_path=CHROMIUM, args=FLAGS)
        yield opened
        opened.close()


@contextmanager
def page(opened, url: str, complaints: list[str]) -> Iterator:
    """The page at a URL; errors in its console, and requests that leave the machine, are added to `complaints`."""
    shown = opened.new_page(viewport=SIZE)
    shown.on("console", lambda m: complaints.append(m.text) if m.type == "error" else None)
    shown.on("pageerror", lambda error: complaints.append(str(error)))
    shown.on("request", lambda r: complaints.append(r.url) if not r.url.startswith((url, "data:", "blob:")) else None)
    shown.set_default_timeout(LONG)
    shown.goto(url)
    yield shown
    shown.close()
