"""Arrays beside a model file that are made to do harm: pickles, archives that unpack to much, false headers."""

from __future__ import annotations

import io
import pickle
import zipfile
from pathlib import Path

import numpy as np
import pytest
from process_folder import MODEL, arrays, assert_refused, put

from mazeplan.learning.gp_file import MOST_BYTES, NAMES
from mazeplan.learning.modelfile import save_model

# --- nothing is executed, nothing is unpacked without limit ---


@pytest.fixture
def folder(tmp_path):
    save_model(MODEL, tmp_path / "m")
    return tmp_path / "m"


class Trap:
    """Leaves a mark on disk when it is unpickled."""

    def __init__(self, mark):
        self.mark = mark

    def __reduce__(self):
        return Path.touch, (self.mark,)


@pytest.mark.parametrize("name", ["inputs", "alpha", "family"])
def test_a_pickle_among_the_arrays_is_not_executed(folder, tmp_path, name):
    trap = np.array([Trap(tmp_path / "mark")], dtype=object)
    stream = io.BytesIO()
    np.savez(stream, **{**arrays(folder), name: trap})  # pyright: ignore[reportArgumentType]
    put(folder, stream.getvalue())
    assert_refused(folder, "processes.1", line_of="1:")
    assert not (tmp_path / "mark").exists()
    with np.load(folder / "ring1.npz", allow_pickle=True) as held:
        held[name]
    assert (tmp_path / "mark").exists()  # the trap works


def test_a_pickle_in_place_of_the_archive_is_not_executed(folder, tmp_path):
    put(folder, pickle.dumps(Trap(tmp_path / "mark")))
    assert_refused(folder, "processes.1", line_of="1:")
    assert not (tmp_path / "mark").exists()
    pickle.loads((folder / "ring1.npz").read_bytes())
    assert (tmp_path / "mark").exists()


def zipped(members):
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in members.items():
            archive.writestr(name, content)
    return stream.getvalue()


def test_a_small_file_that_unpacks_to_a_large_one_is_refused(folder):
    content = zipped({"inputs.npy": bytes(MOST_BYTES // 2 + 1), "alpha.npy": bytes(MOST_BYTES // 2 + 1)})
    assert len(content) < 200_000
    put(folder, content)
    assert_refused(
        folder,
        "processes.1",
        f"ring1.npz is no such file of arrays: it unpacks to more than {MOST_BYTES} bytes",
        line_of="1:",
    )


def header(shape, dtype="<f8"):
    """An .npy file that only promises its data."""
    text = f"{{'descr': '{dtype}', 'fortran_order': False, 'shape': {shape}, }}".ljust(117) + "\n"
    return b"\x93NUMPY\x01\x00" + len(text).to_bytes(2, "little") + text.encode() + bytes(80)


@pytest.mark.parametrize(
    "shape", ["(1000000000000000,)", "(3000000000, 9)", "(-1, 9)", "(10000000000000000000000,)", "()", "(2, 9"]
)
def test_an_array_that_claims_to_be_huge_is_not_made(folder, shape):
    members = {f"{name}.npy": header("()") for name in NAMES} | {"inputs.npy": header(shape)}
    put(folder, zipped(members))
    assert_refused(folder, "processes.1", "ring1.npz", line_of="1:")


def test_a_file_too_large_is_not_read(folder, monkeypatch):
    monkeypatch.setattr("mazeplan.learning.gp_file.MOST_BYTES", 1000)
    assert_refused(folder, "processes.1", "ring1.npz is larger than 1000 bytes", line_of="1:")
