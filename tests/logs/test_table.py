"""Tables: read, worked out, refused with line and column."""

from __future__ import annotations

import numpy as np
import pytest

from mazeplan.core.errors import InputError, TableError
from mazeplan.core.logs import table as module
from mazeplan.core.logs.columns import parse_columns
from mazeplan.core.logs.run_log import RunLogWriter
from mazeplan.core.logs.table import Table, join, read_table, stretches
from mazeplan.core.records import Command, Observation
from mazeplan.run.collect import multisine

GOOD = "t,x,y,beta,gamma,note\n0.0,0.1,0.0,0.01,0.02,1\n0.033,0.0,0.1,0.01,0.02,2\n0.067,,,0.01,0.02,3\n"


def write(tmp_path, text):
    path = tmp_path / "table.csv"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return path


def csv(**columns):
    """CSV text of columns of equal length, exact to the last digit."""
    rows = (",".join(repr(float(value)) for value in row) for row in zip(*columns.values(), strict=True))
    return "\n".join([",".join(columns), *rows]) + "\n"


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
        ("t,x,y,beta\n0,1,1,1\n", None, "missing columns: gamma; there are t, x, y, beta"),
        (GOOD.replace("0.067", ""), 4, "t: got an empty cell, expected a finite number"),
        (GOOD.replace("0.033,0.0", "0.033,-inf"), 3, "x: got '-inf', expected a finite number, or an empty cell"),
        (GOOD.replace("0.067,,", "0.067,,,"), 4, "got 7 fields, expected 6"),
        (GOOD.replace("0.01", "True"), 2, "beta: got 'True', expected a number"),
        (GOOD.replace("note", "r").replace(",2\n", ",-.1\n"), 3, "r: got -0.1, expected at least 0 m"),
        ("T,Theta,Beta,gamma\n0,0,0,0\n", None, "others: --columns NAME=COLUMN[:UNIT]"),
        ("", None, "got an empty file"),
        (
            GOOD.replace(",", ";"),
            None,
            "there are t;x;y;beta;gamma;note",
        ),
        ("t,theta,beta,gamma\n", None, "got 0 rows"),
        (GOOD.encode() + b"0.1,0.1,0.1,0,0,\xb5m\n", 5, "not a CSV file: got byte 0xb5, expected UTF-8 text"),
        (GOOD + '0.1,"' + "9" * 200_000 + '",0.1,0,0,4\n', 5, "not a CSV file: field larger than field limit"),
    ],
)
def test_mistakes_name_line_and_column(tmp_path, text, line, said):
    path = write(tmp_path, text)
    with pytest.raises(TableError) as error:
        read_table(path)
    assert str(error.value).startswith(f"{path}:{'' if line is None else f'{line}:'} ")
    assert said in str(error.value)
    assert "\n" not in str(error.value)


def test_lines_are_those_of_the_file(tmp_path):
    """Blank lines, line ends of other systems, a byte order mark, and cells that go over several lines."""
    bad = '\ufeff\n"t",x,y,beta,gamma,note\r\n0.0,0.1,0.0,0.01,0.02,"one\nnote, two lines"\r\n\r\n   \n0.1,oops,,0,0,\n'
    with pytest.raises(TableError, match=r"table.csv:7: x: got 'oops'"):
        read_table(write(tmp_path, bad))
    with pytest.raises(TableError, match=r"table.csv:5: x: got 'oops'"):
        read_table(write(tmp_path, "t,x,y,beta,gamma\r0,.1,.1,0,0\r\r \r.1,oops,.1,0,0\r"))
    good = read_table(write(tmp_path, bad.replace("oops", "0.1")))
    assert list(good["t"]) == [0.0, 0.1]
    assert np.isnan(good["note"]).all()  # text in a column that nobody knows is no mistake


def test_unknown_text_columns_without_names_and_blanks_are_no_mistake(tmp_path):
    text = ",t , theta,beta,gamma,who,level\n0, 0,0.1 ,0,0,me,3\n1,0.1, NA,0,0,,low\n2,\t0.2,.3,+0,0,7,1e3\n"
    table = read_table(write(tmp_path, text))
    assert list(table.columns) == ["t", "theta", "beta", "gamma", "who", "level"]
    assert list(table["t"]) == [0.0, 0.1, 0.2]
    assert table["theta"] == pytest.approx([0.1, np.nan, 0.3], nan_ok=True)
    assert table["who"] == pytest.approx([np.nan, np.nan, 7.0], nan_ok=True)
    assert table["level"] == pytest.approx([3.0, np.nan, 1000.0], nan_ok=True)


