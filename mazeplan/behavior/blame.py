"""What comes out of a user's own node names the node: file, line, path in the tree, and the line of its code. What log,
page or rig did is theirs, though a node called them: nobody shall look for a full disk in a leaf."""

from __future__ import annotations

import traceback
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from mazeplan.core.errors import MazeplanError, RigError, TreeError


class CommandError(Exception):
    """A command that cannot go out; the leaf that gives it makes it a TreeError at its own line."""


RAISED = "raised by the {} at "
KINDS = ("leaf", "node")
OUTSIDE = "_of_no_node"  # the mark on an exception


@contextmanager
def outside() -> Iterator[None]:
    """Around what a node sets off, but has no hand in: no node is blamed for an exception out of here."""
    try:
        yield
    except Exception as problem:
        setattr(problem, OUTSIDE, True)
        raise


def blames_a_node(problem: BaseException) -> bool:
    """Whether an exception came out of a node, which then stands in it by file and line."""
    begins = tuple(RAISED.format(kind) for kind in KINDS)
    return isinstance(problem, TreeError) or any(n.startswith(begins) for n in getattr(problem, "__notes__", ()))


def fault(problem: BaseException) -> str:
    """What came out of a node, in a line: what, and which node."""
    told = str(problem) if isinstance(problem, MazeplanError) else f"{type(problem).__name__}: {problem}"
    return " ".join(", ".join((told, *getattr(problem, "__notes__", ()))).split())


def blame(problem: Exception | SystemExit, where: str, kind: str = "leaf") -> Exception:
    """The exception to raise for one that came out of a node: with a note that says where, unless it has one or it
    came from elsewhere (a rig, `outside`). Raises a SystemExit that is a signal's as it is."""
    if isinstance(problem, SystemExit):
        if type(problem) is not SystemExit:  # that of a signal, wherever it comes
            raise problem
        ended: Exception = RuntimeError(f"sys.exit({problem.code!r}) in a {kind}, which ends no run")
    elif isinstance(problem, RigError) or hasattr(problem, OUTSIDE) or blames_a_node(problem):
        return problem
    else:
        ended = problem
    code = traceback.extract_tb(problem.__traceback__)[-1]  # which the way to another process does not keep
    ended.add_note(f"{RAISED.format(kind)}{where} ({Path(code.filename).name}:{code.lineno})")
    return ended
