"""`compare`."""

from __future__ import annotations

import json
import math
import re
from dataclasses import replace
from importlib import import_module
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from commands import plain
from report_documents import comparison
from ring_record import ring_table, write_csv
from standalone_page import alone

from mazeplan.apps.report.words import HARD
from mazeplan.core.errors import InputError
from mazeplan.core.logs.table import Table

QUICK = ("--most", "60")
KINDS = {"rf", "p", "pi", "np", "sp"}


@pytest.fixture(autouse=True)
def quick(monkeypatch):
    """One thread, short training, and few draws of a bootstrap."""
    import mazeplan.learning.ring_scores as module

    pytest.importorskip("torch").set_num_threads(1)
    short = replace(module.THOROUGH, starts=1, iterations=10, refinement=4)
    monkeypatch.setattr(module, "THOROUGH", short)
    monkeypatch.setattr("mazeplan.learning.discrete_map.TrainingOptions", lambda **more: replace(short, **more))
    whole = module.block_bootstrap
    monkeypatch.setattr(module, "block_bootstrap", lambda *a: whole(*a, draws=100))


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Tables: both.csv of two rings; one.csv of ring 2; long.csv, 105 s of it; flipped.csv: one.csv with beta the other
    way round; bare.csv without a ring; rubbish.csv with a theta that has nothing to do with the tilt."""
    home = tmp_path_factory.mktemp("tables")
    both = ring_table((2, 3), 30.0)
    one = Table({name: column[:900] for name, column in both.columns.items()})
    steps = 0.05 * np.random.default_rng(0).standard_normal(900)
    for name, table in (
        ("both", both),
        ("one", one),
        ("long", ring_table((2,), 105.0)),
        ("flipped", Table({**one.columns, "beta": -one["beta"]})),
        ("bare", Table({name: one[name] for name in ("t", "theta", "beta", "gamma")})),
        ("rubbish", Table({**one.columns, "theta": 0.5 * np.cumsum(steps)})),
    ):
        write_csv(table, home / f"{name}.csv")
    return home


@pytest.fixture
def compare(call, folder, monkeypatch):
    """`compare` in the folder of the tables: stdout and stderr; with --json the document in place of stdout."""
    monkeypatch.chdir(folder)

    def compare(*arguments, **more):
        code, out, err = call("compare", *arguments, **more)
        assert code == 0, err
        return json.loads(out) if "--json" in arguments else out, err

    return compare


def test_the_document_is_that_of_the_contract(compare):
    document, err = compare("both.csv", *QUICK, "--json", terminal=True)
    assert list(document) == ["ring2", "ring3"]
    for ring in document.values():
        assert {"n_train", "n_test", "nrmse_train", "nrmse_test", "rollout"} <= set(ring)
        assert ring["n_train"] == 60
        assert ring["n_test"] > 100
        for which in ("nrmse_train", "nrmse_test"):
            assert set(ring[which]) == KINDS
            assert all(0.0 < x < 3.0 for x in ring[which].values())
        assert set(ring["rollout"]) == {"pi", "np", "npd", "sp"}
        for errors in ring["rollout"].values():
            assert set(errors) == {"20", "40"}
        assert ring["signs"] == {"beta": 1, "gamma": 1}
    for words in ("ring 2: sp", "ring 3: rolling out sp"):
        assert re.search(rf"comparing .*{words}", plain(err)), words


def test_the_tables(compare):
    out, err = compare("one.csv", *QUICK)
    assert err == ""
    lines = out.splitlines()
    assert lines[0].split() == ["nRMSE", "of", "theta_dd", "rf", "p", "pi", "np", "sp"]
    assert lines[1].startswith("ring 2 train/test")
    assert lines[1].count("/") == 1 + len(KINDS)
    assert re.fullmatch(r" +95 % of the test +too few: [1-4] blocks? of time", lines[2])
    assert any(line.startswith("ring 2  ") and "windows" in line and "npd" in line for line in lines)
    assert "rates: " in out
    assert any(line.endswith("60") and "training rows" in line for line in lines)
    assert "note:" not in out


@pytest.mark.slow
def test_a_long_record_has_intervals_and_a_verdict(compare):
    out, err = compare("long.csv", *QUICK)
    assert err == ""
    assert re.search(r"sp \d+\.\d\d ± \d+\.\d\d/\d+\.\d\d ± \d+\.\d\d", out)
    assert re.search(r"95 % of the test( +\[\d\.\d{3}, \d\.\d{3}\]){5}\n", out)
    assert "too few" not in out
    said = re.search(r"ring 2  (?:best: |no clear best: )(\w+),? (?:has )?(-?\d+\.\d\d) degrees less error", out)
    assert said
    document, _ = compare("long.csv", *QUICK, "--json")
    best, errors = document["ring2"]["best"], {k: e["40"] for k, e in document["ring2"]["rollout"].items()}
    assert said[1] == best["kind"] == min(errors, key=errors.get)
    assert best["less"] == pytest.approx(errors[best["next"]] - errors[best["kind"]], abs=2e-4)
    assert float(said[2]) == pytest.approx(math.degrees(best["less"]), abs=0.02)
    assert best["interval"][0] <= best["less"] <= best["interval"][1]
    assert "samples, degrees" in out


@pytest.mark.slow
def test_one_ring_of_a_table_is_compared_as_if_alone_and_other_logs_are_left_out(compare):
    given = (["one.csv"], ["both.csv", "--ring", "2"], ["both.csv", "one.csv", "--ring", "3"])
    (single, _), (filtered, silent), (third, err) = (compare(*words, *QUICK, "--json") for words in given)
    assert list(filtered) == ["ring2"]
    assert filtered["ring2"]["n_test"] == single["ring2"]["n_test"]
    assert filtered["ring2"]["nrmse_test"]["p"] == pytest.approx(single["ring2"]["nrmse_test"]["p"], abs=1e-3)
    assert "left out" not in silent
    assert list(third) == ["ring3"]
    assert "left out: one.csv has no row of ring 3, but of 2" in err


@pytest.mark.slow
def test_the_test_log_is_scored(compare):
    rows = Path("one.csv").read_text().splitlines(keepends=True)
    Path("shorter.csv").write_text("".join(rows[:-1]))
    good, bad = (
        compare("one.csv", "--test", f"{test}.csv", *QUICK, "--json")[0]["ring2"] for test in ("shorter", "rubbish")
    )
    assert good["n_test"] > 850
    assert good["nrmse_train"] == bad["nrmse_train"]
    for kind in ("np", "sp"):
        assert good["nrmse_test"][kind] < 0.5
        assert bad["nrmse_test"][kind] > 0.9


@pytest.mark.slow
def test_the_page_has_the_tables_and_the_roll_outs(compare, tmp_path):
    document, _ = compare("one.csv", *QUICK, "--report", tmp_path / "page.html", "--json")
    ring = document["ring2"]
    page = alone(tmp_path / "page.html")
    assert f"{ring['nrmse_train']['sp']:.3f} / {ring['nrmse_test']['sp']:.3f}" in page.replace(HARD, " ")
    assert page.count("<figure") == 1
    for kind, bands in ring["bands"].items():
        assert bands["mean"][20] == pytest.approx(ring["rollout"][kind]["20"], abs=1e-4)


@pytest.fixture
def compared(monkeypatch):
    """`compare` finds these scores, of ring 7, at once."""
    monkeypatch.setattr("mazeplan.apps.cli.compare.report", lambda scores: print("the tables"))
    scores = [SimpleNamespace(ring=7, document=lambda: comparison((7,))["ring7"])]
    monkeypatch.setattr("mazeplan.learning.comparison.compare", lambda *a, **more: scores)
    return scores


def test_a_file_that_cannot_be_written_loses_no_result(call, compared, folder, tmp_path, monkeypatch):
    def full(*arguments):
        raise InputError("cannot be written: No space left on device", file="a.html")

    import_module("mazeplan.apps.report.diagnosis")  # else it would keep the function below
    monkeypatch.setattr("mazeplan.apps.report.write.write_page", full)
    given = ("compare", folder / "one.csv", "--map", "seven", "--report", tmp_path / "a.html")
    assert call(*given)[:2] == (2, "the tables\n")
    code, out, err = call(*given, "--json")
    assert (code, list(json.loads(out))) == (2, ["ring7"])
    assert err == "mazeplan: a.html: cannot be written: No space left on device\n"


@pytest.mark.slow
def test_a_table_without_ring_needs_options(compare, refused):
    message = "bare.csv: the ring of a row is unknown: expected a column ring, or r (or x, y)\n"
    assert message in refused("compare", "bare.csv", *QUICK)
    assert "--ring: got 8, expected 1 to 5" in refused("compare", "bare.csv", *QUICK, "--ring", "8")
    found = []
    for more in (("--ring", "2"), ("--ring", "8", "--radius", "0.068915")):
        [ring] = compare("bare.csv", *QUICK, *more, "--json")[0].values()
        found.append(ring["nrmse_test"]["p"])
    assert found[0] == pytest.approx(found[1], abs=2e-4)


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["one.csv", "--kinds", "pi,dnn"], "--kinds: got 'dnn', expected one or more of rf,p,pi,np,sp"),
        (["one.csv", "--ring", "0"], "--ring"),
        (["both.csv", "--ring", "1"], "both.csv has no row of ring 1, but of 2, 3"),
        (["both.csv", "--ring", "3", "--test", "one.csv"], "one.csv has no row of ring 3, but of 2"),
        (["one.csv", "--map", "none.yaml"], "none.yaml"),
        (["none.csv"], "none.csv: no such file"),
        ([], "Missing argument 'LOG'"),
    ],
)
def test_bad_input(refused, monkeypatch, folder, arguments, said):
    monkeypatch.chdir(folder)
    assert said in refused("compare", *arguments)
