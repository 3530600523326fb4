"""Trees of a run: reads them by name or file, and checks them against a map before anything moves.

Trees that come with the program can be named, and any file can include them.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from mazeplan.btree import check, treefile
from mazeplan.btree.builder import build
from mazeplan.btree.leaf import Context
from mazeplan.btree.node import TreeNode
from mazeplan.btree.tree import BehaviorTree
from mazeplan.btree.treefile import TreeFile
from mazeplan.core import file_kinds, resources
from mazeplan.core.errors import TreeError, one_of
from mazeplan.maze.geometry import Maze

SET_BY_THE_RUN = ("goal", "waypoints")  # keys that the run sets in the outermost scope, before the first tick


class StaticContext:
    """Context of a tree that never runs. maze: its rings and openings may be named in the tree; None: any names."""

    def __init__(self, maze: Maze | None = None) -> None:
        self._maze = maze

    def clock(self) -> float:
        """Always 0: the time of a tree that does not run, s."""
        return 0.0

    def failed(self, failure: Any) -> None:
        """Ignore the failure."""

    def choices(self, name: str) -> tuple[Any, ...] | None:
        """The rings or openings of the map; None without a map."""
        return None if self._maze is None else choices_of(self._maze, name)


def choices_of(maze: Maze, name: str) -> tuple[Any, ...]:
    """The values of a port with these choices: names of the `openings`, or numbers of the `rings`."""
    return tuple(o.name for o in maze.openings) if name == "openings" else tuple(r.number for r in maze.rings)


def tree_names() -> tuple[str, ...]:
    """Names of the packaged trees."""
    return tuple(sorted(path.stem for path in resources.share("behaviors").glob("*.xml")))


def read_tree(source: str | Path) -> TreeFile:
    """Read a file, the packaged tree of that name, or XML text (it begins with <). Raises TreeError."""
    library = resources.share("behaviors")
    if isinstance(source, str) and source.lstrip().startswith("<"):
        return treefile.read_tree(source, library)
    path = resources.find("behaviors", source, ".xml")
    if not path.is_file():
        raise TreeError(file_kinds.refused(path, f"an XML file or {one_of(tree_names(), path.name)}"), file=path)
    if file_kinds.got(path) not in ("XML", "text"):
        raise TreeError(file_kinds.refused(path, treefile.EXPECTED), file=path, line=1)
    return treefile.read_tree(path, library)


def load_tree(
    source: str | Path, registry: Mapping[str, type[TreeNode]], context: Context, main: str | None = None
) -> BehaviorTree:
    """Read a tree as `read_tree` does, and build the tree `main`; None: the file's main tree, or its only tree.

    Raises TreeError with file, line, path in the tree, and what is allowed."""
    return build(read_tree(source), registry, context, main)


def check_file(source: str | Path, registry: Mapping[str, type[TreeNode]], context: Context) -> check.Findings:
    """Check a tree, read as `read_tree` does (`check.check_file`)."""
    return check.check_file(read_tree(source), registry, context, SET_BY_THE_RUN)


def refuse_mistakes(tree: BehaviorTree) -> None:
    """Raises TreeError for the first error in a tree that was built but not ticked; the error holds the others."""
    first = None if tree.root.place is None else tree.root.place.file
    errors = check.listed(check.check_tree(tree, SET_BY_THE_RUN).errors, first)
    if errors:
        errors[0].others = errors[1:]
        raise errors[0]
