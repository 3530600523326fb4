"""`new rig`: a template for your own rig; `new map`, `new tree`: a copy of a packaged map or tree to change."""

from __future__ import annotations

import importlib.util
import keyword
import re
from pathlib import Path
from typing import Annotated

import typer

from mazeplan.apps.cli import options as opt
from mazeplan.apps.cli.output import say
from mazeplan.core import resources
from mazeplan.core.errors import InputError, one_of
from mazeplan.core.whole_file import write_text

app = typer.Typer(help="Write templates.", no_args_is_help=True)

TEMPLATES = Path(__file__).resolve().parent / "newrig"
FILES = {  # template: file; {} stands for the name
    "rig.py.jinja": "{}.py",
    "rig.yaml.jinja": "{}.yaml",
    "test_rig.py.jinja": "tests/test_{}.py",
    "pyproject.toml.jinja": "pyproject.toml",
    "README.md.jinja": "README.md",
}

Name = Annotated[str, typer.Argument(metavar="NAME", help="Name of the rig and its module: letters, digits and _.")]
NewFolder = Annotated[Path | None, opt.output_folder("Folder to write. Default: ./NAME.")]
MapFile = Annotated[Path, opt.output_file("File to write.", *opt.YAML)]
MapName = Annotated[str, typer.Argument(metavar="MAP", help="Packaged map.")]
TreeFile = Annotated[Path, opt.output_file("File to write.", opt.TREE)]
TreeName = Annotated[str, typer.Argument(metavar="TREE", help="Packaged behaviour tree.")]


@app.command("map")
def copy_map(output: MapFile, name: MapName = "cme", force: opt.Force = False) -> None:
    """Write a copy of a packaged map for you to change."""
    _copy("maps", name, output)


@app.command("tree")
def copy_tree(output: TreeFile, name: TreeName = "navigate", force: opt.Force = False) -> None:
    """Write a copy of a packaged behaviour tree for you to change."""
    _copy("behaviors", name, output)


def _copy(kind: str, name: str, file: Path) -> None:
    """Copy a packaged file. Raises InputError."""
    packaged = {path.stem: path for path in resources.share(kind).iterdir()}
    if name not in packaged:
        raise InputError(f"NAME: got {name!r}, expected {one_of(sorted(packaged), name)}")
    write_text(file, packaged[name].read_text(encoding="utf-8"))
    say(f"wrote {file}")


@app.command("rig")
def rig(name: Name, output: NewFolder = None, force: opt.Force = False) -> None:
    """Write a folder with a working rig on a simulated table: class, YAML file, test, package."""
    folder = output or Path(name)
    _check_name(name)
    if output is None:
        opt.check_new("NAME", folder, force)
    targets = {template: folder / target.format(name) for template, target in FILES.items()}
    for template, target in targets.items():
        write_text(target, filled(template, name))
    say(f"wrote {', '.join(map(str, targets.values()))}")
    print(f"cd {folder} && python -m pytest && mazeplan navigate --rig {name}.yaml")


def filled(template: str, name: str) -> str:
    """The text of a template, filled in for a rig of this name."""
    words = name.split("_")
    title = " ".join(words).capitalize()
    cls = "".join(word[:1].upper() + word[1:] for word in words)
    cls += "" if cls.endswith("Rig") else "Rig"  # differs from every other name in the module
    return resources.template(TEMPLATES / template).render(
        name=name, cls=cls, title=title, package=name.replace("_", "-")
    )


def _check_name(name: str) -> None:
    """Raises InputError for a name that cannot name a module, or that a module or a rig has."""
    from mazeplan.rigs.registry import rig_names

    if not re.fullmatch(r"[A-Za-z][A-Za-z0-9_]{0,39}", name) or keyword.iskeyword(name):
        raise InputError(f"NAME: got {name!r}, expected a Python identifier such as my_table")
    found = importlib.util.find_spec(name)  # Python might import the other module
    if name in rig_names() or name == "tests" or (found is not None and found.origin is not None):
        raise InputError(f"NAME: got {name!r}, which is taken; expected another")
