"""Checks the values of keys: constants that a reading port refuses, and keys that are read before they are set."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Set
from dataclasses import dataclass
from typing import Any

from mazeplan.behavior.builtin_leaves import SetBlackboard
from mazeplan.behavior.choices import SWITCHES, IfThenElse, ManualSelector, WhileDoElse
from mazeplan.behavior.conditions import DECISIONS, ENDINGS, ON_HALTED, POST
from mazeplan.behavior.controls import Parallel, ParallelAll, TryCatch
from mazeplan.behavior.decorators import (
    Delay,
    ForceFailure,
    ForceSuccess,
    Inverter,
    KeepRunningUntilFailure,
    Repeat,
    RetryUntilSuccessful,
    RunOnce,
    SubTree,
    Timeout,
    queued,
)
from mazeplan.behavior.key_uses import NAMES, Home, Use, scripts_of
from mazeplan.behavior.never_ticked import FALLBACKS, SEQUENCES
from mazeplan.behavior.node import TreeNode
from mazeplan.behavior.ports import Key, shown
from mazeplan.behavior.tree import parts_of
from mazeplan.core.errors import TreeError

IN_ORDER = (*FALLBACKS, Parallel, ParallelAll)
TICK_THE_FIRST = (*IN_ORDER, IfThenElse, WhileDoElse, TryCatch)
TICK_ALL = (
    *SEQUENCES, SubTree, Inverter, ForceSuccess, ForceFailure, Repeat, RetryUntilSuccessful, Timeout, Delay, RunOnce,
    KeepRunningUntilFailure,
)  # fmt: skip
STOP = (*SEQUENCES, SubTree, Repeat, RetryUntilSuccessful, Timeout, Delay, RunOnce)  # fail as their child does


@dataclass(frozen=True)
class _Source:
    """A use that sets a key. values: the values that it may set; None: they are unknown before the run."""

    use: Use
    values: tuple[Any, ...] | None
    in_turn: bool = False  # whether each of the values is set, one after another


def wrong_constants(
    reads: Iterable[Use], writes: Iterable[Use], given: Set[Home]
) -> tuple[list[TreeError], list[TreeError]]:
    """(errors, warnings) at nodes that set a key to a constant that a port refuses.

    Only keys that get nothing but constants are checked. It is an error if the port refuses all constants of the key.
    It is also an error if a loop sets the constant in turn and every reader refuses it. Else it is a warning.

    given: keys that have a value from elsewhere"""
    readers, sources = dict[Home, list[Use]](), dict[Home, list[_Source]]()
    for use in (*writes, *reads):
        found = _source(use)
        if found is not None:
            if isinstance(use.node.values.get("output_key"), Key):  # the node may set any key
                return [], []
            sources.setdefault(use.home, []).append(found)
    for use in reads:
        readers.setdefault(use.home, []).append(use)
    errors, warnings = list[TreeError](), list[TreeError]()
    for home, found in sources.items():
        if home in given or any(source.values is None for source in found):
            continue
        values = {(type(value), value): value for source in found for value in source.values or ()}
        refusing = {
            one: next((use for use in readers.get(home, ()) if not _takes(use, value)), None)
            for one, value in values.items()
        }
        for source in found:
            wrong = next((value for value in source.values or () if refusing[type(value), value] is not None), None)
            reader = refusing.get((type(wrong), wrong))
            if reader is not None:
                sure = not any(_takes(reader, value) for value in values.values())
                sure = sure or (source.in_turn and not any(_takes(use, wrong) for use in readers[home]))
                (errors if sure else warnings).append(_refused(source, wrong, reader))
    return errors, warnings


def _source(use: Use) -> _Source | None:
    """The source of values that a use is; None if the use only reads."""
    node = use.node
    script = dict(scripts_of(node)).get(use.attribute)
    if script is not None:
        return _Source(use, script.constants.get(use.name)) if use.name in script.sets else None
    if isinstance(node, SetBlackboard) and use.attribute == "output_key":
        value = node.values["value"]
        return _Source(use, None if isinstance(value, Key) else (value,))
    port = node.ports.get(use.attribute)
    if port is not None and port.direction == "in":
        return None
    values = queued(node) if use.attribute == "value" else None
    return _Source(use, values, values is not None)


def _takes(use: Use, value: Any) -> bool:
    """Whether a reader accepts a value; scripts accept any value."""
    port = use.node.ports.get(use.attribute)
    if port is None or not isinstance(use.node.values.get(use.attribute), Key):
        return True
    try:
        port.accept(value, getattr(use.node, "context", None))
    except (ValueError, OverflowError):
        return False
    return True


def _refused(source: _Source, value: Any, reader: Use) -> TreeError:
    expected = reader.node.ports[reader.attribute].expects(getattr(reader.node, "context", None))
    what = "queue" if source.in_turn else "value" if source.use.attribute == "output_key" else source.use.attribute
    inside = f"{reader.node.name} reads {Key(reader.name)}{reader.at}"
    return source.use.node.wrong(
        f"{what}: got {shown(value)} for {Key(source.use.name)}, expected {expected}; {inside}"
    )


def read_before_set(reads: Iterable[Use], writes: Iterable[Use], given: Set[Home]) -> Iterator[TreeError]:
    """Remarks at the first node that reads a key, if it always comes before all nodes that set the key.

    reads, writes: in the order of the nodes, parents before children
    given: keys that have a value from elsewhere
    """
    first, setters = dict[Home, Use](), dict[Home, list[Use]]()
    for use in reads:
        if use.attribute not in ("_onFailure", ON_HALTED) and not _may_miss(use):
            first.setdefault(use.home, use)
    for use in writes:
        setters.setdefault(use.home, []).append(use)
    for home, use in first.items():
        found = setters.get(home, ())
        if found and home not in given and all(_before(use, setter) for setter in found):
            setter = found[0].node
            later = "it sets itself, later" if setter is use.node else f"{setter.name}{found[0].at} sets later"
            yield use.node.wrong(f"{use.attribute}: reads {Key(use.name)}, which {later}")


def _may_miss(use: Use) -> bool:
    """Whether the node accepts a key that was never set, or does not always read it."""
    node, port = use.node, use.attribute
    script = dict(scripts_of(node)).get(port)
    if script is not None:
        return use.name not in script.needs
    return port in node.ports and (
        isinstance(node, (*SWITCHES, ManualSelector)) or port == NAMES.get(type(node).__name__)
    )


def _turn(use: Use) -> int:
    """When a node uses one of its attributes: 0 with its preconditions, 1 when it is ticked, 2 when it ends."""
    return 0 if use.attribute in DECISIONS else 2 if use.attribute in (*ENDINGS, ON_HALTED, POST) else 1


def _before(use: Use, setter: Use) -> bool:
    """Whether `use` always reads the key before `setter` sets it."""
    if setter.node is use.node:  # a script lists a key among its reads only if it reads before it sets
        same = use.attribute == setter.attribute and use.attribute in dict(scripts_of(use.node))
        return same or _turn(use) < _turn(setter)
    above = dict[int, TreeNode]()  # {id of a node above the setter: its child on the way to the setter}
    part: Any = setter.node
    while part is not None:
        above[id(part.parent)] = part
        part = part.parent
    if id(use.node) in above:
        return _turn(use) < 2
    child: Any = use.node
    # at_once: no node is ticked before the reader; stops: a failure before the reader ends all nodes up to here
    at_once = stops = True
    while child.parent is not None:
        given = () if child.conditions is None else child.conditions.given
        if (child is not use.node or use.attribute not in DECISIONS) and any(name in DECISIONS for name in given):
            return False
        parent, parts = child.parent, parts_of(child.parent)
        first = parts[0] is child
        if id(parent) in above:
            if parts.index(child) >= parts.index(above[id(parent)]):
                return False
            if isinstance(parent, SEQUENCES):
                return at_once or stops
            return at_once and isinstance(parent, TICK_THE_FIRST if first else IN_ORDER)
        if not (isinstance(parent, TICK_ALL) or (isinstance(parent, TICK_THE_FIRST) and first)):
            return False
        at_once, stops = at_once and first, stops and isinstance(parent, STOP)
        child = parent
    return False
