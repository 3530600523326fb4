"""`compare` from the command line."""

from __future__ import annotations

import json
import re
import sys
from functools import partial

import numpy as np
import pytest
from commands import call, plain
from ring_record import ring_table, write_csv
from standalone_page import alone

from mazeplan.data.table import Table
from mazeplan.report.words import HARD
from mazeplan.resources import to_install

QUICK = ("--most", "60", "--kernel", "rbf", "--rates", "smoothed", "--bands", "0")
KINDS = {"rf", "p", "pi", "np", "sp"}


@pytest.fixture(autouse=True)
def quick(monkeypatch):
    """One thread, short training, and few draws of a bootstrap."""
    import mazeplan.comparison as module
    from mazeplan.models import gp_training

    torch = pytest.importorskip("torch")
    torch.set_num_threads(1)
    short = partial(gp_training.TrainingOptions, iterations=10)
    monkeypatch.setattr(gp_training, "TrainingOptions", short)
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


def test_json_is_the_document_of_the_contract(monkeypatch, capsys, folder):
    code, out, err = call(monkeypatch, capsys, "compare", folder / "both.csv", *QUICK, "--json", terminal=True)
    assert code == 0
    document = json.loads(out)
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
        assert ring["rates"] == "smoothed"
    for words in ("ring 2: sp", "ring 3: np, rbf, start 1 of", "ring 3: rolling out sp", r"[1-9]\d? %  left 0:00:\d\d"):
        assert re.search(rf"comparing .*{words}", plain(err)), words  # beside the document


def test_for_people_the_tables(monkeypatch, capsys, folder):
    code, out, err = call(monkeypatch, capsys, "compare", folder / "one.csv", *QUICK)
    assert (code, err) == (0, "")
    lines = out.splitlines()
    assert lines[0].split() == ["nRMSE", "of", "theta_dd", "rf", "p", "pi", "np", "sp"]
    assert lines[1].startswith("ring 2 train/test")
    assert lines[1].count("/") == 1 + len(KINDS)
    assert re.fullmatch(r" +95 % of the test +too few: [1-4] blocks? of time", lines[2])
    assert any(line.startswith("ring 2  ") and "windows" in line and "npd" in line for line in lines)
    assert "rates: smoothed" in out
    assert any(line.endswith("60") and "training rows" in line for line in lines)
    assert "note:" not in out


def test_bands_are_told_in_a_line_for_each_ring(monkeypatch, capsys, folder):
    code, out, err = call(monkeypatch, capsys, "compare", folder / "long.csv", *QUICK[:-1], "500")
    assert (code, err) == (0, "")
    told = out.split("how often the measured angle lies in the band")[1].splitlines()
    assert re.fullmatch(r"ring 2  500 roll-outs of 10 windows:  pi \d+/\d+  np \d+/\d+  sp \d+/\d+", told[1])
    assert re.search(r"sp 0\.\d{3} ± 0\.\d{3}/\d\.\d{3} ± 0\.\d{3}", out)
    assert re.search(r"95 % of the test( +\[\d\.\d{3}, \d\.\d{3}\]){5}\n", out)
    assert "too few" not in out


def test_too_few_windows_say_so_instead_of_a_share_or_an_interval(monkeypatch, capsys, folder):
    """The document keeps its numbers, and tells how many blocks there are."""
    given = ("compare", folder / "one.csv", *QUICK[:-1], "100")
    code, out, _ = call(monkeypatch, capsys, *given)
    assert code == 0
    told = out.split("how often the measured angle lies in the band")[1].splitlines()
    assert told[1] == "ring 2  100 roll-outs of 2 windows: too few for a share"
    rolled = out.split("mean absolute error")[1].splitlines()[1]
    assert re.match(r"ring 2  \d+ windows in 2 blocks of time \(too few for ±\), evenly spaced:   pi \d", rolled)
    assert rolled.count("±") == 1
    code, out, _ = call(monkeypatch, capsys, *given, "--json")
    ring = json.loads(out)["ring2"]
    assert ring["blocks"] == {"test": 2, "windows": 2}
    assert 0.0 <= ring["confidence"]["sp"]["coverage40"] <= 1.0
    assert set(ring["interval95"]) == {"nrmse_test", "20", "40"}


