"""A behaviour tree as text, one line for each node. If a SubTree occurs again, its line is folded."""

from __future__ import annotations

from typing import Any

from mazeplan.btree.decorators import SubTree
from mazeplan.btree.node import TreeNode
from mazeplan.btree.ports import Key, shown
from mazeplan.btree.tree import BehaviorTree

SYMBOLS = {
    "Sequence": "→", "SequenceWithMemory": "→*", "ReactiveSequence": "→ᴿ", "Fallback": "?", "ReactiveFallback": "?ᴿ",
    "Parallel": "⇉", "Repeat": "↻", "RetryUntilSuccessful": "↺", "Inverter": "¬",
}  # fmt: skip
FOLDED = "(as above)"


def tree_text(tree: BehaviorTree, whole: bool = False) -> str:
    """The tree as text, one line for each node, with its ports. whole: whether nothing is folded"""
    lines, drawn = list[str](), set[str]()

    def draw(node: TreeNode, branch: str, below: str) -> None:
        """branch: before the node; below: before what is below it"""
        folded = False
        if isinstance(node, SubTree) and not whole:
            name = str(node.values.get("ID", node.name))
            folded = name in drawn
            drawn.add(name)
        lines.append(f"{branch}{_words(node)}{f' {FOLDED}' if folded else ''}")
        for child in () if folded else node.parts:
            last = child is node.parts[-1]
            draw(child, below + ("└── " if last else "├── "), below + ("    " if last else "│   "))

    draw(tree.root, "", "")
    return "\n".join(lines)


def _words(node: TreeNode) -> str:
    """Kind of node, with a symbol; its name, if it is not that of its kind; ports and conditions as in the file."""
    kind = type(node).__name__
    ports = [f"{name}={_written(value)}" for name, value in node.values.items()]
    given = {} if node.conditions is None else node.conditions.given
    scripts = [f'{name}="{_written(script.text)}"' for name, script in given.items()]
    return " ".join(filter(None, (SYMBOLS.get(kind), kind, f"'{node.name}'" * (node.name != kind), *ports, *scripts)))


def _written(value: Any) -> str:
    if isinstance(value, Key):
        return str(value)
    text = ";".join(map(str, value)) if isinstance(value, list) else str(value)
    return text if text.isprintable() and len(text) <= 60 else shown(text)
