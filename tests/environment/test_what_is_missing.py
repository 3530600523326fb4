"""Without a package that it needs, each part says in one line which."""

import runpy
import sys
from pathlib import Path

import pytest
from commands import call

from mazeplan.resources import to_install

SCRIPT = Path(__file__).resolve().parents[2] / "examples" / "sac.py"


def without(monkeypatch, package):
    """As if it were not installed, and nothing of it or of the environment loaded yet."""
    for name in [n for n in sys.modules if n.partition(".")[0] == package or n.startswith("mazeplan.environment")]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, package, None)


def test_the_example_names_what_it_learns_with(monkeypatch):
    without(monkeypatch, "stable_baselines3")
    with pytest.raises(SystemExit) as ended:
        runpy.run_path(str(SCRIPT), run_name="__main__")
    how = "pip install stable-baselines3, and mazeplan with its extra gym"
    assert ended.value.code == f"examples/sac.py needs stable_baselines3: {how}"


@pytest.mark.parametrize(
    ("package", "words"),
    [
        ("gymnasium", "mazeplan: the environment needs Gymnasium: " + to_install("gym") + "\n"),
        ("pyarrow", "mazeplan: Parquet files need pyarrow: " + to_install("gym") + "\n"),
    ],
)
def test_record_names_what_it_needs(monkeypatch, capsys, tmp_path, package, words):
    without(monkeypatch, package)
    code, out, err = call(monkeypatch, capsys, "record", "--episodes", 1, "-o", tmp_path / "a.parquet")
    assert (code, out, err) == (2, "", words)


def test_minari_is_named_too(monkeypatch, capsys):
    without(monkeypatch, "minari")
    code, _, err = call(monkeypatch, capsys, "record", "--episodes", 1, "--minari", "maze/a-v0")
    assert (code, err) == (
        2, "mazeplan: --minari needs Minari: pip install 'minari[arrow]'; or -o FILE.parquet\n"
    )  # fmt: skip
