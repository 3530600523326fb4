"""What is left to do when a run ends around a leaf that is running: it was stopped from outside, or its time is over.

The tree is halted first, as a whole. Leaves that were running and have a `wind_down` of their own then get one tick
after another, each as many as it asks for, `wind_down_ticks` at most, while the plate goes level: in tick k of n the
command is cut to the size of the last one, and to (1 - k/n) of the tilt with which it began. Leaves without one, and
runs whose tree came to its end by itself, take no further tick.
"""

from __future__ import annotations

import math

from mazeplan.behavior.leaf import Leaf
from mazeplan.behavior.status import RUNNING
from mazeplan.behavior.tree import BehaviorTree
from mazeplan.control.tilt import Plate
from mazeplan.core.records import LEVEL, Command


class WindDown:
    """Halts a tree; then, while it is `going`, `tick` is to be called once a tick, and its command sent.

    sent: the last command of the tree."""

    def __init__(self, tree: BehaviorTree, sent: Command, plate: Plate) -> None:
        asking = [
            node
            for node in tree.nodes()
            if isinstance(node, Leaf) and node.status is RUNNING and type(node).wind_down is not Leaf.wind_down
        ]
        tree.halt()
        self._left = {leaf: leaf.wind_down_ticks for leaf in asking}
        self._began = self._most = math.hypot(sent.u_beta, sent.u_gamma)
        self._plate, self._ticks, self._whole = plate, 0, max(self._left.values(), default=0)

    @property
    def going(self) -> bool:
        """Whether a leaf asks for another tick."""
        return bool(self._left)

    def tick(self) -> None:
        """Let each leaf that still asks do what it has to do."""
        for leaf in list(self._left):
            self._left[leaf] -= 1
            if leaf.checked(leaf.blamed(leaf.wind_down), "wind_down") is not RUNNING or self._left[leaf] == 0:
                del self._left[leaf]

    def towards_level(self, wanted: Command | None) -> Command:
        """The command that goes out where the leaves want this one (None: none of them commands)."""
        self._ticks += 1
        tilt = 0.0 if wanted is None else math.hypot(wanted.u_beta, wanted.u_gamma)
        if wanted is None or not 0.0 < tilt < math.inf:
            self._most = 0.0
            return LEVEL
        most = min(self._most, self._began * (1.0 - self._ticks / self._whole))
        share = min(1.0, most / tilt)
        self._most = min(most, tilt)
        return self._plate.clip(share * wanted.u_beta, share * wanted.u_gamma)
