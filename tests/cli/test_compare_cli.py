"""`compare`."""

from __future__ import annotations

import json
import re
from dataclasses import replace

import numpy as np
import pytest
from commands import plain
from ring_record import ring_table, write_csv

from mazeplan.core.logs.table import Table

QUICK = ("--most", "60")
KINDS = {"rf", "p", "pi", "np", "sp"}


@pytest.fixture(autouse=True)
def quick(monkeypatch):
    """One thread, short training, and few draws of a bootstrap."""
    import mazeplan.learning.comparison as module

    pytest.importorskip("torch").set_num_threads(1)
    short = replace(module.THOROUGH, starts=1, iterations=10, refinement=4)
    monkeypatch.setattr(module, "THOROUGH", short)
    monkeypatch.setattr("mazeplan.learning.fitting.TrainingOptions", lambda **more: replace(short, **more))
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
    (row,) = (line for line in out.splitlines() if "rows," in line)
    assert row.split()[:4] == ["ring", "2:", "60", "rows,"]
    assert row.count("/") == len(KINDS) == row.count("too few")
    assert any("windows" in line for line in out.splitlines())
    assert "rates" in out


@pytest.mark.slow
def test_a_long_record_has_intervals(compare):
    out, err = compare("long.csv", *QUICK)
    assert err == ""
    out = out.replace("\u00a0", " ")
    assert re.search(r"\d+\.\d\d ± \d+\.\d\d / \d+\.\d\d ± \d+\.\d\d", out)
    assert len(re.findall(r"\[\d\.\d\d, \d\.\d\d\]", out)) == len(KINDS)
    assert "too few" not in out
