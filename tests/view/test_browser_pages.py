"""Recorded runs, as a person sees and operates them in Chromium."""

from __future__ import annotations

import pytest
from planar_rig import PlanarRig
from watching import browser, page, program

from mazeplan.core import resources
from mazeplan.core.events import FailureReported, RecoveryChosen
from mazeplan.core.logs.run_log import RunLogWriter
from mazeplan.core.logs.run_log_reader import read_messages
from mazeplan.learning.modelfile import RigModel
from mazeplan.maze.mapfile import load_map
from mazeplan.run.execution import run_job
from mazeplan.run.specification import Job, Setup

pytestmark = pytest.mark.realtime
LOPSIDED = resources.share("maps") / "lopsided.yaml"


@pytest.fixture(scope="module")
def chromium():
    with browser() as opened:
        yield opened


@pytest.fixture
def failed(tmp_path):
    """A run in which something went wrong after 0.5 s."""
    maze, whole, path = load_map("cme"), tmp_path / "whole.mcap", tmp_path / "failed.mcap"
    run_job(PlanarRig(maze), Setup(maze, RigModel.nominal(maze)), Job(4, 5, 0.3), log=whole)
    header, messages, _ = read_messages(whole)
    with RunLogWriter(path, header) as log:
        for topic, document in messages[1:]:
            if topic == "/tick" and abs(document["t"] - 0.5) < 0.01:  # a tick is told after what happened in it
                log.event(document["t"], FailureReported("stuck", "Track", "no way"))
                log.event(document["t"], RecoveryChosen("replan"))
            log.write(topic, 0.0, document)
    return path


def time_shown(shown) -> float:
    return float(shown.locator("[data-t]").get_attribute("data-t"))


def test_a_recorded_run_is_looked_at(chromium, failed):
    complaints: list[str] = []
    with program(str(failed)) as (_, url), page(chromium, url, complaints) as shown:
        shown.locator("[data-tree]").wait_for()
        assert time_shown(shown) == 0.0
        track = shown.locator(".mantine-Slider-track").first.bounding_box()
        shown.mouse.click(track["x"] + 0.8 * track["width"], track["y"] + 0.5 * track["height"])
        shown.wait_for_function("document.querySelector('[data-t]').dataset.t > 0.6")
        at = time_shown(shown)
        shown.get_by_role("button", name="Play", exact=True).click()
        shown.wait_for_function(f"document.querySelector('[data-t]').dataset.t > {at + 0.1}")
    assert complaints == []
