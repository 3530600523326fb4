"""A behaviour tree as rows, one for each node, and as text. If a SubTree occurs again, its row is folded."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from typing import Any

from mazeplan.btree.decorators import SubTree
from mazeplan.btree.node import TreeNode
from mazeplan.btree.ports import Key, shown
from mazeplan.btree.tree import BehaviorTree, parts_of

SYMBOLS = {
    "Sequence": "→", "SequenceWithMemory": "→*", "ReactiveSequence": "→ᴿ", "Fallback": "?", "ReactiveFallback": "?ᴿ",
    "Parallel": "⇉", "Repeat": "↻", "RetryUntilSuccessful": "↺", "Inverter": "¬",
}  # fmt: skip
FOLDED = "(as above)"


@dataclass(frozen=True)
class Row:
    """A node of a tree.

    number: of the node, parents before children
    depth: 0 for the root
    parent: row of its parent; None: the root
    folded: whether its children are left out, because the same tree is shown above
    """

    node: TreeNode
    number: int
    depth: int
    parent: int | None
    folded: bool = False

    @property
    def title(self) -> str:
        """Kind of node, with a symbol."""
        kind = type(self.node).__name__
        return f"{SYMBOLS.get(kind, '')} {kind}".strip()

    @property
    def name(self) -> str:
        """The name of the node, if it is not that of its kind; else empty."""
        return "" if self.node.name == type(self.node).__name__ else self.node.name

    @property
    def attributes(self) -> str:
        """Ports and conditions as text, as in the file."""
        ports = [f"{name}={_written(value)}" for name, value in self.node.values.items()]
        given = {} if self.node.conditions is None else self.node.conditions.given
        return " ".join(ports + [f'{name}="{_written(e.text)}"' for name, e in given.items()])


def rows_of(tree: BehaviorTree, whole: bool = False, needed: Collection[int] = ()) -> list[Row]:
    """The rows of a tree.

    whole: whether nothing is folded
    needed: numbers of nodes that must have a row
    """
    numbers = {id(node): i for i, node in enumerate(tree.nodes())}
    rows, drawn = list[Row](), set[str]()

    def add(node: TreeNode, depth: int, parent: int | None) -> None:
        number, again = numbers[id(node)], False
        if isinstance(node, SubTree):
            again = _tree_of(node) in drawn and not whole
            drawn.add(_tree_of(node))
            again = again and not any(number < n < number + _size(node) for n in needed)
        here = len(rows)
        rows.append(Row(node, number, depth, parent, again))
        for child in () if again else parts_of(node):
            add(child, depth + 1, here)

    add(tree.root, 0, None)
    return rows


def _tree_of(node: SubTree) -> str:
    """ID of the tree in a SubTree."""
    return str(node.values.get("ID", node.name))


def _size(node: TreeNode) -> int:
    """Number of nodes from this one down."""
    return 1 + sum(_size(child) for child in parts_of(node))


def _written(value: Any) -> str:
    """A port's value as in a file; shortened or escaped if it is long or not printable."""
    if isinstance(value, Key):
        return str(value)
    text = ";".join(map(str, value)) if isinstance(value, list) else str(value)
    return text if text.isprintable() and len(text) <= 60 else shown(text)


def tree_text(tree: BehaviorTree, whole: bool = False) -> str:
    """The tree as text, one line for each node, with its ports."""
    rows = rows_of(tree, whole)
    last = {row.parent: i for i, row in enumerate(rows)}  # row of the last child of each parent
    lines, below = list[str](), list[str]()
    for i, row in enumerate(rows):
        lead = "" if row.parent is None else below[row.parent]
        final = row.parent is None or last[row.parent] == i
        branch = "" if row.parent is None else "└── " if final else "├── "
        below.append(lead + ("" if row.parent is None else "    " if final else "│   "))
        words = (lead + branch + row.title, f"'{row.name}'" if row.name else "", row.attributes, FOLDED * row.folded)
        lines.append(" ".join(filter(None, words)))
    return "\n".join(lines)
