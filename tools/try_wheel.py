"""Installs the wheel into an empty environment, and runs the commands of README there, outside of the clone.

Usage: python tools/try_wheel.py [--python PYTHON] [--wheel FILE] [--json FILE]

It needs `build` and about one gigabyte in the temporary folder, takes about five minutes, and ends with status 1 if a
command fails. Commands that README marks as not run (make) are left out. Each packaged map, tree, rig and model is
loaded, too.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
sys.path.append(str(ROOT / "tests"))

import pages  # noqa: E402  # pyright: ignore[reportMissingImports]  # of the tests: what README shows

LIMIT_S = 600.0  # for one command; the first one compiles
SHOWN = 400  # characters of what a failed command said
PACKAGED = """\
import sys
import mazeplan
from mazeplan.behavior.trees import read_tree, tree_names
from mazeplan.learning.modelfile import load_model, model_names
from mazeplan.maze.mapfile import load_map, packaged_maps
from mazeplan.rigs.registry import rig_file, rig_names
from mazeplan.rigs.files import read_rig_file
from mazeplan.run.settings import load_settings
assert mazeplan.__file__.startswith(sys.prefix), mazeplan.__file__
for names, read in ((packaged_maps(), load_map), (tree_names(), read_tree), (model_names(), load_model),
                    (rig_names(), lambda name: read_rig_file(rig_file(name)))):
    assert len(names) > 1, names
    for name in names:
        read(name)
load_settings()
"""


@dataclass(frozen=True)
class Tried:
    """A command, its exit status, and what it said on stderr."""

    command: str
    status: int
    said: str = ""

    @property
    def good(self) -> bool:
        """Whether it did its work."""
        return self.status == 0 and "Traceback" not in self.said


def run(words: Sequence[str], folder: Path, programs: Path | None = None) -> subprocess.CompletedProcess[str]:
    """A command without the clone on its path; programs: folder that comes first."""
    env = {key: value for key, value in os.environ.items() if not key.startswith("PYTHON")}
    env["PATH"] = os.pathsep.join([*([] if programs is None else [str(programs)]), env.get("PATH", "")])
    try:
        return subprocess.run(words, cwd=folder, env=env, capture_output=True, text=True, check=False, timeout=LIMIT_S)
    except FileNotFoundError as problem:
        return subprocess.CompletedProcess(list(words), 127, "", str(problem))


def built(folder: Path) -> Path:
    """The wheel of this clone."""
    command = [sys.executable, "-m", "build", "--wheel", "--no-isolation", "--outdir", str(folder), str(ROOT)]
    done = run(command, folder)
    if done.returncode:
        raise SystemExit(f"the wheel cannot be built: {done.stderr.strip() or done.stdout.strip()}")
    return next(folder.glob("*.whl"))


def environment(python: str, wheel: Path, folder: Path) -> Path:
    """A new environment with the wheel in it; the folder of its programs."""
    programs = folder / "venv" / "bin"
    pip = [str(programs / "python"), "-m", "pip", "--disable-pip-version-check", "install", "--quiet"]
    install = [*pip, "-c", str(ROOT / "constraints.txt"), str(wheel)]
    for words in ([python, "-m", "venv", str(folder / "venv")], install):
        done = run(words, folder)
        if done.returncode:
            raise SystemExit(f"{' '.join(words)}: exit status {done.returncode}\n{done.stderr}")
    return programs


def shown(page: str = "README.md") -> Iterator[tuple[str, list[str]]]:
    """(command, words) of all that a page shows: commands, and programs in Python."""
    for block in pages.blocks(page):
        if "not run" in block.marks:
            continue
        if block.kind == "console":
            yield from ((command, block.tried(command)) for command in block.commands)
        elif block.kind == "python" and block.file is None:
            yield f"Python of line {block.line}", ["python", "-c", block.text]


def try_commands(commands: Iterable[tuple[str, list[str]]], desk: Path, programs: Path) -> list[Tried]:
    """Run the commands of README one after the other in an empty folder."""
    (desk / "runs").mkdir(parents=True)
    for block in pages.blocks("README.md"):
        if block.file is not None:
            (desk / block.file).write_text(block.text, encoding="utf-8")
    tried = []
    for command, words in commands:
        done = run(words, desk, programs)
        tried.append(Tried(command, done.returncode, done.stderr))
        print(f"{'ok  ' if tried[-1].good else 'FAIL'} {command}", file=sys.stderr, flush=True)
    return tried


def try_wheel(python: str, wheel: Path | None = None) -> dict[str, object]:
    """Build, install and try; what was found, as a document."""
    with tempfile.TemporaryDirectory(prefix="wheel-") as place:
        folder = Path(place)
        wheel = built(folder) if wheel is None else wheel
        programs = environment(python, wheel, folder)
        version = run([str(programs / "python"), "-c", "import platform; print(platform.python_version())"], folder)
        packaged = ("all packaged maps, trees, rigs and models", ["python", "-c", PACKAGED])
        tried = try_commands([packaged, *shown()], folder / "desk", programs)
        return {
            "wheel": wheel.name,
            "megabytes": round(wheel.stat().st_size / 1e6, 2),
            "python": version.stdout.strip(),
            "commands": len(tried),
            "good": sum(one.good for one in tried),
            "failed": [{"command": one.command, "status": one.status, "said": one.said[-SHOWN:]}
                       for one in tried if not one.good],
        }  # fmt: skip


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--python", default=sys.executable, help="Python of the new environment")
    parser.add_argument("--wheel", type=Path, help="a wheel; without it, the one of this clone is built")
    parser.add_argument("--json", type=Path, help="file for what was found")
    options = parser.parse_args()
    found = try_wheel(options.python, options.wheel and options.wheel.resolve())
    text = json.dumps(found, indent=1)
    if options.json:
        options.json.write_text(text + "\n")
    print(text)
    sys.exit(0 if found["good"] == found["commands"] else 1)


if __name__ == "__main__":
    main()