def test_a_ring_without_windows_says_so(monkeypatch, capsys, folder, tmp_path):
    rows = (folder / "one.csv").read_text().splitlines()
    (tmp_path / "short.csv").write_text("\n".join(rows[:250]) + "\n")  # test blocks are of 31 rows
    code, out, _ = call(monkeypatch, capsys, "compare", tmp_path / "short.csv", *QUICK)
    assert code == 0
    assert "\nring 2  0 windows: no stretch of test rows is long enough\n" in out


def test_a_tilt_the_other_way_round_is_noted(monkeypatch, capsys, folder):
    _, out, _ = call(monkeypatch, capsys, "compare", folder / "flipped.csv", *QUICK)
    assert out.count("note: beta is counted the other way round") == 1
    assert "note: gamma" not in out
    _, out, _ = call(monkeypatch, capsys, "compare", folder / "flipped.csv", *QUICK, "--json")
    assert json.loads(out)["ring2"]["signs"] == {"beta": -1, "gamma": 1}


def test_a_ring_of_a_table_that_tells_rings_is_compared_as_if_alone(monkeypatch, capsys, folder):
    """A log without rows of it is left out, and that is said."""
    found = []
    for given in (["one.csv"], ["both.csv", "--ring", "2"], ["both.csv", "one.csv", "--ring", "3"]):
        monkeypatch.chdir(folder)
        code, out, err = call(monkeypatch, capsys, "compare", *given, *QUICK, "--json")
        assert code == 0
        found.append((json.loads(out), err))
    (alone_, _), (filtered, silent), (third, told) = found
    assert list(filtered) == ["ring2"]
    assert filtered["ring2"]["n_test"] == alone_["ring2"]["n_test"]
    assert filtered["ring2"]["nrmse_test"]["p"] == pytest.approx(alone_["ring2"]["nrmse_test"]["p"], abs=1e-3)
    assert "left out" not in silent
    assert list(third) == ["ring3"]
    assert "left out: one.csv has no row of ring 3, but of 2" in told


def test_the_test_log_is_what_is_scored(monkeypatch, capsys, folder):
    found = []
    for test in ("one", "rubbish"):
        arguments = ("compare", folder / "one.csv", "--test", folder / f"{test}.csv", *QUICK, "--json")
        code, out, _ = call(monkeypatch, capsys, *arguments)
        assert code == 0
        found.append(json.loads(out)["ring2"])
    good, bad = found
    assert good["n_test"] > 850
    assert good["nrmse_train"] == bad["nrmse_train"]
    for kind in ("np", "sp"):
        assert good["nrmse_test"][kind] < 0.5
        assert bad["nrmse_test"][kind] > 0.9


def test_learning_curves_are_drawn(monkeypatch, capsys, folder, tmp_path):
    picture = tmp_path / "new" / "one" / "curve.png"
    pages = ("--curve", picture, "--report", tmp_path / "page.html")
    code, out, err = call(monkeypatch, capsys, "compare", folder / "one.csv", *QUICK, *pages, "--json")
    assert code == 0
    assert picture.read_bytes().startswith(b"\x89PNG")
    assert f"wrote {picture}" in err
    curve = json.loads(out)["ring2"]["curve"]
    assert set(curve) == KINDS - {"p"}
    assert all(n == 50 for n, _ in curve["sp"])  # fewer are never tried
    page = alone(tmp_path / "page.html")
    ring = json.loads(out)["ring2"]
    assert f"{ring['nrmse_train']['sp']:.3f} / {ring['nrmse_test']['sp']:.3f}" in page.replace(HARD, " ")
    assert page.count("<figure") == 4
    for kind, bands in ring["bands"].items():
        assert bands["mean"][20] == pytest.approx(ring["rollout"][kind]["20"], abs=1e-4)
    assert sum(map(sum, ring["residual"]["count"])) == ring["n_test"]


