"""The page in a real browser, headless: what a person sees and presses. One browser and one program for all of it."""

from __future__ import annotations

import io
import os
import re
import signal
import subprocess
import sys
from pathlib import Path

import matplotlib.image
import numpy as np
import pytest
from soon import soon
from watching import LONG, SIZE, browser

ROOT = Path(__file__).resolve().parent.parent.parent
KEPT = ROOT / "build" / "page"

pytestmark = pytest.mark.realtime


@pytest.fixture(scope="module")
def chromium():
    with browser() as opened:
        yield opened


@pytest.fixture(scope="module")
def program(tmp_path_factory):
    """`mazeplan view` on a rig that writes down what it is told; the ball is to rest in the goal for good."""
    folder = tmp_path_factory.mktemp("page")
    tree = (ROOT / "behaviors" / "navigate.xml").read_text(encoding="utf-8")
    (folder / "rest.xml").write_text(tree.replace('hold_s="0.2"', 'hold_s="1000"'), encoding="utf-8")
    trace = folder / "trace"
    trace.touch()
    paths = os.pathsep.join([str(ROOT), str(Path(__file__).parent)])
    words = ["view", "--port", "0", "--rig", "traced_rig:TracedRig", "--model", "toy", "--behavior", "rest.xml"]
    command = [sys.executable, "-m", "mazeplan", *words, "--time-limit", "1000"]
    surroundings = {**os.environ, "PYTHONPATH": paths, "MAZEPLAN_TRACE": str(trace)}
    with subprocess.Popen(command, cwd=folder, stderr=subprocess.PIPE, text=True, env=surroundings) as running:
        line = next(line for line in running.stderr if line.startswith("page: "))
        yield line.split()[-1], trace
        running.send_signal(signal.SIGINT)
        try:
            assert running.wait(60) in (0, 1, 130)  # 130: in the midst of a run
        finally:
            running.kill()  # else leaving waits for it


@pytest.fixture(scope="module")
def page(chromium, program):
    """An open page, and all that it asked for and complained of."""
    url, _ = program
    page = chromium.new_page(viewport=SIZE)
    page.set_default_timeout(LONG)
    page.asked, page.wrong = [], []
    page.on("request", lambda request: page.asked.append(request.url))
    page.on("websocket", lambda socket: page.asked.append(socket.url))
    page.on("console", lambda said: page.wrong.append(said.text) if said.type == "error" else None)
    page.on("pageerror", lambda error: page.wrong.append(str(error)))
    # when a button was clicked, by the clock that the rig's notes go by
    page.add_init_script(
        "window.clicks = []; for (const kind of ['click', 'keydown'])"
        "addEventListener(kind, event => event.isTrusted && window.clicks.push(Date.now() / 1000), true);"
    )
    page.goto(url)
    return page


def phase(page, which):
    page.wait_for_selector(f'[data-phase="{which}"]', state="attached")


def fact(page, name):
    return page.locator(f'[data-fact="{name}"]').inner_text()


def press(page, label):
    page.get_by_role("button", name=label, exact=True).click()
    return page.evaluate("window.clicks.at(-1)")


def stopped(page, way):
    """Emergency stop, by the bar or by the key while a field has the focus; when, by the wall."""
    if way == "bar":
        page.locator("#emergency-stop").click()
    else:
        page.locator("input").first.focus()
        page.keyboard.press("Escape")
    return page.evaluate("window.clicks.at(-1)")


def begun(page):
    """A run goes on, with the ball at rest in ring 5."""
    phase(page, "idle")
    press(page, "Start")
    phase(page, "starting")
    phase(page, "running")
    at_rest_in(page, 5)


def at_rest_in(page, ring):
    page.wait_for_function(
        """ring => document.querySelector('[data-fact="ring"]').innerText == `${ring} → ${ring}`
        && document.querySelector('[data-fact="doing"]').innerText.startsWith('Settle')""",
        arg=ring,
    )


def picture(page, name):
    """The page as (height, width, 3) of 0 .. 1, kept as a file."""
    KEPT.mkdir(parents=True, exist_ok=True)
    data = page.screenshot(path=KEPT / f"{name}.png")
    return matplotlib.image.imread(io.BytesIO(data))[..., :3]


def ball_in(image, box):
    """Share of the pixels in a box (x, y, width, height) of the scene that are of the ball's dark blue."""
    x, y, width, height = (round(value) for value in box)
    part = image[y : y + height, x : x + width]
    red, green, blue = part[..., 0], part[..., 1], part[..., 2]
    return float(np.mean((blue > red + 0.2) & (blue > green + 0.1) & (red < 0.25)))


def scene_box(page):
    """The part of the page where the scene is: between the panels."""
    box = page.locator("canvas").first.bounding_box()
    return box["x"], box["y"], box["width"], box["height"]


def test_it_opens_and_shows_ball_and_tree(page):
    page.wait_for_selector("text=Behaviour tree")
    begun(page)
    assert page.locator("[data-tree]").inner_text().count("\n") > 30
    settle = page.locator('[data-tree] div[title*="Settle"]').first
    assert ": running" in settle.get_attribute("title")
    assert soon(lambda: _in_the_middle(page), 60.0), "see build/page/opened.png"
    assert fact(page, "time").endswith(" s")


def _in_the_middle(page):
    """Whether the ball is drawn where ring 5 is, and not beside it."""
    image, (left, top, width, height) = picture(page, "opened"), scene_box(page)
    x, y = left + 0.5 * width, top + 0.5 * height
    middle, beside = (x - 40, y - 45, 80, 80), (x + 80, y - 45, 80, 80)
    return ball_in(image, middle) > 0.02 and ball_in(image, beside) < 0.005


def test_a_click_on_a_goal_changes_the_run(page):
    press(page, "4")
    at_rest_in(page, 4)
    assert page.locator("[data-tree]").get_attribute("data-tree") == "2"  # a tree of its own
    picture(page, "another-goal")


@pytest.mark.parametrize("way", ["bar", "key"])
def test_the_emergency_stop_levels_within_a_tenth_of_a_second(page, program, way):
    """Of the click or the key, by the wall. The machine is shared: it counts if one of three is served so soon."""
    _, trace = program
    took = []
    for _attempt in range(3):
        if page.locator('[data-phase="idle"]').count():
            begun(page)
        press(page, "1")  # the plate is to be tilted
        assert soon(lambda: _notes(trace)[-1][2] > 0.01)
        clicked = stopped(page, way)
        phase(page, "idle")
        after = [note for note in _notes(trace) if note[0] >= clicked - 1e-3]
        level = next(at for at, word, _ in after if word == "level")
        took.append(level - clicked)
        assert not any(size > 0.0 for at, word, size in after if at > level)  # nothing tilts it afterwards
        if took[-1] < 0.1:
            break
    assert min(took) < 0.1, took


def _notes(trace):
    lines = [line.split() for line in trace.read_text(encoding="utf-8").splitlines()]
    return [(float(at), word, float(size)) for at, word, size in lines]


def test_nothing_was_asked_of_others_and_nothing_complained(page, program):
    url, _ = program
    own = (url, url.replace("http", "ws", 1), f"blob:{url}", "data:")
    assert page.asked
    strangers = [
        asked for asked in page.asked if not asked.startswith(own) and asked != url.replace("http", "ws").rstrip("/")
    ]
    assert not strangers
    assert not page.wrong
    assert any(re.match(r"ws://127\.0\.0\.1:\d+", asked) for asked in page.asked)
