"""What runs of one process share, and what they must not."""

import gc
import shutil
import weakref
from dataclasses import replace

import pytest

from mazeplan.learning.modelfile import PACKAGED
from mazeplan.run.campaign.one_run import GC_INTERVAL, Campaign, run_one
from mazeplan.run.loop import Run

SHORT = Campaign(rig="ideal", start=5, goal=5, time_limit=0.1, deadline=False)


def test_a_model_is_read_once_and_again_when_it_was_edited(tmp_path):
    folder = tmp_path / "mine"
    shutil.copytree(PACKAGED / "toy", folder)
    campaign = Campaign(rig="toy", model=str(folder))
    first = campaign.resolve().setup.model
    assert campaign.resolve().setup.model is first
    file = folder / "model.yaml"
    text = file.read_text()
    file.write_text(text.replace("rate_hz: 30", "rate_hz: 25"))
    assert file.read_text() != text
    assert (first.rate_hz, campaign.resolve().setup.model.rate_hz) == (30.0, 25.0)


@pytest.mark.slow
def test_a_long_campaign_keeps_nothing_of_its_runs(monkeypatch):
    """The collector by itself would not come: it is switched off here."""
    kept = []
    monkeypatch.setattr(
        "mazeplan.run.execution.Run", lambda *given, **more: kept.append(weakref.ref(run := Run(*given, **more))) or run
    )
    campaign = replace(SHORT, runs=2 * GC_INTERVAL)
    gc.disable()
    try:
        for index in range(campaign.runs):
            run_one(campaign, index)
    finally:
        gc.enable()
    assert len(kept) == 2 * GC_INTERVAL
    assert sum(ref() is not None for ref in kept) < GC_INTERVAL
