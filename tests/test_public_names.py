"""What users rely on: commands and options, names of files, effects, leaves and settings. None may get lost.

`public_names.txt` lists them, one a line. A new name is added by running this file as a script; a name that shall go
stays as an alias with a warning first.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import yaml
from typer.main import get_command

from mazeplan.apps.cli.app import app
from mazeplan.behavior.registry import REGISTRY
from mazeplan.core import resources
from mazeplan.maze.mapfile import packaged_maps
from mazeplan.physics.registry import PACKAGED
from mazeplan.rigs.registry import rig_names
from mazeplan.run.settings import PACKAGED as SETTINGS

LIST = Path(__file__).parent / "public_names.txt"


def options(command, path: str) -> Iterator[str]:
    """Each command with each of its parameters, as a user writes them."""
    yield f"command {path}".rstrip()
    for parameter in command.params:
        for name in (*parameter.opts, *parameter.secondary_opts):
            yield f"option {path} {name}"
    for name, inner in getattr(command, "commands", {}).items():
        yield from options(inner, f"{path} {name}".strip())


def keys(tree: object, path: str) -> Iterator[str]:
    """Each key of a nested mapping."""
    if isinstance(tree, dict):
        for name, inner in tree.items():
            yield f"setting {path}{name}"
            yield from keys(inner, f"{path}{name}.")


def public_names() -> list[str]:
    """All of them, sorted."""
    found = set(options(get_command(app), ""))
    found |= set(keys(yaml.safe_load(SETTINGS.read_text(encoding="utf-8")), ""))
    found |= {f"map {name}" for name in packaged_maps()} | {f"rig {name}" for name in rig_names()}
    found |= {f"tree {path.stem}" for path in resources.share("behaviors").glob("*.xml")}
    found |= {f"leaf {name}" for name in REGISTRY}
    found |= {f"leaf {name} {port}" for name, leaf in REGISTRY.items() for port in leaf.ports}
    found |= {f"effect {name}" for name in PACKAGED}
    found |= {f"effect {name} {p}" for name, effect in PACKAGED.items() for p in effect.parameters}
    return sorted(found)


def test_no_public_name_is_lost():
    listed = LIST.read_text(encoding="utf-8").splitlines()
    assert len(listed) > 500
    lost = sorted(set(listed) - set(public_names()))
    assert not lost


if __name__ == "__main__":
    LIST.write_text("\n".join(public_names()) + "\n", encoding="utf-8")
