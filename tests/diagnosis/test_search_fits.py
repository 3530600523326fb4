"""Where a search begins, and which of two explanations it keeps. The filter is replaced by a known likelihood."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from mazeplan.control.estimation.rigid_body_filter import BallPictures, BodyModel
from mazeplan.control.estimation.rigid_body_fit import BodyFit, value_of, with_values
from mazeplan.diagnosis.rig import fitting, search
from mazeplan.diagnosis.rig.candidates import Candidate
from mazeplan.diagnosis.rig.fitting import Reference, placed, with_likeliest_noise
from mazeplan.diagnosis.rig.scores import HeldOut
from mazeplan.physics.effect import Term
from mazeplan.physics.effects.local_forces import floor_dirt

INERTIA, GAIN = Candidate("rolling_inertia", ("inertia",)), Candidate("tilt_gain", ("gain_beta", "gain_gamma"))
LEAN, FRICTION = Candidate("tilt_offset", ("tilt_beta", "tilt_gamma")), Candidate("dry_friction", ("rolling",))


@pytest.mark.parametrize("likeliest", [1e-6, 1e-3])
def test_a_search_begins_at_the_likeliest_noise(likeliest: float):
    """However far it is from the noise of the reference."""

    class Body:
        def innovations(self, model: BodyModel) -> Any:
            return SimpleNamespace(minus2=100.0 * abs(math.log(model.wander.plane / likeliest)))

    body: Any = Body()
    found = with_likeliest_noise(body, with_values(BodyModel(), {"plane": 2e-5}))
    assert likeliest / 2.0 < found.wander.plane < 2.0 * likeliest


def fit(minus2: float) -> BodyFit:
    """A fit of which only the likelihood counts."""
    none: Any = None
    return BodyFit(BodyModel(), {}, (), none, minus2, none)


def kept(monkeypatch: pytest.MonkeyPatch, found: list[Candidate], gain: float, of_rival: float) -> list[str]:
    """Names of what a search keeps that found these candidates, with this gain; the first one has the rival GAIN."""
    monkeypatch.setattr(search, "polished", lambda *_: fit(-of_rival))
    rivals = [{GAIN: BodyModel()}, *({} for _ in found[1:])]
    chosen = [search.Finding(c, gain, other) for c, other in zip(found, rivals, strict=True)]
    body: Any = None
    _, left = search._or_a_rival(body, fit(-gain), Reference(BodyModel()), (), chosen, fit(0.0))
    return [c.candidate.effect for c in left]


def test_one_cause_takes_the_place_of_several_that_explain_no_more(monkeypatch: pytest.MonkeyPatch):
    assert kept(monkeypatch, [INERTIA, LEAN, FRICTION], 3700.0, of_rival=3650.0) == ["tilt_gain"]
    several = ["rolling_inertia", "tilt_offset", "dry_friction"]
    assert kept(monkeypatch, [INERTIA, LEAN, FRICTION], 3700.0, of_rival=3300.0) == several


def test_the_whole_record_decides_between_rivals(monkeypatch: pytest.MonkeyPatch):
    assert kept(monkeypatch, [INERTIA], 2900.0, of_rival=3700.0) == ["tilt_gain"]
    assert kept(monkeypatch, [INERTIA], 2900.0, of_rival=2905.0) == ["rolling_inertia"]  # it has one number more


@pytest.mark.parametrize("shown", [True, False])
def test_a_sector_is_tried_at_other_places_too(monkeypatch: pytest.MonkeyPatch, shown: bool):
    """A fit that stays where it began does not have the last word. A start that changes nothing is not determined."""
    term = Term(floor_dirt, tuple(p.default for p in floor_dirt.parameters.values()))
    names = ("floor_dirt.start", "floor_dirt.end", "floor_dirt.coefficient")
    model = with_values(BodyModel()._replace(terms=(term,)), dict(zip(names, (1.1, 2.5, 0.4), strict=True)))
    truth = dict(zip(names[0 if shown else 1 :], (1.05, 2.35, 0.5)[0 if shown else 1 :], strict=True))
    no_ball_in_its_ring = np.zeros((9, 2))  # so all pictures count

    class Body:
        pictures = BallPictures(np.linspace(0.0, 0.24, 9), 0.03, no_ball_in_its_ring, np.arange(9) == 0)

        def innovations(self, model: BodyModel) -> Any:
            return SimpleNamespace(minus2=1e3 * sum(abs(value_of(model, name) - at) for name, at in truth.items()))

    def stays(body: Any, model: BodyModel, *_: Any) -> BodyFit:
        none: Any = None
        return BodyFit(model, {}, (), none, body.innovations(model).minus2, none)

    monkeypatch.setattr(fitting, "fit_body", stays)
    body: Any = Body()
    found = placed(body, model, names)
    assert found.minus2 < 0.25 * body.innovations(model).minus2
    assert set(found.stderr) == (set() if shown else {"floor_dirt.start"})


@pytest.mark.parametrize(
    ("gains", "likelier"),
    [
        ([0, 606, 141, 71, 71, 46, 45, 37, -3, 0, 0, 0, 0, 0], True),  # an effect at one place: few blocks show it
        ([0, 900, 30, 20, 10, 0, 0, 0, 0, 0, 0, 0, 0, 0], False),  # one block only
        ([0, 606, 141, 71, 71, -46, -45, -37, 5, -30, 0, 0, 0, 0], False),  # others get worse
        ([12, 9, 11, 14, 8, 10, 12, 9, 11, 10, 12, 8, 9, 10], True),
    ],
)
def test_findings_have_to_make_held_out_blocks_likelier(gains: list[float], likelier: bool):
    none = np.empty((0, 0))
    held = HeldOut(np.empty(0, dtype=int), none, none, np.array(gains, dtype=np.float64), none)
    assert held.likelier is likelier
