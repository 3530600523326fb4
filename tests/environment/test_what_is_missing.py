"""Without a package that it needs, each part says in one line which."""

import importlib.util
import runpy
import subprocess
import sys
from pathlib import Path

import pytest

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
