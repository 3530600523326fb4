"""Where packaged files (maps, behaviours, rigs, models) are, in a checkout and in an installed wheel alike.

In a checkout maps/ and behaviors/ stand beside the package; a wheel carries them as mazeplan/_share/.
"""

from __future__ import annotations

import os
import warnings
from collections.abc import Collection
from pathlib import Path
from typing import Any

from mazeplan.core.errors import ShortWarning

PACKAGE = Path(__file__).resolve().parents[1]
CHECKOUT = PACKAGE.parent / "pyproject.toml"  # there in a clone, not where a wheel was installed


def to_install(extra: str) -> str:
    """The command that installs what an extra needs."""
    if CHECKOUT.is_file():
        return f"pip install -c constraints.txt -e '.[{extra}]' in {CHECKOUT.parent}"
    return f"pip install --upgrade 'mazeplan[{extra}]'"


def share(kind: str) -> Path:
    """Folder of the packaged files of one kind: `maps` or `behaviors`."""
    installed = PACKAGE / "_share" / kind
    return installed if installed.is_dir() else PACKAGE.parent / kind


def template(file: Path, **known: Any) -> Any:
    """A template (Jinja2). It escapes values in HTML, and refuses unknown names. known: names that it may use"""
    from jinja2 import Environment, FileSystemLoader, StrictUndefined

    room = Environment(
        loader=FileSystemLoader(file.parent), autoescape=file.suffix == ".html", undefined=StrictUndefined,
        trim_blocks=True, lstrip_blocks=True, keep_trailing_newline=True,
    )  # fmt: skip
    return room.get_template(file.name, globals=known)


def is_packaged(source: str | Path, names: Collection[str]) -> bool:
    """Whether `source`, given by a user, means one of these packaged names.

    A bare name means the packaged thing, whatever the current folder holds under that name; `./toy` means the folder. A
    Path that exists means that file or folder. Warns (ShortWarning) if a bare name fits both."""
    if str(source) not in names:
        return False
    there = os.path.exists(source)
    if there and not isinstance(source, Path):
        warning = f"{source!r} means the packaged one; what has this name in the current folder is ./{source}"
        warnings.warn(warning, ShortWarning, stacklevel=3)
    return not there or not isinstance(source, Path)


def find(kind: str, name: str | Path, suffix: str) -> Path:
    """Path for what a user gave: the name of a packaged file (`is_packaged`), or a file.

    A path that does not exist is returned as given, so that the reader can name it in its error."""
    packaged = {path.stem: path for path in share(kind).glob(f"*{suffix}")}
    return packaged[str(name)] if is_packaged(name, packaged) else Path(name)
