"""The documentation as a site: it is built without a warning, and its pages ask nobody else for anything."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from html.parser import HTMLParser

import pytest
from pages import ROOT

import mazeplan
import mazeplan.apps.testing

LOADED = ("src", "srcset", "href", "data", "poster", "action")
ABROAD = re.compile(r"(https?:)?//")


class Loads(HTMLParser):
    """What a page makes a browser load; links that a reader may follow are none of it."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.found: list[str] = []
        self.words: list[str] = []
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        self.found += [value for name, value in attrs if name in LOADED and value and tag != "a"]

    def handle_data(self, data):
        self.words.append(data)


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    home = tmp_path_factory.mktemp("site")
    path = os.pathsep.join([str(ROOT), os.environ.get("PYTHONPATH", "")])
    command = [sys.executable, "-m", "sphinx", "-W", "--keep-going", "-q", "-b", "html", "-d", str(home / "doctrees")]
    done = subprocess.run(
        [*command, str(ROOT / "docs"), str(home / "html")],
        capture_output=True, text=True, check=False, env={**os.environ, "PYTHONPATH": path},
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert done.stderr == ""
    return home / "html"


@pytest.mark.slow
def test_every_page_is_there_and_can_be_reached(site):
    index = (site / "index.html").read_text(encoding="utf-8")
    for page in (ROOT / "docs").glob("*.md"):
        assert (site / f"{page.stem}.html").is_file()
        assert page.stem == "index" or f'href="{page.stem}.html"' in index, f"{page.name} is in no list of index.md"


@pytest.mark.slow
def test_pages_load_nothing_from_elsewhere(site):
    for page in site.rglob("*.html"):
        for target in Loads(page.read_text(encoding="utf-8")).found:
            assert not ABROAD.match(target), f"{page.name} loads {target}"
            path = target.split("#")[0].split("?")[0]
            assert target.startswith("data:") or (page.parent / path).exists(), f"{page.name}: {target} is not there"
    for style in site.rglob("*.css"):
        for target in re.findall(r"(?:url\(|@import)\s*[\"']?([^\"')]+)", style.read_text(encoding="utf-8")):
            assert not ABROAD.match(target), f"{style.name} loads {target}"
    for script in site.rglob("*.js"):
        loaded = re.findall(
            r"(?:fetch|import|importScripts|open)\(\s*[\"'](https?:)?//", script.read_text(encoding="utf-8")
        )
        assert not loaded, script.name


@pytest.mark.slow
def test_the_reference_has_all_public_names(site):
    text, functions = ((site / page).read_text(encoding="utf-8") for page in ("reference.html", "functions.html"))
    shown = [name for name in mazeplan.__all__ if f">mazeplan.{name}<" not in functions]
    missing = [name for name in shown if not re.search(rf'id="mazeplan\.[\w.]*\b{name}"', text)]
    assert not missing
    known = ["Player", "Script"]  # returned
    missing = [name for name in mazeplan.apps.testing.__all__ if f'id="mazeplan.apps.testing.{name}"' not in text]
    assert sorted(missing) == sorted(known)