@pytest.mark.parametrize("quoted", [False, True])
def test_numbers_are_read_exactly(tmp_path, quoted):
    rng = np.random.default_rng(1)
    values = rng.standard_normal(3000) * 10.0 ** rng.integers(-300, 300, 3000)
    zero = np.zeros(3000)
    text = csv(t=np.arange(3000) / 30.0, theta=zero, beta=zero, gamma=zero, v=values)
    table = read_table(write(tmp_path, text.replace("theta", '"theta"') if quoted else text))
    assert np.array_equal(table["v"], values)
    assert np.array_equal(table["t"], np.arange(3000) / 30.0)


def test_derivatives_may_be_empty_at_the_edges_of_segments(tmp_path):
    text = "segment,t,theta,beta,gamma,theta_dot,theta_ddot\n0,0,1,0,0,,\n0,.1,1,0,0,2,\n1,0,9,0,0,,3\n"
    table = read_table(write(tmp_path, text))
    assert table["theta_dot"] == pytest.approx([np.nan, 2.0, np.nan], nan_ok=True)
    assert list(table["t"]) == [0.0, 0.1, 0.0]  # time may start again in each segment
    with pytest.raises(TableError, match=r":3: theta_dot: got 'fast', expected a number"):
        read_table(write(tmp_path, text.replace(",2,", ",fast,")))


@pytest.mark.parametrize("factor", [1e3, 1e9])
def test_other_units_of_time_are_suspected(tmp_path, factor):
    t = np.arange(50) / 30.0 * factor
    with pytest.raises(TableError, match=r":3: t: got steps of .* expected at most 0.5 s .*: --columns t=t:ms"):
        read_table(write(tmp_path, csv(t=t, theta=t * 0, beta=t * 0, gamma=t * 0)))


PLACED = {"t": [0.0, 0.033, 0.067], "x": [0.09, 0.08, 0.07], "y": [0.0, 0.01, 0.02], "beta": [0.01, 0.02, 0.03]}


@pytest.mark.parametrize(
    ("names", "columns"),
    [
        ({"t": ("t_ms", 1e3), "x": ("x_mm", 1e3), "y": ("y_cm", 1e2), "beta": ("beta_deg", 180.0 / np.pi)}, ()),
        (
            {"t": ("time", 1e6), "x": ("east_mm", 1e3), "y": ("north", 1e2), "beta": ("lean", 180.0 / np.pi)},
            ("t=time:us", "x=east_mm y=north:cm", "beta=lean:deg"),
        ),
    ],
)
def test_columns_of_other_names_and_units_are_read_as_if_they_had_ours(tmp_path, names, columns):
    there = {names[name][0]: np.multiply(names[name][1], column) for name, column in PLACED.items()}
    there["gamma"] = np.zeros(3)
    found = read_table(write(tmp_path, csv(**there)), parse_columns(columns))
    assert {name: pytest.approx(found[name]) for name in PLACED} == PLACED
    assert found["theta"] == pytest.approx(np.arctan2(PLACED["y"], PLACED["x"]))
    assert found["gamma"] == pytest.approx(np.zeros(3))


@pytest.mark.parametrize(
    ("columns", "said"),
    [
        ({"beta": "tilt"}, "column tilt is missing; there are t, east, y, beta, gamma"),
        ({"x": "east:deg"}, "--columns x: got a unit of rad, expected one of m"),
        ({"thetta": "east"}, "--columns: got name 'thetta', expected .* did you mean theta"),
        ({"x": "east"}, "table.csv:3: east: got 80, expected metres .* --columns x=east:mm"),
    ],
)
def test_columns_that_cannot_be_used(tmp_path, columns, said):
    there = {"t": PLACED["t"], "east": [0.09, 80.0, 0.07], "y": PLACED["y"], "beta": PLACED["beta"], "gamma": [0, 0, 0]}
    with pytest.raises(InputError, match=said):
        read_table(write(tmp_path, csv(**there)), parse_columns(columns))


def angles(n=600):
    """A ball that goes to and fro several turns, theta in rad, and camera noise."""
    t = np.arange(n) / 30.0
    noise = 1e-2 * np.random.default_rng(0).standard_normal(n)
    return t, 12.0 * np.sin(0.4 * t) + noise


T, THETA = angles()
SLOW = 0.025 * THETA  # at most .12 rad/s
WRAPPED = np.mod(THETA, 2 * np.pi)
XY = {"x": 0.09 * np.cos(THETA), "y": 0.09 * np.sin(THETA)}
NOISE = np.random.default_rng(1).uniform(-0.1, 0.1, len(T))


def table_with(tmp_path, columns):
    return read_table(write(tmp_path, csv(**{"t": T, "beta": T * 0, "gamma": T * 0, **columns})))


