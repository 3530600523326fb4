"""Effects that users bring: `--effects MODULE:NAME`."""

from __future__ import annotations

from collections.abc import Container

from mazeplan.diagnosis.library import TERM, Candidate
from mazeplan.errors import InputError
from mazeplan.usermodule import user_module


def own_effects(spec: str | None, taken: Container[str]) -> list[Candidate]:
    """The candidates that a function of a module returns; of the working folder, too. taken: names that the library
    has. Raises InputError for anything else."""
    if spec is None:
        return []
    module, _, name = spec.partition(":")
    if not module or not name:
        raise InputError(f"--effects: got {spec!r}, expected MODULE:FUNCTION")
    try:
        found = list(getattr(user_module(module, "--effects"), name)())
    except (AttributeError, TypeError) as problem:
        raise InputError(f"--effects: {spec!r} gives no effects: {problem}") from None
    for c in found:
        if not isinstance(c, Candidate) or c.acts != TERM or not hasattr(c.term, "get_compile_result"):
            what = c.name if isinstance(c, Candidate) else repr(c)
            raise InputError(f"--effects: got {what}, expected a Candidate with a term compiled by numba.njit")
        if c.name in taken:
            raise InputError(f"--effects: got the name {c.name!r}, which the library has; expected another")
    return found
