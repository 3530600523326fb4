"""How the search decides: placebos, two effects at once, gates all around, short records."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from plant import commands, play
from ring_records import DECLARED, found, names

from mazeplan.core.logs.table import Table
from mazeplan.diagnosis.record import record_of
from mazeplan.diagnosis.ring import search
from mazeplan.diagnosis.ring.diagnose import diagnose
from mazeplan.physics.effects.nameless import PLACEBOS


@pytest.mark.slow
def test_placebos_run_along_and_lose():
    done = found(seed=3, dry=0.3)
    known = {c.name for c in PLACEBOS}
    gains = {t.candidate.name: t.gain for t in done.finding.ranked}
    tried = known & set(gains)
    assert tried
    assert max(gains[name] for name in tried) < 0.1 * gains["dry_friction"]


@pytest.mark.parametrize(
    ("instead", "stands", "alike"),
    [({}, ("a", "b", "f", "e"), (("e", "g"),)), ({"c": "d"}, ("a", "b", "d", "e"), (("d", "c"), ("e", "g")))],
)
def test_names_are_alike_only_while_one_of_them_stands_and_the_other_was_not_found(monkeypatch, instead, stands, alike):
    """b was found beside a; c was exchanged for f, or for its twin d."""

    def exchanged(self, current):
        self._instead.update(instead)
        return fitted(*stands)

    def fitted(*names):
        return SimpleNamespace(candidates=names, values=dict.fromkeys(names), minus2=0.0)

    groups = [("a", "b"), ("b",), ("c", "d"), ("e", "g", "a")]
    names = [group[0] for group in groups]
    trials = [
        SimpleNamespace(fit=fitted(*names[: i + 1]), candidate=SimpleNamespace(name=name), raw=0.0)
        for i, name in enumerate(names)
    ]
    choices = iter([*((trial, None, group) for trial, group in zip(trials, groups, strict=True)), (None, None, ())])
    monkeypatch.setattr(search, "fit", lambda *given: fitted())
    monkeypatch.setattr(search.Search, "_trials", lambda *given: [])
    monkeypatch.setattr(search.Search, "_choice", lambda *given: next(choices))
    monkeypatch.setattr(search.Search, "_exchange", exchanged)
    monkeypatch.setattr(search.Search, "_drop", lambda self, current: (current, {}))
    likelihood = SimpleNamespace(system=SimpleNamespace(declared={}), noisy=True)
    assert search.Search(likelihood, [], lambda text: None).run().alike == alike


@pytest.mark.slow
def test_two_effects_of_which_an_unnamed_one_takes_a_share_of_both():
    done = found(seed=302, seconds=200.0, radius=0.0488, viscous=0.44, factor=5 / 7 * 1.045)
    assert done.verdict != "unknown_effect", done.sentence()
    assert names(done) == ["rolling_inertia", "viscous_friction"]


@pytest.mark.slow
def test_what_came_first_is_exchanged_when_another_explains_more_beside_the_second():
    done = found(seed=305, seconds=200.0, radius=0.0488, bump=(1.0, 0.3, 0.3), offset=(0.0015, -0.0015))
    assert names(done) == ["surface_bump", "tilt_offset"], done.sentence()


@pytest.mark.slow
def test_a_scale_of_both_tilts_is_not_taken_for_the_ball_or_the_other_way_round():
    assert names(found(seed=0, factor=5 / 7 * 1.03)) == ["rolling_inertia"]
    assert names(found(seed=0, gain=(1.05, 0.95))) == ["tilt_gain"]


@pytest.mark.slow
def test_scales_far_off_on_both_axes_alike_may_be_the_ball():
    done = found(seed=0, seconds=100.0, gain=(1.4, 1.4))
    assert (names(done), done.verdict) == (["tilt_gain"], "ambiguous")
    assert done.document()["ambiguous_with"] == [["tilt_gain", "rolling_inertia"]]
    apart = found(seed=0, seconds=100.0, gain=(1.4, 1.2))
    assert (names(apart), apart.verdict) == (["tilt_gain"], "effect_found")


@pytest.mark.slow
@pytest.mark.parametrize("angle", [-2.0, 0.81, 3.1])
def test_a_gate_is_found_wherever_it_is(angle):
    done = found(seed=4, gate=(angle, 0.1), seconds=150.0)
    assert names(done) == ["gate_loss"], done.sentence()
    (effect,) = done.effects
    assert effect["parameters"]["angle"]["value"] == pytest.approx(angle, abs=0.05)
    assert effect["before"] > 1.5 * effect["after"]
    assert effect["evidence"] > 15.0


@pytest.mark.slow
def test_twenty_seconds_are_enough_for_what_is_large_and_name_nothing_else():
    assert names(found(seed=5, seconds=20.0, dry=0.5)) == ["dry_friction"]
    assert found(seed=5, seconds=20.0).verdict == "nothing_missing"


@pytest.mark.slow
def test_the_past_of_the_speed_has_no_name_and_no_four_wrong_ones():
    done = found(seed=7, seconds=200.0, memory=(1.0, 0.5))
    assert done.verdict == "unknown_effect"
    assert done.effects == ()
    assert "past of theta_dot" in done.document()["unknown"]["depends_on"]


@pytest.mark.slow
def test_a_servo_that_ignores_small_changes_is_named_and_nothing_of_the_ball():
    u = commands(np.random.default_rng(9), 3600)
    kept = u.copy()
    for k in range(1, len(u)):
        kept[k] = np.where(np.abs(u[k] - kept[k - 1]) >= 0.008, u[k], kept[k - 1])
    columns = play(seed=9, seconds=120.0, u=kept)
    columns |= {"u_beta": u[:, 0], "u_gamma": u[:, 1]}
    done = diagnose(record_of(Table(columns)), 0.0925, DECLARED)
    assert names(done) == ["deadband"], done.sentence()
    assert done.effects[0]["parameters"]["gamma"]["value"] == pytest.approx(0.008, rel=0.1)
