"""What is said of a rig: sentences that somebody who has only these can act on."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

from mazeplan.diagnosis.rig.verdict import Unknown
from mazeplan.diagnosis.rig.words import advice, sentence

FRICTION = {
    "name": "dry_friction", "known_before": {"coefficient": 0.47}, "rings": {"1": {}}, "planned": True,
    "parameters": {"coefficient": {"value": 1.452, "stderr": 0.009, "unit": "rad/s^2"}},
}  # fmt: skip
MAGNET = {
    "name": "surface_bump", "known_before": {"height": 0.0}, "rings": {"2": {}, "1": {}}, "planned": True,
    "parameters": {"centre": {"value": 1.0472, "stderr": 0.01, "unit": "rad"},
                   "height": {"value": -1.93, "stderr": 0.1, "unit": "rad/s^2"}},
}  # fmt: skip
TURNED = {
    "name": "axis_misalignment", "known_before": {"angle": 0.0}, "rings": {"1": {}}, "planned": True,
    "parameters": {"angle": {"value": 0.05, "stderr": 0.001, "unit": "rad"}},
}  # fmt: skip
ROCKING = {
    "name": "table_rocking", "known_before": {}, "rings": {"1": {}}, "planned": False, "why_not": "its phase changes",
    "parameters": {"beta": {"value": 0.0067, "stderr": 0.0003, "unit": "rad"}},
}  # fmt: skip
UNKNOWN = Unknown("a force along the rings")


WHOLE = SimpleNamespace(servos_overtaxed=False)  # a stage that the record shows well


def done(
    *effects, verdict="effect_found", alike=(), unknown=None, z_score=33.0, remaining=1.07, ahead=40, stage=WHOLE,
    misfit="",
):  # fmt: skip
    errors = {"before": {f"rollout{ahead}": 0.4}, "after": {f"rollout{ahead}": 0.1 if effects else 0.4}}
    body, overtaxed = SimpleNamespace(pictures=SimpleNamespace(dt=1 / 30)), stage is not None and stage.servos_overtaxed
    return SimpleNamespace(
        effects=effects, verdict=verdict, alike=alike, unknown=unknown, remaining=remaining, **errors,
        held=SimpleNamespace(z_score=z_score, ahead=ahead, errors=errors.get),
        was=SimpleNamespace(source="the reference", remaining=1.0), misfit=misfit,
        plate=SimpleNamespace(stage=stage, body=body, overtaxed=overtaxed),
    )  # fmt: skip


def test_it_says_what_differs_how_sure_that_is_and_what_it_does():
    told = sentence(done(FRICTION))
    parts = ("dry friction (coefficient from 0.4700 to 1.4520 ± 0.0090 rad/s²)", "certain", "by 33 standard errors",
             "1.3 s ahead", "from 22.9 to 5.7 degrees", "1.1 times the noise of the camera")  # fmt: skip
    where = [told.index(part) for part in parts]
    assert where == sorted(where)
    assert "0.7 s ahead" in sentence(done(FRICTION, ahead=20))


@pytest.mark.parametrize(("z_score", "word"), [(9.0, "certain"), (3.0, "likely")])
def test_a_word_stands_for_how_sure_it_is(z_score, word):
    assert f"The finding is {word}:" in sentence(done(FRICTION, z_score=z_score))


def test_a_place_is_where_to_look_and_an_angle_of_the_camera_is_none():
    assert "centre 60 degrees, height from 0 to -1.93 ± 0.10" in sentence(done(MAGNET))
    assert advice(done(MAGNET))[0] == "Look for a magnet or a dent at 60 degrees in ring 2."
    assert advice(done(TURNED))[0] == "Turn the camera back."


def test_nothing_is_to_be_repaired_where_a_fault_has_gone():
    numbers = {"coefficient": FRICTION["parameters"]["coefficient"] | {"value": 0.1}}
    assert "Clean" in advice(done(FRICTION))[0]
    assert not any("Clean" in line for line in advice(done(FRICTION | {"parameters": numbers})))


def test_a_plan_can_use_it_or_the_reason_why_not_is_told():
    assert advice(done(FRICTION), "out/model")[-1].endswith(": mazeplan navigate --rig RIG --model out/model.")
    assert "-o FOLDER" in advice(done(FRICTION))[-1]
    (told,) = advice(done(ROCKING), "out/model")
    assert told == "Stop the table from rocking. No plan can allow for it: its phase changes."


def test_causes_that_cannot_be_told_apart_are_named_with_a_way():
    both = done(FRICTION, verdict="ambiguous", alike=[("dry_friction", "viscous_friction")])
    assert "cannot tell dry friction and viscous friction apart" in sentence(both)
    assert "mazeplan collect" in advice(both)[-1]


def test_what_has_no_name_is_told_and_so_is_nothing():
    unknown = done(verdict="unknown_effect", unknown=UNKNOWN, z_score=float("inf"))
    assert "something without a name (a force along the rings)" in sentence(unknown)
    assert "finding is" not in sentence(unknown)
    assert "mazeplan learn LOG" in advice(unknown)[-1]
    seen = done(verdict="unknown_effect", unknown=Unknown("a force", look=("Look for a fan",)))
    assert advice(seen)[0] == "Look for a fan."
    healthy = done(verdict="nothing_missing")
    assert sentence(healthy).startswith("Nothing is missing: the rig agrees with the reference.")
    assert advice(healthy) == ["Nothing needs to be done. Go on with the same model."]
    navigation = done(verdict="nothing_missing", stage=SimpleNamespace(servos_overtaxed=True))
    assert sentence(navigation).startswith("Nothing is missing, as far as this record shows: the rig agrees")
    assert sentence(navigation).endswith("Of the servos, it shows large changes only.")
    assert sentence(done(verdict="nothing_missing", stage=None)).endswith("It does not show the servos.")


def test_a_model_that_does_not_fit_is_said_first_and_nothing_is_certain():
    said = sentence(done(FRICTION, misfit="walls without friction"))
    assert said.startswith("The model does not fit this rig, also in the reference: walls without friction?")
    assert "The finding is likely" in said


def test_changes_of_servos_without_a_size_are_told_as_they_are():
    look = ("Look at the servos",)
    alone = done(verdict="unknown_effect", unknown=Unknown(look=look, servos=("the servo of beta is slower",)))
    assert sentence(alone).startswith("The rig differs from the reference: the servo of beta is slower.")
    assert advice(alone) == ["Look at the servos."]
    both = Unknown("a force", ("time",), look, ("the servo of beta is slower",))
    told = sentence(done(verdict="unknown_effect", unknown=both))
    assert "something without a name (a force); the servo of beta is slower." in told
    assert both.document()["description"] == "a force; the servo of beta is slower"


def test_errors_of_the_ball_are_not_told_of_findings_that_only_the_tilt_shows():
    overtaxed = SimpleNamespace(servos_overtaxed=True)
    gain = {**FRICTION, "name": "servo_gain"}
    assert "s ahead" not in sentence(done(gain, stage=overtaxed))
    assert "s ahead" in sentence(done(gain, FRICTION, stage=overtaxed))
    assert "s ahead" in sentence(done(gain))
