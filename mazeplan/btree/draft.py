"""Builds a tree in spite of its mistakes, and keeps all of them, to check a file."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from mazeplan.btree.builder import Builder
from mazeplan.btree.leaf import Context
from mazeplan.btree.mistakes import MOST_KEPT, EnoughError, Mistakes
from mazeplan.btree.node import TreeNode
from mazeplan.btree.tree import BehaviorTree
from mazeplan.btree.tree_parts import Part
from mazeplan.core.errors import TreeError


@dataclass(frozen=True)
class Draft:
    """A tree that may have mistakes.

    tree: with `Unbuilt` in place of nodes that have mistakes; None if there is no main tree, or the builder gave up
    remarks: on the file itself (`TreeParts.remarks`)
    """

    tree: BehaviorTree | None
    mistakes: tuple[TreeError, ...]
    remarks: tuple[TreeError, ...]


def draft(
    parts: Sequence[Part], registry: Mapping[str, type[TreeNode]], context: Context, main: str | None = None
) -> Draft:
    """Build what can be built of the tree `main`, and keep the mistakes."""
    mistakes, tree, remarks = Mistakes(MOST_KEPT), None, ()
    try:
        builder = Builder(parts, registry, context, mistakes)
        with mistakes:
            tree = builder.build(main)
        if tree is None:
            builder.build_other_trees(None)
        else:
            remarks = builder.files.remarks(tree.name)
    except EnoughError:
        tree = None
    return Draft(tree, mistakes.found, remarks)
