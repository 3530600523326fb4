"""What BehaviorTree.CPP does with the trees of tests/conformance: writes expected.txt, or compares mazeplan with it.

    python tools/btcpp_conformance.py --runner PATH     # write tests/conformance/expected.txt anew
    python tools/btcpp_conformance.py                   # compare

A line a tick: the results of the nodes in the order in which their ticks ended, numbered from the root in the order of
the file, starts and halts of actions between them, then the result of the root; last of all the blackboards.
"""

from __future__ import annotations

import argparse
import re
import sys
from collections.abc import Iterator
from pathlib import Path

from btcpp_cases import Case
from btcpp_reference import Record, Runner, _plain, _text, ours

FOLDER = Path(__file__).resolve().parent.parent / "tests" / "conformance"
LEAF = re.compile(r"\b([a-i])\(([SRF]+)((?: [^()]*)?)\)")


def cases() -> Iterator[tuple[str, Case]]:
    """(name, case) of cases.txt."""
    for line in (FOLDER / "cases.txt").read_text().splitlines():
        if not line or line.startswith("#"):
            continue
        name, ticks, tree = (cell.strip() for cell in line.split("|", 2))
        count, *more = ticks.split()
        halts = tuple(int(more[i + 1]) for i, word in enumerate(more) if word == "halt")
        yield name, Case(_file(tree), int(count), {}, halts, once="once" in more)


def _file(tree: str) -> str:
    main, *inner = tree.split(" ## ")
    trees = [("Main", main), *(("Inner", content) for content in inner)]
    body = "".join(f'<BehaviorTree ID="{name}">{_leaves(content)}</BehaviorTree>' for name, content in trees)
    return f'<root BTCPP_format="4" main_tree_to_execute="Main">{body}</root>'


def _leaves(tree: str) -> str:
    """Leaves in full, and no text between elements."""

    def leaf(found: re.Match[str]) -> str:
        kind = "Check" if found[1] in "cd" else "Scripted"
        return f'<{kind} name="{found[1]}" script="{found[2]}"{found[3]}/>'

    return re.sub(r">\s+<", "><", LEAF.sub(leaf, tree))


def in_lines(record: Record) -> list[str]:
    """A record in lines; of an error only that there is one, since the words differ."""
    if not record["loads"]:
        return ["refused"]
    lines = []
    for tick in record["ticks"]:
        shown = {**tick, "events": [e for e in tick["events"] if e[-1] != "IDLE"]}
        if "error" in shown:
            return [*lines, "error"]
        lines.append(_text(shown))
    for tree, values in _plain(record.get("board", [])):
        given = ", ".join(f"{name} = {value!r}" for name, value in values.items())
        lines.append(f"{tree}: {given or 'nothing'}")
    return lines


def expected() -> dict[str, list[str]]:
    """{name: lines} of expected.txt."""
    out: dict[str, list[str]] = {}
    name = ""
    for line in (FOLDER / "expected.txt").read_text().splitlines():
        if line.startswith("    "):
            out[name].append(line[4:])
        elif line and not line.startswith("#"):
            name = line
            out[name] = []
    return out


def main() -> None:
    """Write, or compare."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--runner", help="the program of tools/btcpp/README.md")
    given = parser.parse_args()
    if given.runner:
        runner, out = Runner(given.runner), ["# Written by tools/btcpp_conformance.py with BehaviorTree.CPP 4.10.0."]
        for name, case in cases():
            out += ["", name, *(f"    {line}" for line in in_lines(runner.ask(case.asked())))]
        runner.close()
        (FOLDER / "expected.txt").write_text("\n".join(out) + "\n")
    known, wrong = expected(), 0
    for name, case in cases():
        mine = in_lines(ours(case))
        if mine != known.get(name):
            wrong += 1
            print(name, *known.get(name, []), "mazeplan:", *mine, sep="\n    ")
    print(f"{len(known) - wrong} of {len(known)} the same")
    sys.exit(wrong > 0)


if __name__ == "__main__":
    main()
