"""A learned policy: its inputs, commands inside the limits, folders, ONNX."""

from __future__ import annotations

import math
import shutil
from dataclasses import replace

import numpy as np
import pytest
import yaml
from policies import LIMIT, drawn, hand_made

from mazeplan.control.policy import INPUTS, KNOWN, load_policy, policy_inputs, save_policy
from mazeplan.control.tilt import Plate
from mazeplan.core.errors import ModelError
from mazeplan.core.records import State
from mazeplan.maze.mapfile import load_map

MAZE = load_map("cme")
PLATE = Plate(LIMIT)
OPENING = MAZE.openings[0]


def turned(angle: float, plate: Plate = PLATE) -> np.ndarray:
    """Inputs of one situation, turned about the centre with its opening."""
    c, s = math.cos(angle), math.sin(angle)

    def of(x: float, y: float) -> tuple[float, float]:
        return c * x - s * y, s * x + c * y

    (x, y), (vx, vy), (b, g), (bd, gd) = of(0.105, -0.02), of(0.03, 0.11), of(0.04, -0.02), of(0.2, 0.1)
    state = State(0.0, x, y, vx, vy, b - plate.offset_beta, bd, -g - plate.offset_gamma, -gd, OPENING.outer)
    opening = replace(OPENING, angle=OPENING.angle + angle)
    turn = OPENING.angle - math.atan2(-0.02, 0.105)
    return policy_inputs(state, MAZE.ring(OPENING.outer), opening, turn, False, plate)


def test_inputs_are_relative_to_the_ball():
    one, other = turned(0.0), turned(2.1)
    assert one[:KNOWN] == pytest.approx(other[:KNOWN], abs=1e-12)
    assert one[INPUTS.index("cos_1")] != pytest.approx(other[INPUTS.index("cos_1")])


def test_a_leaning_table_is_corrected():
    tilted = Plate(LIMIT, 0.01, -0.005)
    assert turned(0.7, tilted) == pytest.approx(turned(0.7))
    level, made_up = (hand_made(near=(0.2, 0.3)).command(turned(0.7), plate) for plate in (PLATE, tilted))
    assert made_up.u_beta - level.u_beta == pytest.approx(-0.01)
    assert made_up.u_gamma - level.u_gamma == pytest.approx(0.005)


def test_outputs_are_outwards_and_along_the_ring():
    x = turned(0.0)
    x[INPUTS.index("cos_1")], x[INPUTS.index("sin_1")] = 1.0, 0.0
    x[INPUTS.index("near")] = 1.0
    out, along = (hand_made(near=row).command(x, PLATE) for row in ((0.5, 0.0), (0.0, 0.5)))
    assert (out.u_beta, out.u_gamma) == pytest.approx((0.5 * LIMIT, 0.0))  # pitch lowers the +x side
    assert (along.u_beta, along.u_gamma) == pytest.approx((0.0, -0.5 * LIMIT))  # roll lifts the +y side


def test_no_command_is_beyond_the_limits():
    rng = np.random.default_rng(3)
    commands = [drawn(1).command(rng.normal(size=len(INPUTS)) * 9.0, PLATE) for _ in range(50)]
    tilts = np.abs([(c.u_beta, c.u_gamma) for c in commands])
    assert tilts.max() == LIMIT
    assert tilts.min() < LIMIT


def test_the_distance_is_to_the_nearest_centre():
    policy = drawn(2)
    x = np.zeros(len(INPUTS))
    x[:KNOWN] = policy.mean[:KNOWN] + policy.scale[:KNOWN] * policy.centres[4]
    assert policy.distance(x) == pytest.approx(0.0, abs=1e-6)
    x[KNOWN:] += 100.0  # the place on the circle is no matter
    assert policy.distance(x) == pytest.approx(0.0, abs=1e-6)
    x[0] += 1e-3 * policy.scale[0]
    assert policy.distance(x) == pytest.approx(1e-3 / policy.reach, rel=1e-3)
    assert math.isnan(policy.distance(np.full(len(INPUTS), math.nan)))


# -- folders --------------------------------------------------------------------------------------------------------


def test_a_policy_is_read_as_it_was_saved(tmp_path):
    policy, x = drawn(5), np.random.default_rng(1).normal(size=(30, len(INPUTS)))
    save_policy(policy, tmp_path / "p")
    read = load_policy(tmp_path / "p")
    assert np.array_equal(read.tilt(x), policy.tilt(x))
    assert [read.distance(row) for row in x] == [policy.distance(row) for row in x]
    assert (read.facts, read.source) == ({"seed": 5}, str(tmp_path / "p"))


def changed(folder, **keys):
    path = folder / "policy.yaml"
    document = {**yaml.safe_load(path.read_text()), **keys}
    path.write_text(yaml.safe_dump({k: v for k, v in document.items() if v != "gone"}, sort_keys=False))


@pytest.mark.parametrize(
    ("keys", "said"),
    [
        ({"format": 2}, "format: got 2, expected 1"),
        ({"reach": 0}, "reach: got 0"),
        ({"limit": "wide"}, "limit: got 'wide', expected"),
        ({"hidden": [16, 9]}, r"policy.npz: weights1: got float32 \(8, 16\), expected float32 \(9, 16\), finite"),
        ({"hidden": [0]}, r"hidden\[0\]: got 0"),
        ({"inputs": ["turn"]}, "inputs: got others, expected turn, near"),
        ({"arrays": {"file": "../policy.npz"}}, "arrays: expected file: policy.npz"),
        ({"colour": "red"}, "colour: unknown key, expected one of inputs"),
        ({"reach": "gone"}, "reach: is missing"),
    ],
)
def test_a_wrong_key_is_named_with_its_line(tmp_path, keys, said):
    save_policy(drawn(5), tmp_path)
    changed(tmp_path, **keys)
    with pytest.raises(ModelError, match=rf"policy.yaml:\d+: .*{said}"):
        load_policy(tmp_path)


def test_arrays_that_are_not_those_of_the_file_are_refused(tmp_path):
    save_policy(drawn(5), tmp_path / "one")
    save_policy(drawn(6), tmp_path / "other")
    shutil.copy(tmp_path / "other" / "policy.npz", tmp_path / "one" / "policy.npz")
    with pytest.raises(ModelError, match=r"arrays: policy.npz is not the file .* \(its sha256 differs\)"):
        load_policy(tmp_path / "one")


@pytest.mark.parametrize("name", ["mean", "scale", "centres"])
def test_numbers_that_are_none_are_refused(tmp_path, name):
    policy = drawn(5)
    save_policy(replace(policy, **{name: np.full_like(getattr(policy, name), np.nan)}), tmp_path)
    with pytest.raises(ModelError, match=rf"{name}: got float32 .*, finite"):
        load_policy(tmp_path)


def test_a_folder_without_a_policy_is_named(tmp_path):
    with pytest.raises(ModelError, match=r"got a folder, expected a folder with policy\.yaml"):
        load_policy(tmp_path)


# -- ONNX -----------------------------------------------------------------------------------------------------------
