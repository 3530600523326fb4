"""Exceptions that a user's node raises name the node: file, line, path in the tree, and the line of its code.

Exceptions of log, page or rig do not name a node, even if a node called them: nobody should look for a full disk in a
leaf."""

from __future__ import annotations

import traceback
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from mazeplan.core.errors import MazeplanError, RigError, TreeError


class CommandError(Exception):
    """A command that cannot go out. If a leaf gives it, the error becomes a TreeError at the leaf's line."""


NAMED = "raised by the "  # begins the note that names the node
OUTSIDE = "_of_no_node"  # attribute that marks an exception for which no node is to blame


@contextmanager
def blame_no_node() -> Iterator[None]:
    """A context for work that a node triggers but does not do itself: no node is blamed for an exception in it."""
    try:
        yield
    except Exception as problem:
        setattr(problem, OUTSIDE, True)
        raise


def blames_a_node(problem: BaseException) -> bool:
    """Whether a node raised this exception. The exception then names the node by file and line."""
    return isinstance(problem, TreeError) or any(n.startswith(NAMED) for n in getattr(problem, "__notes__", ()))


def exception_line(problem: BaseException) -> str:
    """An exception of a node as one line: what happened, and which node raised it."""
    reason = str(problem) if isinstance(problem, MazeplanError) else f"{type(problem).__name__}: {problem}"
    return " ".join(", ".join((reason, *getattr(problem, "__notes__", ()))).split())


def blame(problem: Exception | SystemExit, where: str, kind: str = "leaf") -> Exception:
    """The exception to raise in place of an exception that a node let through: it gets a note that says where.

    An exception that already names a node, or that comes from elsewhere (a rig, `blame_no_node`), stays as it is.
    Raises a SystemExit that a signal caused."""
    if isinstance(problem, SystemExit):
        if type(problem) is not SystemExit:  # a signal caused it; it may come at any place
            raise problem
        ended: Exception = RuntimeError(f"sys.exit({problem.code!r}) in a {kind}, which ends no run")
    elif isinstance(problem, RigError) or hasattr(problem, OUTSIDE) or blames_a_node(problem):
        return problem
    else:
        ended = problem
    code = traceback.extract_tb(problem.__traceback__)[-1]  # kept as text: tracebacks do not reach another process
    ended.add_note(f"{NAMED}{kind} at {where} ({Path(code.filename).name}:{code.lineno})")
    return ended
