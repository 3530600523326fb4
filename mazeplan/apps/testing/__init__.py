"""A kit to test trees and leaves; docs/testing-trees.md has examples.

    run_tree, tick_tree       run a tree on a rig with mishaps, or without a rig; both return a Record
    script                    what a leaf does in place of its work: "RUNNING x3 then SUCCESS"
    scripted_rig              a rig with a script of mishaps, from a few lines of YAML
    Record                    what happened, and claims about it: reaches, never, within, visits, ends_with, halts
    BallBehaviour             where a ball is over time, made of Roll, Rest, Pass and Jump; PlayedRig plays it
    LightRig                  a fast rig; a run takes some 50 ms
    ball_behaviours           a hypothesis strategy, of the extra `testing`

No module of the product imports the kit. The kit needs no test framework.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from mazeplan.apps.testing.balls import BallBehaviour, Jump, Pass, PlayedRig, Rest, Roll
    from mazeplan.apps.testing.leafscript import Player, Script, script
    from mazeplan.apps.testing.lightrig import LightRig
    from mazeplan.apps.testing.record import Record
    from mazeplan.apps.testing.scriptedrig import ScriptedRig
    from mazeplan.apps.testing.strategies import ball_behaviours
    from mazeplan.apps.testing.trees import run_tree, scripted_rig, tick_tree

_HOMES = {
    "BallBehaviour": "balls", "Jump": "balls", "Pass": "balls", "PlayedRig": "balls", "Rest": "balls", "Roll": "balls",
    "LightRig": "lightrig", "Record": "record", "Player": "leafscript", "Script": "leafscript",
    "script": "leafscript", "ScriptedRig": "scriptedrig", "ball_behaviours": "strategies",
    "run_tree": "trees", "scripted_rig": "trees", "tick_tree": "trees",
}  # fmt: skip

__all__ = [
    "BallBehaviour", "Jump", "LightRig", "Pass", "PlayedRig", "Player", "Record", "Rest", "Roll", "Script",
    "ScriptedRig", "ball_behaviours", "run_tree", "script", "scripted_rig", "tick_tree",
]  # fmt: skip


def __getattr__(name: str) -> Any:
    if name in _HOMES:
        value = getattr(import_module(f"mazeplan.apps.testing.{_HOMES[name]}"), name)
        globals()[name] = value
        return value
    raise AttributeError(f"module 'mazeplan.apps.testing' has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted(__all__)
