"""What the nodes do, tick by tick, from the documentation of BehaviorTree.CPP 4.

A row: node with its ports | what each child returns, tick by tick, the last letter for ever | what the node returns |
how often each child did a step | how often each was halted. R: RUNNING, S: SUCCESS, F: FAILURE, -: SKIPPED, which
halts a child that runs, as _while does.
"""

from __future__ import annotations

import pytest
from scripted import Run, build, scripted, tick, wrap

from mazeplan.btree.status import Status

TABLE = """
Sequence                            | S S     | S    | 1 1   | 0 0
Sequence                            | S RS S  | RS   | 1 2 1 | 0 0 0
Sequence                            | S FS S  | FS   | 2 2 1 | 0 0 0
Sequence                            | R       | RRR  | 3     | 0
Sequence                            | - S     | S    | 0 1   | 0 0
Sequence                            | S -     | S    | 1 0   | 0 0
Sequence                            | - F     | F    | 0 1   | 0 0
Sequence                            | - -     | --   | 0 0   | 0 0
Sequence                            | -S RF   | RFF  | 1 3   | 0 0
Sequence                            | - R-    | R-   | 0 1   | 0 1
Sequence                            | S R- S  | RS   | 1 1 1 | 0 1 0
Sequence                            | -S -    | -S   | 1 0   | 0 0
SequenceWithMemory                  | S S     | SS   | 2 2   | 0 0
SequenceWithMemory                  | S FS S  | FS   | 1 2 1 | 0 0 0
SequenceWithMemory                  | S FS FS | FFS  | 1 2 2 | 0 0 0
SequenceWithMemory                  | S RS    | RS   | 1 2   | 0 0
SequenceWithMemory                  | S - S   | S    | 1 0 1 | 0 0 0
SequenceWithMemory                  | - -     | -    | 0 0   | 0 0
SequenceWithMemory                  | - F     | FF   | 0 2   | 0 0
SequenceWithMemory                  | S R-    | RS   | 1 1   | 0 1
ReactiveSequence                    | S S     | S    | 1 1   | 0 0
ReactiveSequence                    | S RRS   | RRS  | 3 3   | 0 0
ReactiveSequence                    | RS S    | RS   | 2 1   | 0 0
ReactiveSequence                    | SF R    | RF   | 2 1   | 0 1
ReactiveSequence                    | SR R    | RR   | 2 1   | 0 1
ReactiveSequence                    | - S     | S    | 0 1   | 0 0
ReactiveSequence                    | S-S RRS | RRS  | 2 3   | 0 0
ReactiveSequence                    | - -     | --   | 0 0   | 0 0
ReactiveSequence                    | - R-    | R-   | 0 1   | 0 1
ReactiveSequence                    | -F R    | RF   | 1 1   | 0 1
Fallback                            | F S     | S    | 1 1   | 0 0
Fallback                            | F RF S  | RS   | 1 2 1 | 0 0 0
Fallback                            | F F     | F    | 1 1   | 0 0
Fallback                            | S F     | S    | 1 0   | 0 0
Fallback                            | - S     | S    | 0 1   | 0 0
Fallback                            | - F     | F    | 0 1   | 0 0
Fallback                            | F -     | F    | 1 0   | 0 0
Fallback                            | - -     | --   | 0 0   | 0 0
Fallback                            | F R- S  | RS   | 1 1 1 | 0 1 0
Fallback                            | - R-    | R-   | 0 1   | 0 1
ReactiveFallback                    | F RRF   | RRF  | 3 3   | 0 0
ReactiveFallback                    | FS R    | RS   | 2 1   | 0 1
ReactiveFallback                    | FR R    | RR   | 2 1   | 0 1
ReactiveFallback                    | - F     | F    | 0 1   | 0 0
ReactiveFallback                    | F-F RRS | RRS  | 2 3   | 0 0
ReactiveFallback                    | - -     | --   | 0 0   | 0 0
ReactiveFallback                    | -S R    | RS   | 1 1   | 0 1
Parallel                            | S RS    | RS   | 1 2   | 0 0
Parallel                            | S RRS   | RRS  | 1 3   | 0 0
Parallel                            | F R     | F    | 1 0   | 0 0
Parallel                            | R F     | F    | 1 1   | 1 0
Parallel                            | RF R    | RF   | 2 1   | 0 1
Parallel 1 2                        | F RS    | RS   | 1 2   | 0 0
Parallel 1 2                        | R RS    | RS   | 2 2   | 1 0
Parallel 1 -1                       | F F     | F    | 1 1   | 0 0
Parallel -2 -1                      | S R S   | S    | 1 1 1 | 0 1 0
Parallel 1 -2                       | F F R   | F    | 1 1 0 | 0 0 0
Parallel 0 1                        | R R     | S    | 1 0   | 1 0
Parallel 1 0                        | R R     | F    | 1 0   | 1 0
Parallel                            | - S     | S    | 0 1   | 0 0
Parallel                            | S -     | S    | 1 0   | 0 0
Parallel                            | - F     | F    | 0 1   | 0 0
Parallel                            | - RS    | RS   | 0 2   | 0 0
Parallel                            | -S RRS  | RRS  | 1 3   | 0 0
Parallel                            | - -     | SS   | 0 0   | 0 0
Parallel                            | R- S    | RS   | 1 1   | 1 0
Parallel -2 -1                      | - S R   | S    | 0 1 0 | 0 0 0
Parallel 1 2                        | - RS    | RS   | 0 2   | 0 0
Parallel 2 2                        | S --S   | RRS  | 1 1   | 0 0
Parallel 2 2                        | - -     | -    | 0 0   | 0 0
Parallel 1 -1                       | F -F    | RF   | 1 1   | 0 0
RetryUntilSuccessful 3              | FFS     | S    | 3     | 0
RetryUntilSuccessful 2              | F       | FF   | 4     | 0
RetryUntilSuccessful 2              | FRF     | RF   | 3     | 0
RetryUntilSuccessful 0              | S       | F    | 0     | 0
RetryUntilSuccessful -1             | FFS     | RRS  | 3     | 0
RetryUntilSuccessful 3              | F-S     | -S   | 2     | 0
RetryUntilSuccessful 3              | F-F     | -FF  | 6     | 0
RetryUntilSuccessful 3              | R-      | R-   | 1     | 1
Repeat 3                            | S       | SS   | 6     | 0
Repeat 3                            | SF      | F    | 2     | 0
Repeat 2                            | RSRS    | RRS  | 4     | 0
Repeat -1                           | S       | RRR  | 3     | 0
Repeat 0                            | F       | S    | 0     | 0
Repeat 3                            | S-S     | -SS  | 6     | 0
Repeat 3                            | SR-     | R--  | 2     | 1
Inverter                            | RSF     | RFS  | 3     | 0
Inverter                            | -S      | -F   | 1     | 0
ForceSuccess                        | RFS     | RSS  | 3     | 0
ForceSuccess                        | -F      | -S   | 1     | 0
ForceFailure                        | RSF     | RFF  | 3     | 0
ForceFailure                        | -S      | -F   | 1     | 0
KeepRunningUntilFailure             | SRF     | RRF  | 3     | 0
KeepRunningUntilFailure             | -F      | RF   | 1     | 0
Timeout 100                         | RS      | RS   | 2     | 0
Timeout 100                         | -R-     | -R-  | 1     | 1
Delay 0                             | RF      | RF   | 2     | 0
Delay 0                             | -S      | -S   | 1     | 0
SubTree                             | RS      | RS   | 2     | 0
SubTree                             | -RF     | -RF  | 2     | 0
"""
ROWS = [tuple(cell.split() for cell in line.split("|")) for line in TABLE.split("\n") if line]
PORTS = {
    "Parallel": ("success_count", "failure_count"), "RetryUntilSuccessful": ("num_attempts",),
    "Repeat": ("num_cycles",), "Timeout": ("msec",), "Delay": ("delay_msec",),
}  # fmt: skip