@pytest.mark.parametrize(
    "columns",
    [
        {"theta": np.degrees(THETA)},  # faster than a ball can roll
        {"theta": np.degrees(np.mod(SLOW, 2 * np.pi))},  # jumps by 360
        {"theta": np.degrees(SLOW) % 360.0, "segment": np.arange(len(T)) // 300},
        {"theta": np.round(np.degrees(SLOW + 1.0))},  # whole numbers
        {
            "theta": np.degrees(0.3 * WRAPPED) % 360.0,
            **{k: 0.09 * f(0.3 * WRAPPED) for k, f in zip("xy", (np.cos, np.sin), strict=True)},
        },
        {"theta": np.where(np.arange(len(T)) % 3 == 0, np.nan, np.degrees(THETA))},
    ],
)
def test_degrees_in_theta_are_told_when_sure(tmp_path, columns):
    with pytest.raises(TableError, match=r"theta: got .* expected radians; these are degrees"):
        table_with(tmp_path, columns)


@pytest.mark.parametrize(
    "columns",
    [
        {"theta": THETA},
        {"theta": WRAPPED},
        {"theta": THETA + 700.0},
        {"theta": np.round(WRAPPED)},
        {"theta": WRAPPED, "x": XY["y"], "y": XY["x"]},  # a camera that is turned
        {"theta": np.where(np.arange(len(T)) % 3 == 0, np.nan, THETA)},
        {"theta": SLOW + 50.0 + NOISE, "t": T / 30.0},  # 900 Hz, so noise of the camera looks fast
        {"theta": SLOW + 330.0 * (np.arange(len(T)) // 300), "segment": np.arange(len(T)) // 300},
        {"theta": SLOW + 50.0, "segment": np.arange(len(T))},  # no two rows belong together
        {"theta": np.degrees(SLOW)},  # a few degrees to and fro: nobody can tell
    ],
)
def test_angles_that_may_be_radians_are_taken_as_such(tmp_path, columns):
    assert len(table_with(tmp_path, columns)) == len(T)


def test_numbers_near_the_largest_do_no_harm(tmp_path):
    big = np.array([-1e308, 1.7e308, -1.7e308])
    table = read_table(write(tmp_path, csv(t=0.1 * np.arange(3.0), theta=big, beta=big * 0, gamma=big * 0)))
    assert list(table["theta"]) == list(big)
    with pytest.raises(TableError, match="steps of inf"):
        read_table(write(tmp_path, csv(t=np.sort(big), theta=big, beta=big * 0, gamma=big * 0)))


def test_files_that_are_none_or_too_large(tmp_path, monkeypatch):
    with pytest.raises(TableError, match="no such file"):
        read_table(tmp_path / "none.csv")
    with pytest.raises(TableError, match="got a folder, expected a run log"):
        read_table(tmp_path)
    monkeypatch.setattr(module, "LIMIT_BYTES", 50)
    with pytest.raises(TableError, match=r"table.csv: got 0 MiB, expected at most 0; split it"):
        read_table(write(tmp_path, GOOD))


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


def test_a_mistake_in_a_run_log_names_the_row(tmp_path):
    path = tmp_path / "log.mcap"
    with RunLogWriter(path, {"rig": "test"}) as log:
        for k in range(5):
            tilt = float("nan") if k == 3 else 0.01
            log.sample(Observation(k / 30, 0.1, 0.0, tilt, 0.02), Command(0.03, 0.04), segment=0)
    with pytest.raises(TableError, match=r"log.mcap:4: beta: got no value, expected a finite number"):
        read_table(path)


def test_a_run_log_with_another_ending_is_read_as_one(tmp_path):
    path = tmp_path / "log.mcap"
    with RunLogWriter(path, {"rig": "test"}) as log:
        for k in range(5):
            log.sample(Observation(k / 30, 0.1, 0.0, 0.01, 0.02), Command(0.03, 0.04), segment=0)
    assert len(read_table(path.rename(tmp_path / "log.csv"))) == 5


def test_joined_tables_keep_their_segments_apart(tmp_path):
    one = read_table(write(tmp_path, GOOD))
    both = join([one, one])
    assert list(both.segment) == [0, 0, 0, 1, 1, 1]
    assert len(both) == 6


def test_stretches_end_at_segments_and_gaps():
    t = np.round(np.concatenate([np.arange(10), np.arange(12, 20), np.arange(5)]) / 30.0, 3)
    table = Table({"t": t, "segment": np.repeat([0.0, 4.0], [18, 5])})
    assert stretches(table) == [slice(0, 10), slice(10, 18), slice(18, 23)]
    assert table.dt == pytest.approx(1 / 30, rel=2e-3)  # the median of the rounded times is 1 % off
    assert stretches(Table({"t": np.zeros(0)})) == []


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
