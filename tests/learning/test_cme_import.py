"""Models of the published kind, trained here on a recording that is known, and what the importer makes of them."""

from __future__ import annotations

import os
import pickle

import numpy as np
import pytest
from cme_models import ENDING, RATE, record, train

from mazeplan.core.errors import ModelError
from mazeplan.core.logs.table import read_table
from mazeplan.learning.published_rig import PREFIX, find_models, import_ring, read_model, write_ring


@pytest.fixture(scope="module")
def recording():
    return record()


@pytest.fixture(scope="module")
def published(recording, tmp_path_factory):
    """A folder with a model of every second sample, and its noise variance."""
    folder = tmp_path_factory.mktemp("models")
    return folder, train(recording.rows(2), folder)


@pytest.fixture
def model(published, tmp_path):
    """A copy of that folder, to be spoilt."""
    for path in published[0].iterdir():
        (tmp_path / path.name).write_bytes(path.read_bytes())
    return tmp_path


def path_of(folder, name, ring=1):
    return folder / (PREFIX[name] + ENDING.format(ring))


def imported(folder, ring=1):
    return import_ring(read_model(folder, ring, find_models(folder)[ring]))


def test_the_training_data_come_back(recording, published):
    folder, noise_variance = published
    (table, figures), rows = imported(folder), recording.rows(2)
    assert (figures["step"], figures["segments"], figures["published"]) == (2, 4, len(rows))
    assert figures["noise_variance"] == pytest.approx(noise_variance, rel=1e-6)
    assert figures["noise"] == pytest.approx(np.sqrt(noise_variance) * rows.theta_ddot.std(), rel=1e-6)
    assert set(table["ring"]) == {1}
    measured = table["measured"] == 1
    turns = (table["theta"][measured] - rows.angles[:, 0]) / (2 * np.pi)
    assert np.allclose(turns, np.round(turns), atol=1e-9)
    assert np.allclose(table["beta"][measured], rows.angles[:, 1], atol=1e-9)
    assert np.allclose(table["gamma"][measured], rows.angles[:, 2], atol=1e-9)
    assert np.allclose(table["theta_ddot_pub"][measured], rows.theta_ddot, atol=1e-5)
    for i, axis in enumerate(("theta", "beta", "gamma")):
        assert np.allclose(table[f"{axis}_dot_pub"][measured], rows.rates[:, i], atol=1e-9)
        assert np.isnan(table[f"{axis}_dot_pub"][~measured]).all()


def test_the_samples_between_come_back(recording, published):
    table, _ = imported(published[0])
    columns = {name: values.to_numpy() for name, values in table.items()}
    for number, samples in enumerate(recording.thinned(2)[1]):
        mine = columns["segment"] == number
        assert mine.sum() == len(samples)
        assert np.allclose(columns["t"][mine], (samples - samples[0]) / RATE)
        truth = recording.angles[samples]
        theta = columns["theta"][mine]
        assert 0.0 <= theta[0] < 2 * np.pi
        assert np.allclose(theta - theta[0], truth[:, 0] - truth[0, 0], atol=1e-6)
        inner = slice(0, -20)  # the rates tell nothing of what follows them, so tilt is vague at the end
        assert np.allclose(columns["beta"][mine][inner], truth[inner, 1], atol=1e-5)
        assert np.allclose(columns["gamma"][mine][inner], truth[inner, 2], atol=1e-5)
        assert np.allclose(columns["theta_ddot"][mine][3:-3], recording.theta_ddot[samples][3:-3], atol=1e-3)
        for i, axis in enumerate(("theta", "beta", "gamma")):  # slope and bend of the parabola through seven samples
            for k in range(3, len(samples) - 20, 10):
                bend, slope, _ = np.polyfit(np.arange(-3, 4) / RATE, truth[k - 3 : k + 4, i], 2)
                assert columns[f"{axis}_dot"][mine][k] == pytest.approx(slope, abs=2e-4)
                assert columns[f"{axis}_ddot"][mine][k] == pytest.approx(2 * bend, abs=1e-2)
        for name in ("theta_dot", "beta_dot", "gamma_dot", "theta_ddot", "beta_ddot", "gamma_ddot"):
            empty = np.flatnonzero(np.isnan(columns[name][mine]))
            assert empty.tolist() == [0, 1, 2, len(samples) - 3, len(samples) - 2, len(samples) - 1]


