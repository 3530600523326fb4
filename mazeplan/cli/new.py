"""`new rig`: a folder to begin a rig of one's own in."""

from __future__ import annotations

import importlib.util
import keyword
import re
from pathlib import Path
from typing import Annotated

import typer

from mazeplan.cli.arguments import check_folder
from mazeplan.cli.output import say
from mazeplan.errors import InputError

app = typer.Typer(help="Templates: a rig of your own.", no_args_is_help=True)

LONGEST = 40  # letters of a name
TEMPLATES = Path(__file__).resolve().parent / "newrig"
FILES = {  # template: where it goes, {} being the name
    "rig.py.jinja": "{}.py",
    "rig.yaml.jinja": "{}.yaml",
    "test_rig.py.jinja": "tests/test_{}.py",
    "pyproject.toml.jinja": "pyproject.toml",
    "README.md.jinja": "README.md",
}


@app.command("rig")
def rig(
    name: Annotated[str, typer.Argument(help="Name of rig and module: letters, digits and _.")],
    output: Annotated[Path | None, typer.Option("-o", "--output", help="Folder; default: NAME here.")] = None,
) -> None:
    """Write a folder with a rig that works at once, on a simulated table: class, YAML file, test, package.

    Nothing is written over."""
    folder = output or Path(name)
    _check_name(name)
    check_folder("-o" if output else "NAME", folder)
    targets = {template: folder / target.format(name) for template, target in FILES.items()}
    for target in targets.values():
        if target.exists() or target.is_symlink():
            raise InputError(f"{target} is there already, and nothing is written over; expected another NAME or -o")
    _check_module(name)
    for template, target in targets.items():
        try:
            target.parent.mkdir(parents=True, exist_ok=True)
            with target.open("x", encoding="utf-8") as stream:
                stream.write(filled(template, name))
        except OSError as problem:
            raise InputError(f"cannot be written: {problem.strerror}", file=target) from None
    say(f"wrote {', '.join(map(str, targets.values()))}")
    if importlib.util.find_spec("pytest") is None:
        say("its test needs pytest: pip install pytest")
    print(f"cd {folder} && python -m pytest && mazeplan navigate --rig {name}.yaml")


def filled(template: str, name: str) -> str:
    """The text of a template for a rig of that name."""
    from jinja2 import Environment, FileSystemLoader, StrictUndefined

    place = Environment(  # plain text: nothing is to be escaped
        loader=FileSystemLoader(TEMPLATES), undefined=StrictUndefined, keep_trailing_newline=True, autoescape=False
    )
    words = name.split("_")
    title = " ".join(words).capitalize()
    cls = "".join(word[:1].upper() + word[1:] for word in words)
    cls += "" if cls.endswith("Rig") else "Rig"  # so that it is no other name of the module
    return place.get_template(template).render(name=name, cls=cls, title=title, package=name.replace("_", "-"))


def _check_name(name: str) -> None:
    """Raises InputError for what could be no module, package and rig."""
    from mazeplan.rigs.registry import rig_names

    plain = re.fullmatch(r"[A-Za-z](?:_?[A-Za-z0-9])*", name) is not None and len(name) <= LONGEST
    if not plain or keyword.iskeyword(name):
        expected = f"a Python identifier such as my_table: letters, digits, single _, at most {LONGEST}"
        raise InputError(f"NAME: got {name!r}, expected {expected}")
    if name == "tests":
        raise InputError(f"NAME: got {name!r}, which is the folder of its tests; expected another")
    if name in rig_names():
        raise InputError(f"NAME: got {name!r}, which is a packaged rig; expected another")


def _check_module(name: str) -> None:
    """Raises InputError where another module has the name, which Python might import in the place of this one."""
    try:
        found = importlib.util.find_spec(name)
    except (ImportError, ValueError):
        found = None
    if found is not None and found.origin is not None:  # a folder without code is none
        raise InputError(f"NAME: got {name!r}, which is a module of {found.origin}; expected another")
