"""Without a package that it needs, each part says in one line which."""

import importlib.util
import runpy
import subprocess
import sys
from pathlib import Path

import pytest
from commands import call

from mazeplan.core.resources import to_install

SCRIPT = Path(__file__).resolve().parents[2] / "examples" / "sac.py"


def without(monkeypatch, package):
    """As if it were not installed, and nothing of it or of the environment loaded yet."""
    for name in [n for n in sys.modules if n.partition(".")[0] == package or n.startswith("mazeplan.apps.environment")]:
        above, _, last = name.rpartition(".")
        if hasattr(
            sys.modules.get(above), last
        ):  # importing it anew sets this attribute, which no one else would reset
            monkeypatch.setattr(sys.modules[above], last, sys.modules[name])
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, package, None)


def test_the_example_names_what_it_learns_with(monkeypatch):
    without(monkeypatch, "stable_baselines3")
    with pytest.raises(SystemExit) as ended:
        runpy.run_path(str(SCRIPT), run_name="__main__")
    how = "pip install stable-baselines3, and mazeplan with its extra gym"
    assert ended.value.code == f"examples/sac.py needs stable_baselines3: {how}"


def test_the_example_refuses_in_one_line():
    if importlib.util.find_spec("stable_baselines3") is None:
        pytest.skip("stable-baselines3 is not installed")
    for words, said in (
        (["--from", "9"], "examples/sac.py: start_ring: got '9'"), (["--steps", "-5"], "expected a number above 0"),
    ):  # fmt: skip
        done = subprocess.run([sys.executable, str(SCRIPT), *words], capture_output=True, text=True, check=False)
        assert done.returncode != 0
        assert said in done.stderr
        assert "Traceback" not in done.stderr


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