def test_the_longest_model_of_a_ring_is_taken(published, model):
    for name in PREFIX:
        path_of(model, name).rename(model / (PREFIX[name] + "_ring1_long.txt"))
    short = "".join(path_of(published[0], "inputs").read_text().splitlines(keepends=True)[:20])
    path_of(model, "inputs").write_text(short)
    path_of(model, "inputs", 3).write_text(short)
    assert find_models(model) == {1: "_ring1_long.txt", 3: "_ring3_toy.txt"}


def test_the_table_is_one_that_mazeplan_reads(published, tmp_path):
    got, _ = imported(published[0])
    write_ring(got, tmp_path / "new" / "ring1.csv")
    text = (tmp_path / "new" / "ring1.csv").read_text()
    assert text.startswith(
        "ring,segment,t,measured,theta,beta,gamma,theta_dot,beta_dot,gamma_dot,theta_ddot,beta_ddot,gamma_ddot,"
        "theta_dot_pub,beta_dot_pub,gamma_dot_pub,theta_ddot_pub\n1,0,0,1,"
    )
    assert "nan" not in text
    table = read_table(tmp_path / "new" / "ring1.csv")
    for name, values in got.items():
        assert np.allclose(table[str(name)], values, rtol=1e-8, atol=1e-12, equal_nan=True)
    with pytest.raises(ModelError, match="cannot be written"):
        write_ring(got, tmp_path / "new" / "ring1.csv" / "ring1.csv")


def line(text):
    return lambda lines: lines.__setitem__(4, text)


@pytest.mark.parametrize(
    ("name", "spoil", "message"),
    [
        ("alpha", line("one"), r"alpha_hat_SP_ring1_toy.txt: not a text file of numbers: .*'one'"),
        ("inputs", line("1 2"), r"txt: got \d+ numbers, expected finite ones, 9 to a row"),
        ("alpha", lambda lines: lines.pop(), r"got \d+ rows of 1 numbers, expected \d+"),
        ("target_scale", lambda lines: lines.__setitem__(0, "0.001"), r"no noise gives targets of 0.001 rad/s\^2"),
    ],
)
def test_a_spoilt_file_is_told_with_its_line(model, name, spoil, message):
    lines = path_of(model, name).read_text().splitlines()
    spoil(lines)
    path_of(model, name).write_text("\n".join(lines) + "\n")
    with pytest.raises(ModelError, match=message) as caught:
        imported(model)
    assert "\n" not in str(caught.value)
    assert str(model) in str(caught.value)


class Trap:
    def __reduce__(self):
        return (os.mkdir, (os.environ["CME_TRAP"],))


def test_nothing_in_a_file_is_run(model, tmp_path, monkeypatch):
    monkeypatch.setenv("CME_TRAP", str(tmp_path / "sprung"))
    path_of(model, "alpha").write_bytes(pickle.dumps(Trap()))
    with pytest.raises(ModelError, match="not a text file of numbers"):
        imported(model)
    assert not (tmp_path / "sprung").exists()


def test_the_published_models():
    """Figures of the authors' files: each ring's step, and the noise of its targets."""
    folder = os.environ.get("MAZEPLAN_CME_MODELS")
    if not folder:
        pytest.skip("MAZEPLAN_CME_MODELS does not name the folder of the published model files (not distributed)")
    models = {ring: read_model(folder, ring, ending) for ring, ending in find_models(folder).items()}
    assert sorted(models) == [1, 2, 3, 4]
    noise = {1: 0.0795804, 2: 0.0811487, 3: 0.0469540, 4: 0.00217091}
    for ring, step in ((1, 4), (2, 3), (3, 2), (4, 1)):
        _, figures = import_ring(models[ring])
        assert figures["step"] == step
        assert figures["noise_variance"] == pytest.approx(noise[ring], rel=1e-5)
        assert figures["published"] == len(models[ring].alpha)
