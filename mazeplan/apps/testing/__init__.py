"""A kit to test trees and leaves; docs/testing-trees.md has examples.

    run_tree, tick_tree       run a tree on a rig with mishaps, or without a rig; both return a Record
    script                    what a leaf does in place of its work: "RUNNING x3 then SUCCESS"
    Record                    what happened, and claims about it: reaches, never, within, visits, ends_with, halts
    LightRig                  a fast rig, on which a function makes things go wrong; a run takes some 50 ms

No module of the product imports the kit. The kit needs no test framework.
"""

from mazeplan.apps.testing.lightrig import LightRig
from mazeplan.apps.testing.record import Record
from mazeplan.apps.testing.trees import run_tree, tick_tree
from mazeplan.apps.testing.watch import Player, Script, script

__all__ = ["LightRig", "Player", "Record", "Script", "run_tree", "script", "tick_tree"]
