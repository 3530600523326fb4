"""Ends a run whose leaves are still running, because it was stopped from outside or its time is over.

First the whole tree is halted. Then the plate goes level, while leaves that were running wind down: each leaf with a
`wind_down` gets as many ticks as it asks for, at most its `wind_down_ticks`. In tick k of n the command is at most as
large as the last one, and at most (1 - k/n) of the tilt at the beginning. A run takes no further tick if none of its
running leaves has a `wind_down`, or if its tree has ended by itself.
"""

from __future__ import annotations

import math

from mazeplan.btree.leaf import Leaf
from mazeplan.btree.status import RUNNING
from mazeplan.btree.tree import BehaviorTree
from mazeplan.control.tilt import Plate
from mazeplan.core.records import LEVEL, Command


class WindDown:
    """Halts a tree and winds its leaves down. While it is `going`, call `tick` once a tick, then send the command that
    `towards_level` returns.

    sent: the last command of the tree"""

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
        """Call `wind_down` of each leaf that still asks for a tick."""
        for leaf in list(self._left):
            self._left[leaf] -= 1
            if leaf.checked(leaf.blamed(leaf.wind_down), "wind_down") is not RUNNING or self._left[leaf] == 0:
                del self._left[leaf]

    def towards_level(self, wanted: Command | None) -> Command:
        """The command to send if the leaves want the command `wanted` (None: no leaf commands)."""
        self._ticks += 1
        tilt = 0.0 if wanted is None else math.hypot(wanted.u_beta, wanted.u_gamma)
        if wanted is None or not 0.0 < tilt < math.inf:
            self._most = 0.0
            return LEVEL
        most = min(self._most, self._began * (1.0 - self._ticks / self._whole))
        share = min(1.0, most / tilt)
        self._most = min(most, tilt)
        return self._plate.clip(share * wanted.u_beta, share * wanted.u_gamma)
