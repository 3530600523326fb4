"""Arrays beside a model file: the round trip, and everything that may be wrong with them, told in one line."""

from __future__ import annotations

import hashlib
import io
import pickle
import re
import zipfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from process_folder import MODEL, arrays, assert_refused, edit, process, put, saved

from mazeplan.core.errors import ModelError
from mazeplan.learning.gaussian_process import GaussianProcess, Hyperparameters, KernelTerm
from mazeplan.learning.gp_file import MOST_BYTES, MOST_ROWS, NAMES, rounded
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
        with pytest.raises(ModelError, match="mean alone"):
            back.variance(x)


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
    told = (tmp_path / "model.yaml").read_text()
    assert "sin_beta" in told
    assert "cos_beta" not in told


def test_a_file_without_columns_is_of_a_kernel_that_looks_at_all(folder):
    held = arrays(folder)
    assert held.pop("columns").tolist() == list(range(9))
    put(folder, saved(**held))
    x = np.random.default_rng(8).standard_normal((50, 9))
    np.testing.assert_allclose(load_model(folder).processes[1].mean(x), MODEL.processes[1].mean(x), atol=1e-9)


@pytest.mark.parametrize(
    "columns", [np.arange(10), np.array([0, 0, 1]), np.array([2, 1]), np.array([], dtype=int), np.array([0.0, 1.0])]
)
def test_columns_that_are_none_are_refused(folder, columns):
    put(folder, saved(**{**arrays(folder), "columns": columns}))
    assert_refused(folder, "processes.1", "columns", "expected some of 0 to 8")


def test_the_file_tells_people_what_is_in_the_arrays(folder):
    text = (folder / "model.yaml").read_text()
    assert "rows: 50" in text
    assert "rows: 80" in text
    assert "kernel: rbf" in text
    assert "amplitude: {value: 1.73205, unit: rad/s^2}" in text
    assert "noise: {value: 0.314159, unit: rad/s^2}" in text
    assert re.search(r"theta_dot: \{value: [0-9.]+, unit: rad/s\}", text)
    assert re.search(r"sin_theta: \{value: [0-9.]+, unit: '1'\}", text)


@pytest.mark.parametrize("kind", ["p", "pi"])
def test_a_model_without_processes_has_no_such_key(tmp_path, kind):
    text = save_model(replace(MODEL, kind=kind, processes={}), tmp_path).read_text()
    assert "processes" not in text
    assert load_model(tmp_path).processes == {}


def test_only_a_plain_kernel_can_be_written(tmp_path):
    gp = process()
    odd = KernelTerm((0, 1), np.ones(2), 1.0, (-1.0, 1.0))
    with pytest.raises(ModelError, match="plain kernel"):
        save_model(replace(MODEL, processes={1: replace(gp, hyper=replace(gp.hyper, terms=(odd,)))}), tmp_path)


# --- changed by hand ---


@pytest.mark.parametrize(
    ("old", "new", "key"),
    [
        (r"rows: 50", "rows: 51", "rows"),
        (r"kernel: rbf", "kernel: exponential", "kernel"),
        (r"amplitude: \{value: 1.73205", "amplitude: {value: 1.74", "amplitude"),
        (r"amplitude: \{value: 1.73205", "amplitude: {value: .nan", "amplitude"),
        (r"amplitude: \{value: 1.73205, unit: rad/s\^2\}", "amplitude: 2", "amplitude"),
        (r"noise: \{value: 0.314159, unit: rad/s\^2\}", "noise: {value: 0.314159, unit: m}", "noise"),
        (r"theta_dot: \{value: [0-9.]+", "theta_dot: {value: 9.0", "lengthscales"),
        (r"theta_dot: \{", "theta_dott: {", "lengthscales"),
        (r"lengthscales:", "lengthscale:", "lengthscale"),
        (r"    kernel: rbf\n", "    kernel: rbf\n    extra: 3\n", "extra"),
    ],
)
def test_hyperparameters_changed_by_hand_are_refused(folder, old, new, key):
    edit(folder, old, new)
    with pytest.raises(ModelError) as error:
        load_model(folder)
    assert re.match(rf"{re.escape(str(folder / 'model.yaml'))}:\d+: processes\.1(\.{key})?: ", str(error.value))
    assert key in str(error.value)
    assert "changed by hand" in str(error.value)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("kind", ["np", "sp"])
