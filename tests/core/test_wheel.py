"""A wheel built from the tree works from any directory: maps, behaviours, rigs and models travel in it."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

pytestmark = pytest.mark.slow

ROOT = Path(__file__).resolve().parents[2]


def carry_compiled(site: Path) -> None:
    """Beside the modules of the wheel what was compiled of the very same ones here, which else takes minutes again.

    Numba takes it for a file of the same size and time."""
    for copy in site.rglob("*.py"):
        source = ROOT / copy.relative_to(site)
        if not source.is_file() or source.read_bytes() != copy.read_bytes():
            continue
        times = source.stat()
        os.utime(copy, ns=(times.st_atime_ns, times.st_mtime_ns))
        for compiled in (source.parent / "__pycache__").glob(f"{source.stem}.*.nb[ci]"):
            target = copy.parent / "__pycache__" / compiled.name
            target.parent.mkdir(exist_ok=True)
            shutil.copy2(compiled, target)


def test_wheel_holds_everything_and_runs_elsewhere(tmp_path):
    subprocess.run(
        [sys.executable, "-m", "build", "--wheel", "--no-isolation", "--outdir", str(tmp_path), str(ROOT)],
        check=True, capture_output=True, cwd=tmp_path,
    )  # fmt: skip
    (wheel,) = tmp_path.glob("*.whl")
    site = tmp_path / "site"
    with zipfile.ZipFile(wheel) as archive:
        names = set(archive.namelist())
        archive.extractall(site)
    for name in (
        "_share/maps/cme.yaml",
        "_share/behaviors/navigate.xml",
        "rigs/toy.yaml",
        "rigs/hardware.yaml",
        "learning/packaged/toy/model.yaml",
        "apps/cli/newrig/rig.py.jinja",
        "apps/cli/newrig/pyproject.toml.jinja",
    ):
        assert f"mazeplan/{name}" in names
    carry_compiled(site)
    script = (
        "import mazeplan, sys; assert mazeplan.__file__.startswith(sys.argv[1]), mazeplan.__file__\n"
        "assert mazeplan.navigate('ring4', 'ring5', rig='toy', seed=1).success"
    )
    env = {**os.environ, "PYTHONPATH": str(site)}
    done = subprocess.run(
        [sys.executable, "-c", script, str(site)], cwd=tmp_path, env=env, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
