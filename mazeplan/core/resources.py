"""Where packaged files (maps, behaviours, rigs, models) are, in a checkout and in an installed wheel alike.

In a checkout maps/ and behaviors/ stand beside the package; a wheel carries them as mazeplan/_share/.
"""

from __future__ import annotations

from pathlib import Path

PACKAGE = Path(__file__).resolve().parents[1]
CHECKOUT = PACKAGE.parent / "pyproject.toml"  # there in a clone, not where a wheel was installed


def to_install(extra: str = "") -> str:
    """The command that installs what an extra needs; without one, what the program itself does."""
    name = f"[{extra}]" if extra else ""
    if CHECKOUT.is_file():
        return f"pip install -c constraints.txt -e '.{name}' in {CHECKOUT.parent}"
    return f"pip install --upgrade 'mazeplan{name}'"


def share(kind: str) -> Path:
    """Folder of the packaged files of one kind: `maps` or `behaviors`."""
    installed = PACKAGE / "_share" / kind
    return installed if installed.is_dir() else PACKAGE.parent / kind


def find(kind: str, name: str, suffix: str) -> Path:
    """Path for what a user gave: an existing file, or the name of a packaged one.

    A path that does not exist is returned as given, so that the reader can name it in its error.
    """
    given = Path(name)
    if given.suffix or given.exists():
        return given
    packaged = share(kind) / f"{name}{suffix}"
    return packaged if packaged.exists() else given