def test_kinds_that_need_processes(tmp_path, kind):
    save_model(replace(MODEL, kind="pi", processes={}), tmp_path)
    edit(tmp_path, "kind: pi", f"kind: {kind}")
    said = f"got {kind}, but there are no Gaussian processes (section processes) in this file; expected pi, or make"
    assert_refused(tmp_path, "kind", said)
    edit(tmp_path, "data:", "processes: {}\ndata:")
    assert_refused(tmp_path, "kind", said)


@pytest.mark.parametrize("kind", ["p", "pi"])
def test_kinds_that_have_none(folder, kind):
    edit(folder, "kind: sp", f"kind: {kind}")
    assert_refused(folder, "processes", f"kind {kind} has no processes")


@pytest.mark.parametrize(
    ("entry", "key", "said"),
    [
        ("5", "processes", "got 5, expected a mapping"),
        ("{1: 5}", "processes.1", "got 5, expected a mapping"),
        ("{1: {file: ring1.npz}}", "processes.1", "sha256 is missing"),
        ("{1: {sha256: ab}}", "processes.1", "file is missing"),
        ("{1: {file: [a], sha256: ab}}", "processes.1", "expected the name of an .npz file beside model.yaml"),
        ("{1: {file: ring9.npz, sha256: ab}}", "processes.1", "ring9.npz cannot be read: No such file"),
        ("{1: {file: ring1.npz, sha256: ab}}", "processes.1", "its sha256 differs"),
        ("{1: {file: ring1.npz, sha256: 5}}", "processes.1", "its sha256 differs"),
        ("{1: {file: ring2.npz, sha256: SHA}}", "processes.1", "its sha256 differs"),
    ],
)
def test_entries_that_lead_nowhere(folder, entry, key, said):
    path = folder / "model.yaml"
    text = path.read_text()
    entry = entry.replace("SHA", hashlib.sha256((folder / "ring1.npz").read_bytes()).hexdigest())
    begin, end = text.index("processes:"), text.index("data:")
    path.write_text(text[:begin] + f"processes: {entry}\n" + text[end:])
    assert_refused(folder, key, said, line_of="processes")


@pytest.mark.parametrize("name", ["../x.npz", "/etc/passwd", "sub/x.npz", "ring1.txt", "..", ".npz", "a/../ring1.npz"])
def test_files_elsewhere_are_not_read(folder, name):
    (folder.parent / "x.npz").write_bytes((folder / "ring1.npz").read_bytes())
    (folder / "sub").mkdir()
    (folder / "sub" / "x.npz").write_bytes((folder / "ring1.npz").read_bytes())
    edit(folder, "file: ring1.npz", f"file: {name}")
    assert_refused(folder, "processes.1", f"file: got '{name}', expected the name of an .npz file", line_of="1:")


def test_a_ring_that_is_none(folder):
    edit(folder, "processes:\n  1:", "processes:\n  one:")
    assert_refused(folder, "processes.one", "got 'one', expected a ring number")


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


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"inputs": np.zeros((50, 8), np.float32)}, "inputs"),
        ({"inputs": np.zeros((49, 9), np.float32)}, "inputs"),
        ({"inputs": np.full((50, 9), np.nan, np.float32)}, "finite"),
        ({"inputs": np.full((50, 9), "a")}, "ring1.npz"),
        ({"alpha": np.full(50, np.nan)}, "finite"),
        ({"alpha": np.zeros((50, 1))}, "alpha"),
        ({"inputs": np.zeros((MOST_ROWS + 1, 9), np.float32), "alpha": np.zeros(MOST_ROWS + 1)}, "inputs"),
        ({"lengthscales": np.ones(8)}, "hyperparameters"),
        ({"lengthscales": np.zeros(9)}, "lengthscales"),
        ({"amplitude": np.array(-1.0)}, "amplitude"),
        ({"noise": np.array(np.inf)}, "noise"),
        ({"family": np.array("magic\nkernel")}, "family"),
    ],
)
def test_other_arrays_than_expected(folder, change, said):
    put(folder, saved(**{**arrays(folder), **change}))
    assert_refused(folder, "processes.1", said, line_of="1:")


@pytest.mark.parametrize("name", NAMES)
def test_an_array_that_is_missing(folder, name):
    held = arrays(folder)
    del held[name]
    put(folder, saved(**held))
    assert_refused(folder, "processes.1", f"ring1.npz is no such file of arrays: it lacks {name}", line_of="1:")


def test_an_array_on_its_own_is_no_archive(folder):
    stream = io.BytesIO()
    np.save(stream, np.zeros(3))
    put(folder, stream.getvalue())
    assert_refused(folder, "processes.1", "ring1.npz is no such file of arrays", line_of="1:")


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
