"""Arrays beside a model file: the round trip, and everything that may be wrong with them, told in one line."""

from __future__ import annotations

import io
import pickle
import zipfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from process_folder import MODEL, arrays, assert_refused, put

from mazeplan.core.array_file import MOST_BYTES
from mazeplan.core.errors import ModelError
from mazeplan.learning.gaussian_process import GaussianProcess, Hyperparameters, KernelTerm
from mazeplan.learning.gp_file import rounded
from mazeplan.learning.modelfile import load_model, save_model

# --- round trip ---


@pytest.fixture
def folder(tmp_path):
    save_model(MODEL, tmp_path / "m")
    return tmp_path / "m"


def test_a_model_with_processes_comes_back_as_it_was(folder):
    again = load_model(folder)
    assert again == MODEL
    assert sorted(again.processes) == [1, 2]
    x = np.random.default_rng(5).standard_normal((200, 9))
    for ring, gp in MODEL.processes.items():
        back = again.processes[ring]
        np.testing.assert_allclose(back.mean(x), gp.mean(x), rtol=0.0, atol=1e-9)
        np.testing.assert_array_equal(back.inputs, gp.inputs)
        np.testing.assert_array_equal(back.alpha, gp.alpha)
        np.testing.assert_array_equal(back.hyper.only.lengthscales, gp.hyper.only.lengthscales)
        assert (back.hyper.only.amplitude, back.hyper.noise) == (gp.hyper.only.amplitude, gp.hyper.noise)
        assert np.abs(gp.mean(x)).max() > 0.5


def seven(seed=3):
    """A process that does not look at the cosines of the tilt."""
    rng = np.random.default_rng(seed)
    x, columns = rounded(rng.standard_normal((40, 9))), (0, 1, 2, 3, 4, 5, 7)
    hyper = Hyperparameters((KernelTerm(columns, np.exp(0.5 * rng.standard_normal(7)), 1.5),), 0.3, np.zeros(0))
    return GaussianProcess.condition(hyper, x, np.zeros((40, 0)), np.sin(x[:, 0]) + x[:, 3])


def test_a_kernel_may_look_at_some_inputs_only(tmp_path):
    gp = seven()
    save_model(replace(MODEL, processes={1: gp}), tmp_path)
    back = load_model(tmp_path).processes[1]
    x = np.random.default_rng(7).standard_normal((50, 9))
    np.testing.assert_allclose(back.mean(x), gp.mean(x), atol=1e-9)
    assert back.hyper.only.columns == (0, 1, 2, 3, 4, 5, 7)


# --- entries ---


@pytest.mark.parametrize(
    ("entry", "key", "said"),
    [
        ("5", "processes", "got 5, expected a mapping"),
        ("{1: {sha256: ab}}", "processes.1", "expected file and sha256"),
        ("{1: {file: ring1.npz, sha256: ab}}", "processes.1", "its sha256 differs"),
    ],
)
def test_entries_that_lead_nowhere(folder, entry, key, said):
    path = folder / "model.yaml"
    text = path.read_text()
    begin, end = text.index("processes:"), text.index("data:")
    path.write_text(text[:begin] + f"processes: {entry}\n" + text[end:])
    assert_refused(folder, key, said, line_of="processes")


# --- arrays that are not what they should be ---


def test_damaged_anywhere_it_is_refused_or_still_whole(folder):
    """With a checksum to match: whatever byte is changed, the answer is a process or one line."""
    content, rng = (folder / "ring1.npz").read_bytes(), np.random.default_rng(0)
    for _ in range(150):
        damaged = bytearray(content)
        for at in rng.integers(0, len(content), 3):
            damaged[at] = rng.integers(256)
        put(folder, bytes(damaged))
        said = f"{folder / 'model.yaml'}:"
        try:
            load_model(folder)
        except ModelError as problem:
            said = str(problem)
        assert said.startswith(f"{folder / 'model.yaml'}:")
        assert "\n" not in said


class Trap:
    """Leaves a mark on disk when it is unpickled."""

    def __init__(self, mark):
        self.mark = mark

    def __reduce__(self):
        return Path.touch, (self.mark,)


@pytest.mark.parametrize("whole", [False, True])
def test_a_pickle_is_not_executed(folder, tmp_path, whole):
    trap, stream = Trap(tmp_path / "mark"), io.BytesIO()
    if whole:
        stream.write(pickle.dumps(trap))
    else:
        np.savez(stream, **{**arrays(folder), "alpha": np.array([trap], dtype=object)})  # pyright: ignore
    put(folder, stream.getvalue())
    assert_refused(folder, "processes.1", line_of="1:")
    assert not (tmp_path / "mark").exists()


def test_a_small_file_that_unpacks_to_a_large_one_is_refused(folder):
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED) as archive:
        for name in ("inputs.npy", "alpha.npy"):
            archive.writestr(name, bytes(MOST_BYTES // 2 + 1))
    put(folder, stream.getvalue())
    assert_refused(folder, "processes.1", line_of="1:")
