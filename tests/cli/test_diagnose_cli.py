"""`diagnose` from the command line."""

from __future__ import annotations

import json
import re
from types import SimpleNamespace

import numpy as np
import pytest
from commands import call as command
from commands import plain
from plant import play
from ring_record import write_csv

from mazeplan.cli.diagnose import finish
from mazeplan.data.table import Table
from mazeplan.models.modelfile import load_model
from mazeplan.report.words import measured

KNOWN = ("--radius", "0.0925", "--declare", "rolling_inertia.factor=0.7142857", "--declare",
         "viscous_friction.coefficient=0.35")  # fmt: skip


@pytest.fixture
def call(monkeypatch, capsys):
    def run(*arguments, **how):
        return command(monkeypatch, capsys, "diagnose", *arguments, **how)

    return run


@pytest.fixture(scope="module")
def log(tmp_path_factory):
    path = tmp_path_factory.mktemp("logs") / "dry.csv"
    write_csv(Table(play(seed=3, seconds=90.0, dry=0.4)), path)
    return path


def test_the_document_is_that_of_the_contract_and_the_report_stands_alone(call, log, tmp_path):
    code, out, err = call(log, *KNOWN, "--test", log, "-o", tmp_path / "report", "--json", terminal=True)
    assert code == 0, err
    assert re.search(r"diagnosing .* 0:00:\d\d .*trying dry_friction, \d+ of \d+", plain(err))
    document = json.loads(out)
    assert document["verdict"] == "effect_found"
    (effect,) = document["effects"]
    assert effect["name"] == "dry_friction"
    found = effect["parameters"]["coefficient"]
    assert found["value"] == pytest.approx(0.4, abs=0.02)
    assert found["unit"] == "rad/s^2"
    assert 0.0 < found["stderr"] < 0.02
    for part in (document["before"], document["after"], document["test"]["before"], document["test"]["after"]):
        assert set(part) == {"nrmse", "rollout20", "rollout40"}
    assert document["after"]["rollout40"] < 0.2 * document["before"]["rollout40"]
    assert document["noise_floor"] < document["after"]["rollout40"] * 1.5
    assert document["held_out"] == pytest.approx(0.3)
    assert document["unknown"] is None
    assert json.loads((tmp_path / "report" / "report.json").read_text()) == document
    model = load_model(document["model"])
    assert model.ball(1).parameter("dry_friction", "coefficient", 0.0) == pytest.approx(found["value"], rel=1e-4)
    assert model.ball(1).parameter("viscous_friction", "coefficient", 0.0) == 0.35
    page = (tmp_path / "report" / "report.html").read_text()
    assert "The model lacks dry friction." in page
    assert measured(found["value"], found["stderr"], "rad/s^2") in page
    assert "dry_friction.coefficient" in page
    assert "data:image/svg+xml;base64," in page
    alone = re.sub(r"base64,[^\"]*", "", page).replace("http-equiv", "")
    assert "http" not in alone, "nothing is loaded from elsewhere"


@pytest.mark.parametrize(
    ("radius", "words"),
    [(0.0985, "in no ring of the map; expected"), (0.0928, "% of the samples that show it; expected")],
)
def test_a_table_that_is_not_of_this_map_is_refused(call, tmp_path, radius, words):
    columns = play(seed=3, seconds=20.0, radius=radius)  # between the channel of ring 1 and its rim, mostly or always
    noise = 3e-4 * np.random.default_rng(0).standard_normal(len(columns["t"]))
    write_csv(Table({**columns, "r": radius + noise}), tmp_path / "odd.csv")
    code, out, err = call(tmp_path / "odd.csv")
    assert (code, out) == (2, "")
    assert words in err


def test_where_nothing_can_be_written_is_said_before_the_work(call, log, tmp_path):
    file = tmp_path / "file"
    file.write_text("")
    code, out, err = call(log, *KNOWN, "-o", file / "report")
    assert (code, out) == (2, "")
    assert err.strip() == (
        f"mazeplan: -o: got {file / 'report'}, but {file} is a file; expected a folder that can be made or written to"
    )


def test_in_words(call, log):
    code, out, err = call(log, *KNOWN)
    assert (code, err) == (0, "")
    assert out.startswith("The model lacks dry friction (coefficient 0.")
    assert "40-step error" in out.splitlines()[0]


def test_the_ring_is_told_and_what_would_tell_two_effects_apart(monkeypatch, capsys):
    ways = [
        {"why": "it turns", "first": "turn the rig", "command": "mazeplan collect -o apart.mcap"},
        {"why": "more", "first": "", "command": "mazeplan collect --seconds 900 -o apart.mcap"},
    ]
    told = SimpleNamespace(sentence=lambda: "The model lacks x.")
    finish(told, {"ring": 2, "separate_by": ways, "notes": ["n"]}, None, "", as_json=False)
    assert capsys.readouterr().out.splitlines() == [
        "Ring 2: The model lacks x.",
        "to tell them apart: turn the rig, then mazeplan collect -o apart.mcap",
        "to tell them apart: mazeplan collect --seconds 900 -o apart.mcap",
        "note: n",
    ]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--declare", "viscous_friction"), "got 'viscous_friction', expected EFFECT.PARAM=VALUE, such as"),
        (("--radius", "92.5"), "--radius: got 92.5, expected metres, at most 2"),
        (("--declare", "magic.size=1"), "--declare: got effect 'magic', expected one of rolling_inertia"),
        (("--declare", "viscous_friction.size=1"), "got parameter 'size' of viscous_friction, expected one of coeff"),
        (("--declare", "viscous_friction.coefficient=much"), "expected EFFECT.PARAM=VALUE with a number"),
        (("--declare", "viscous_friction.coefficient=-3"), "got viscous_friction.coefficient -3, expected 0 to 20"),
        (("--radius", "-1"), "--radius"),
        (("--ring", "9"), "--ring: got 9, expected 1 to 5"),
        (("--ring", "5"), "--ring: got 5, a disc"),
        (("--model", "nowhere", "--radius", "0.09"), "no such model"),
    ],
)
def test_bad_input_is_one_line_and_exit_2(call, log, arguments, message):
    code, out, err = call(log, *arguments)
    assert code == 2
    assert not out
    assert message in err
    assert "Traceback" not in err


def test_a_record_that_teaches_nothing(call, tmp_path):
    columns = play(seed=1, seconds=30.0, u=np.zeros((900, 2)), sensor=1e-5)
    write_csv(Table(columns), tmp_path / "still.csv")
    code, _, err = call(tmp_path / "still.csv", *KNOWN)
    assert code == 2
    assert "nothing can be learned" in err


def test_the_ring_comes_from_the_map(call, tmp_path):
    columns = play(seed=3, seconds=60.0, radius=0.0689, dry=0.4)
    write_csv(Table(columns), tmp_path / "ring2.csv")
    code, out, err = call(tmp_path / "ring2.csv", "--json", *KNOWN[2:])
    assert code == 0, err
    document = json.loads(out)
    assert document["ring"] == 2
    assert "dry_friction" in [e["name"] for e in document["effects"]]