def test_a_table_without_ring_is_helped_by_options(monkeypatch, capsys, folder):
    code, out, err = call(monkeypatch, capsys, "compare", folder / "bare.csv", *QUICK)
    assert (code, out) == (2, "")
    assert "bare.csv: cannot tell the ring of a row: expected a column ring, or r (or x, y), or --ring N" in err
    code, _, err = call(monkeypatch, capsys, "compare", folder / "bare.csv", *QUICK, "--ring", "8")
    assert code == 2
    assert "--ring: got 8, expected 1 to 5" in err
    found = []
    for more in (("--ring", "2"), ("--ring", "8", "--radius", "0.068915")):
        code, out, _ = call(monkeypatch, capsys, "compare", folder / "bare.csv", *QUICK, *more, "--json")
        assert code == 0
        [ring] = json.loads(out).values()
        found.append(ring["nrmse_test"]["p"])
    assert found[0] == pytest.approx(found[1], abs=2e-4)


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["one.csv", "--rates", "late"], "--rates: got 'late', expected one of auto, smoothed, delayed, filtered"),
        (["one.csv", "--kernel", "matern"], "--kernel: got 'matern', expected one of auto, rbf, exponential"),
        (["one.csv", "--smoothing", "none"], "--smoothing: got 'none', expected one of savgol, rts"),
        (["one.csv", "--device", "tpu"], "got 'tpu', expected cpu or cuda"),
        (["one.csv", "--delay", "nan"], "delay: got nan, expected a finite number"),
        (["one.csv", "--delay=-1"], "delay: got -1, expected a finite number"),
        (["one.csv", "--delay", "1000"], "got 0 rows to train"),
        (["one.csv", "--radius", "0"], "--radius: got 0, expected"),
        (["one.csv", "--ring", "0"], "--ring"),
        (["one.csv", "--ring", "5"], "--ring: got 5, a disc"),
        (["one.csv", "--ring", "99"], "--ring: got 99, expected 1 to 5 (map cme)"),
        (["both.csv", "--ring", "1"], "both.csv has no row of ring 1, but of 2, 3"),
        (["both.csv", "--ring", "7", "--radius", "0.07"], "both.csv has no row of ring 7, but of 2, 3"),
        (["both.csv", "--ring", "3", "--test", "one.csv"], "one.csv has no row of ring 3, but of 2"),
        (["one.csv", "--most", "3"], "--most"),
        (["one.csv", "--seed=-1"], "--seed"),
        (["one.csv", "--map", "none.yaml"], "none.yaml"),
        (["one.csv", "--report", "a.txt"], "--report: got 'a.txt', expected a file that ends in .html"),
        (["one.csv", "--curve", "a.txt"], "--curve: got 'a.txt', expected a file that ends in .png, .svg, .pdf"),
        (["one.csv", "--curve", "one.csv/a.png"], "one.csv is a file; expected a folder that can be made"),
        (["one.csv", "--bands", "1"], "--bands: got 1, expected 0 (none), or 50"),
        (["one.csv", "--bands", "49"], "--bands: got 49, expected 0 (none), or 50"),
        (["one.csv", "--test", "none.csv"], "none.csv: no such file"),
        (["none.csv"], "none.csv: no such file"),
        (["none.mcap"], "none.mcap: no such file"),
        ([], "'logs'"),
    ],
)
def test_bad_input_is_one_line_and_two(monkeypatch, capsys, folder, arguments, said):
    monkeypatch.chdir(folder)
    code, out, err = call(monkeypatch, capsys, "compare", *arguments)
    assert code == 2
    assert out == ""
    lines = [line for line in err.strip().splitlines() if not line.startswith("ring ")]  # but for what is being done
    assert len(lines) == 1
    assert said in lines[0]


def test_without_torch_it_says_what_to_install(monkeypatch, capsys, folder):
    monkeypatch.setitem(sys.modules, "torch", None)
    code, out, err = call(monkeypatch, capsys, "compare", folder / "one.csv")
    assert (code, out) == (2, "")
    assert to_install("learn") in err
    assert len(err.strip().splitlines()) == 1