@pytest.mark.parametrize("row", ROWS, ids=lambda row: "_".join((*row[0], *row[1])))
def test_a_row_of_the_table(row):
    (kind, *numbers), scripts, (expected,), ticks, halts = row
    ports = dict(zip(PORTS.get(kind, ()), map(int, numbers), strict=bool(numbers)))
    node, leaves = build(kind, scripts, ports)
    assert "".join(tick(node) for _ in expected) == expected
    assert [leaf.ticks for leaf in leaves] == list(map(int, ticks))
    assert [leaf.halts for leaf in leaves] == list(map(int, halts))
    if node.status is not Status.RUNNING:
        assert all(player.leaf.status is not Status.RUNNING for player in leaves)
    node.reset()
    node.reset()
    assert [leaf.ends + leaf.halts for leaf in leaves] == [leaf.starts for leaf in leaves]
    assert all(player.leaf.status is not Status.RUNNING for player in leaves)


def test_every_node_is_in_the_table_with_a_child_that_is_skipped():
    from scripted import NODES

    rest = ("Async", "ParallelAll", "IfThenElse", "WhileDoElse", "Switch", "TryCatch", "Manual", "RunOnce")
    rest += ("Precondition", "Loop", "SkipUnless", "WaitValue")  # tests/conformance has these
    known = {kind for kind in NODES if not kind.startswith(rest)}
    assert {kind for (kind, *_), scripts, *_ in ROWS if any("-" in script for script in scripts)} == known


@pytest.mark.parametrize(
    ("parent", "values", "ticks", "expected"),
    [
        ("Parallel", {"success_count": 2, "failure_count": 2}, 3, "RS"),  # asked again at once: it goes on counting
        ("Sequence", {}, 4, "SS"),  # done with it: it starts anew
        ("ReactiveSequence", {}, 4, "SS"),
    ],
)
def test_a_loop_keeps_its_count_over_a_skip_until_its_parent_is_done(parent, values, ticks, expected):
    loop, (leaf,) = build("Repeat", ["S-S"], {"num_cycles": 3})
    node = wrap(parent, [loop, scripted("S").leaf], values)
    assert tick(node) + tick(node) == expected
    assert leaf.ticks == ticks


def test_the_time_of_a_timeout_begins_with_its_child_and_a_delay_is_waited_for_once():
    run = Run()
    timeout, _ = build("Timeout", ["-R"], {"msec": 100}, run)
    delay, _ = build("Delay", ["-S"], {"delay_msec": 100}, run)
    said = {0.0: "-R", 0.1: "R-", 0.15: "RS", 0.2: "FR"}
    for run.now, expected in said.items():
        assert tick(timeout) + tick(delay) == expected
