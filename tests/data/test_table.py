"""Tables: read, worked out, refused with row and column."""

from __future__ import annotations

import numpy as np
import pytest

from mazeplan.data.excitation import multisine
from mazeplan.data.runlog import RunLogWriter
from mazeplan.data.smoothing import smoothed
from mazeplan.data.table import join, read_table
from mazeplan.errors import TableError
from mazeplan.records import Command, Observation

GOOD = "t,x,y,beta,gamma,note\n0.0,0.1,0.0,0.01,0.02,1\n0.033,0.0,0.1,0.01,0.02,2\n0.067,,,0.01,0.02,3\n"


def write(tmp_path, text):
    path = tmp_path / "table.csv"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return path


def test_theta_and_r_are_worked_out_and_unknown_columns_kept(tmp_path):
    table = read_table(write(tmp_path, GOOD))
    assert table["theta"][:2] == pytest.approx([0.0, np.pi / 2])
    assert table["r"][:2] == pytest.approx([0.1, 0.1])
    assert np.isnan(table["theta"][2])
    assert list(table["note"]) == [1, 2, 3]
    assert table.source["file"] == "table.csv"
    assert len(table.source["sha256"]) == 64
    assert list(table.segment) == [0, 0, 0]


@pytest.mark.parametrize(
    ("text", "line", "said"),
    [
        ("t,x,y,beta\n0,1,1,1\n", None, "column gamma is missing; there are t, x, y, beta"),
        ("t,beta,gamma\n0,0,0\n1,0,0\n", None, "needs theta, or x and y"),
        (GOOD.replace("0.067", "0.02"), 4, "t: got 0.02 after 0.033, expected it to grow"),
        (GOOD.replace("0.067", ""), 4, "t: no finite number"),
        (GOOD.replace("0.033,0.0,0.1,0.01", "0.033,0.0,0.1,nan"), 3, "beta: no finite number"),
        (GOOD.replace("0.033,0.0,0.1,0.01", "0.033,0.0,0.1,2.5"), 3, "are these degrees?"),
        (GOOD.replace("0.067,,", "0.067,"), 4, "got 5 fields, expected 6"),
        (GOOD.replace("0.033,0.0", "0.033,zero"), 3, "x: got 'zero', expected a number"),
        ("t,t,beta\n", 1, "each name once"),
        ("", 1, "header"),
        ("t,theta,beta,gamma\n0,0,0,0\n", None, "got 1 rows"),
        (b"\xff\xfe\x00\x01", None, "not a CSV file"),
    ],
)
def test_mistakes_name_row_and_column(tmp_path, text, line, said):
    path = write(tmp_path, text)
    with pytest.raises(TableError) as error:
        read_table(path)
    assert str(error.value).startswith(f"{path}:{'' if line is None else f'{line}:'} ")
    assert said in str(error.value)


def test_missing_file(tmp_path):
    with pytest.raises(TableError, match="no such file"):
        read_table(tmp_path / "none.csv")


def test_a_run_log_is_a_table(tmp_path):
    path = tmp_path / "log.mcap"
    with RunLogWriter(path, {"rig": "test"}) as log:
        for k in range(5):
            seen = (None, None) if k == 2 else (0.1, 0.01 * k)
            log.sample(Observation(k / 30, *seen, 0.01, 0.02), Command(0.03, 0.04), segment=0)
    table = read_table(path)
    assert len(table) == 5
    assert np.isnan(table["x"][2])
    assert list(table["u_gamma"]) == [0.04] * 5


def test_joined_tables_keep_their_segments_apart(tmp_path):
    one = read_table(write(tmp_path, GOOD))
    both = join([one, one])
    assert list(both.segment) == [0, 0, 0, 1, 1, 1]
    assert len(both) == 6


def test_multisine_keeps_band_limit_and_seed():
    limit, rate = 0.0873, 30.0
    u = multisine(np.random.default_rng(3), 200.0, rate, limit)
    assert u.shape == (6000, 2)
    assert np.max(np.abs(u)) <= limit
    assert 0.25 * limit < u.std() < 0.6 * limit
    power = np.abs(np.fft.rfft(u[:, 0])) ** 2
    frequency = np.fft.rfftfreq(6000, 1 / rate)
    assert power[frequency > 1.7].sum() < 0.03 * power.sum()
    assert np.array_equal(u, multisine(np.random.default_rng(3), 200.0, rate, limit))
    assert abs(np.corrcoef(u.T)[0, 1]) < 0.3


def test_smoothing_keeps_cubics_and_their_slopes():
    t = np.arange(30) * 0.1
    assert smoothed(t**3, 7) == pytest.approx(t**3)
    assert smoothed(t**3, 7, deriv=1, dt=0.1) == pytest.approx(3 * t**2)
