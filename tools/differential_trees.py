"""Random trees in mazeplan and in BehaviorTree.CPP: do both do the same?

    python tools/differential_trees.py --count 20000 --seed 1 --runner PATH

Each seed gives one tree (tools/btcpp_cases.py). Both sides load and tick it (tools/btcpp_reference.py). A difference is
shrunk: subtrees, attributes and parts of scripts are deleted as long as it stays. KNOWN lists the differences that are
meant, with the reason. The exit status is 0 if no other one was found.
"""

from __future__ import annotations

import argparse
import re
import sys
from collections import Counter, defaultdict
from collections.abc import Callable, Iterator
from copy import deepcopy
from dataclasses import dataclass, replace
from typing import Any

from btcpp_cases import BEFORE, KINDS, Case, random_case
from btcpp_reference import Difference, Record, Runner, difference, ours
from lxml import etree  # pyright: ignore[reportAttributeAccessIssue]  # compiled, without stubs

NEEDED = ("ID", "script")  # attributes that stay
MOST_TRIES = 1500  # cases tried while one difference is shrunk
Element = Any  # lxml's class is not public


@dataclass(frozen=True)
class Known:
    """A difference that is meant. `holds`: of the case and the difference; `shrunk`: asked only of the smallest case,
    since larger ones may look the same and differ for another reason."""

    name: str
    reason: str
    holds: Callable[[Case, Difference], bool]
    shrunk: bool = False


def _theirs(pattern: str) -> Callable[[Case, Difference], bool]:
    return lambda case, found: re.search(pattern, found.theirs, re.DOTALL) is not None


def _ours(pattern: str) -> Callable[[Case, Difference], bool]:
    return lambda case, found: re.search(pattern, found.ours, re.DOTALL) is not None


def _never_set(case: Case, found: Difference) -> bool:
    """Whether mazeplan misses an entry that nothing in the case sets."""
    missing = re.search(": the blackboard has no '([^']*)'", found.ours)
    return (
        missing is not None
        and "Script" in case.xml
        and missing.group(1) not in case.board
        and re.search(rf"\b{re.escape(missing.group(1))}\s*:=", case.xml) is None
    )


def _stuck_condition(case: Case, found: Difference) -> bool:
    """Whether a condition that keeps what it ended with may be ticked again: a stateful leaf, or one with a
    precondition."""
    conditions = [e[0] for e in etree.fromstring(case.xml).iter("IfThenElse", "WhileDoElse") if len(e)]
    below = [e for condition in conditions for e in condition.iter()]
    return case.ticks > 1 and any(e.tag in ("Scripted", "Sleep") or {*e.attrib} & {*BEFORE} for e in below)


TYPES = (
    "was initially created with type|the type of a port shall not change|terminated while the tree"
    "|] (Any::copyInto fails)$"
)
KNOWN = (
    Known(
        "division by 0",
        "an error in mazeplan, an infinite number in BehaviorTree.CPP, which then ends far from its cause",
        _ours("expected a divisor other than 0"),
    ),
    Known(
        "whole numbers as conditions",
        "2 is true in mazeplan; BehaviorTree.CPP raises an error for whole numbers other than 0 and 1",
        _theirs("not castable to bool|Implicit casting to bool|negative and can't be converted to unsigned"),
    ),
    Known(
        "text as a condition",
        "BehaviorTree.CPP raises an error for text, but in '3' ? 1 : 2; in mazeplan text is true as it reads",
        lambda case, found: (
            "between [std::string] and [bool]" in found.theirs
            or ("?" in case.xml and "failed string to number conversion" in found.theirs)
        ),
    ),
    Known(
        "numbers at the front of a text",
        "BehaviorTree.CPP reads '3 rings' as 3; mazeplan wants the whole text to be a number",
        _ours(r"got '[0-9]+([.][0-9]+)?([^0-9.']|[.][0-9]*[.])[^']*('|[.]{3}) ?(beside|for|, expected)"),
    ),
    Known(
        "number of children",
        "mazeplan refuses a wrong number of children when it reads the file, BehaviorTree.CPP when it ticks the node",
        lambda case, found: found.category == "load" and "children" in found.ours and "expected" in found.ours,
    ),
    Known(
        "a limit that falls",
        "Repeat and RetryUntilSuccessful whose limit falls to their count halt a child that runs; in BehaviorTree.CPP "
        "it runs on, and goes on where it was when the node is ticked again",
        lambda case, found: (
            re.search(r'num_(cycles|attempts)="{', case.xml) is not None
            and found.category in ("halts", "order", "blackboard")
            and (re.search("[^:]n:?=[01]", case.xml) is not None or any(key == "n" for _, key, _ in case.sets))
        ),
        shrunk=True,
    ),
    Known(
        "a script that fails while nodes are halted",
        "mazeplan halts all other nodes, then tells the error; BehaviorTree.CPP leaves the others as they are",
        lambda case, found: (
            (": _onHalted: " in found.ours or "catch_on_halt" in case.xml)
            and re.search("rror in script|not found", found.theirs) is not None
        ),
        shrunk=True,
    ),
    Known(
        "a wake-up from a halt",
        "a child that TryCatch ticks while it is halted may ask for another tick, which mazeplan forgets",
        lambda case, found: case.once and "catch_on_halt" in case.xml and bool(case.halt_before),
        shrunk=True,
    ),
    Known(
        "Precondition after a halt",
        "mazeplan evaluates the script of Precondition again when it was halted; BehaviorTree.CPP starts the child",
        lambda case, found: "<Precondition" in case.xml and found.category in ("order", "status"),
        shrunk=True,
    ),
    Known(
        "a condition that is skipped",
        "IfThenElse and WhileDoElse are skipped with their condition in mazeplan; BehaviorTree.CPP raises an error",
        _theirs("Something unexpected happened in IfThenElseNode|not allowed to set manually the status to IDLE"),
    ),
    Known(
        "a loop without a queue",
        "a Loop node over an entry that was never set has no values in mazeplan, over a number that one; "
        "BehaviorTree.CPP raises an error",
        _theirs("Any::cast failed because it is empty|port 'queue' must contain"),
    ),
    Known(
        "trees that are not used",
        "mazeplan checks trees that no SubTree names; BehaviorTree.CPP does not build them",
        lambda case, found: found.category == "load" and re.match(r"<text>:\d+: (?!Main)", found.ours) is not None,
    ),
    Known(
        "assignments to what is no entry",
        "mazeplan refuses 5 := 3 when the file is read, BehaviorTree.CPP when the script runs",
        _ours("expected a name on the blackboard to the left of it"),
    ),
    Known(
        "literals of a SubTree",
        "mazeplan checks the literals given to a SubTree against the ports that read them when the file is read",
        lambda case, found: (
            found.category == "load" and re.search("got .*, expected .*; inside, .* reads {", found.ours) is not None
        ),
    ),
    Known(
        "loops without end",
        "with tickOnce, Repeat and RetryUntilSuccessful with -1 never return in BehaviorTree.CPP while their child "
        "ends at once; in mazeplan they do one round a tick",
        lambda case, found: case.once and (found.theirs == "endless" or '"-1"' in case.xml),
        shrunk=True,
    ),
    Known(
        "a condition that has finished",
        "IfThenElse and WhileDoElse tick their condition again without a reset in BehaviorTree.CPP: a stateful leaf "
        "returns its old result, and preconditions are not evaluated",
        _stuck_condition,
        shrunk=True,
    ),
    Known(
        "failure_count of 0",
        "Parallel fails in mazeplan with failure_count failures or more, in BehaviorTree.CPP only with just as many",
        lambda case, found: "<Parallel" in case.xml and "failure_count=" in case.xml and "=FAILURE" in found.ours,
        shrunk=True,
    ),
    Known(
        "Sleep after a halt",
        "Sleep ends at once in BehaviorTree.CPP if it was halted shortly before: its timer runs in a thread",
        lambda case, found: (
            "<Sleep" in case.xml
            and ("SUCCESS" in found.theirs or (bool(case.halt_before) and "_onSuccess" in case.xml))
        ),
        shrunk=True,
    ),
    Known(
        "an entry that was never set",
        "the name alone of an entry that only a port names is no error in scripts of BehaviorTree.CPP",
        _never_set,
        shrunk=True,
    ),
    Known(
        "SetBlackboard loses text",
        "BehaviorTree.CPP leaves an entry empty that SetBlackboard sets to text, if ports have declared no type for it",
        lambda case, found: (
            re.search("<SetBlackboard value=\"([^{]|{word|{text)|<SetBlackboard.*'", case.xml) is not None
        ),
        shrunk=True,
    ),
    Known(
        "text for ports of any type",
        "BehaviorTree.CPP cannot set an entry to text if WasEntryUpdated or its kin name it in a port",
        _theirs("convertFromString for this type"),
    ),
    Known(
        "types of ports",
        "mazeplan's blackboard entries have no declared type, so ports of different types may name one key; each value "
        "is checked when it is read",
        lambda case, found: (
            re.search(TYPES, found.theirs) is not None
            or ("Can't convert string" in found.theirs and "[Typed]" not in found.theirs)
        ),
    ),
)


def examined(case: Case, runner: Runner) -> tuple[Difference | None, Known | None]:
    """The first difference of a case, and why it is known."""
    theirs = runner.ask(case.asked())
    try:
        mine: Record = ours(case)
    except Exception as problem:  # whatever it is, it is a finding
        found = Difference("crash", None, "runs", f"{type(problem).__name__}: {problem}")
        return found, None
    found = difference(theirs, mine)
    return found, None if found is None else _known(case, found, shrunk=False)


def _known(case: Case, found: Difference, shrunk: bool) -> Known | None:
    return next((known for known in KNOWN if known.shrunk == shrunk and known.holds(case, found)), None)


# -- shrinking --------------------------------------------------------------------------------------------------------


def shrunk(case: Case, found: Difference, runner: Runner) -> tuple[Case, Difference]:
    """The smallest case found that differs in the same category, and is not known."""
    tries, smaller = 0, True
    while smaller:
        smaller = False
        for candidate in _smaller(case):
            tries += 1
            if tries > MOST_TRIES:
                return case, found
            now, known = examined(candidate, runner)
            if now is not None and known is None and _kind(now) == _kind(found):
                case, found, smaller = candidate, now, True
                break
    return case, found


def _kind(found: Difference) -> str:
    """What must stay while a difference is shrunk: the category, and the words of an error without what they name."""
    if found.category not in ("load", "error"):
        return found.category
    words = [_words(text.split("] ", 1)[-1]) for text in (found.theirs, found.ours)]
    return f"{found.category} {words}"


def _words(message: str) -> str:
    """A message without places and what it quotes."""
    for noise in (r"^<text>:\d+: ([^:]*: )?", r"\[.*?\]", r"'.*?'", r"\S*[^a-zA-Z ,.]\S*"):
        message = re.sub(noise, "", message)
    return " ".join(message.split())[:50]


def _smaller(case: Case) -> Iterator[Case]:
    if case.ticks > 1:
        yield replace(case, ticks=case.ticks // 2)
        yield replace(case, ticks=case.ticks - 1)
    if case.halt_before:
        yield replace(case, halt_before=case.halt_before[:-1])
        yield replace(case, halt_before=case.halt_before[1:])
    for i in range(len(case.sets)):
        yield replace(case, sets=case.sets[:i] + case.sets[i + 1 :])
    root = etree.fromstring(case.xml)
    for i, element in enumerate(root.iter()):
        if element is root:
            continue
        for change in (_removed, *(lambda e, k=k: _hoisted(e, k) for k in range(len(element)))):
            copy = deepcopy(root)
            if change(list(copy.iter())[i]):
                yield _with(case, copy)
        for name in element.attrib:
            if name == "ID":
                continue
            values = _shorter(element.get(name)) if name != "script" else _fewer(element.get(name))
            for value in (None, *values) if name not in NEEDED else values:
                copy = deepcopy(root)
                attributes = list(copy.iter())[i].attrib
                if value is None:
                    del attributes[name]
                else:
                    attributes[name] = value
                yield _with(case, copy)
    for key in case.board:
        yield replace(case, board={k: v for k, v in case.board.items() if k != key})


def _with(case: Case, root: Element) -> Case:
    return replace(case, xml=etree.tostring(root, encoding="unicode"))


def _removed(element: Element) -> bool:
    element.getparent().remove(element)
    return True


def _hoisted(element: Element, k: int) -> bool:
    if element.tag == "BehaviorTree":
        return False
    element.getparent().replace(element, element[k])
    return True


def _shorter(text: str) -> Iterator[str]:
    """A text without one of its words."""
    words = re.findall(r"\s+|'[^']*'|[A-Za-z0-9_.@]+|:=|[<>=!+\-*/]=|&&|\|\||\.\.|.", text, re.DOTALL)
    if len(words) > 1:
        for i in range(len(words)):
            for n in (4, 3, 2, 1):
                if i + n <= len(words) and n < len(words):
                    yield "".join(words[:i] + words[i + n :])


def _fewer(letters: str) -> Iterator[str]:
    for i in range(len(letters) if len(letters) > 1 else 0):
        yield letters[:i] + letters[i + 1 :]


# -- the run --------------------------------------------------------------------------------------------------------


def signature(case: Case, found: Difference) -> str:
    """Differences of one signature are shown once."""
    root = etree.fromstring(case.xml)
    kinds = {e.tag for e in root.iter()} - {"root", "BehaviorTree"}
    marks = {a for e in root.iter() for a in e.attrib if a.startswith("_")}
    return " ".join((found.category, *sorted(kinds | marks)))


def run(arguments: argparse.Namespace) -> int:
    """Examine the seeds, print what differs, return the exit status."""
    runner = Runner(arguments.runner)
    only = frozenset(arguments.only.split(",")) if arguments.only else KINDS - frozenset(arguments.without.split(","))
    categories, knowns = Counter[str](), Counter[str]()
    shown: dict[str, list[tuple[Case, Difference]]] = defaultdict(list)
    for seed in range(arguments.seed, arguments.seed + arguments.count):
        case = random_case(seed, only, arguments.once)
        found, known = examined(case, runner)
        if found is None:
            categories["same"] += 1
        elif known is not None:
            knowns[known.name] += 1
        else:
            if len(shown) < arguments.shrink:
                case, found = shrunk(case, found, runner)
                known = _known(case, found, shrunk=True)
            if known is not None:
                knowns[known.name] += 1
                continue
            categories[found.category] += 1
            shown[signature(case, found)].append((case, found))
    runner.close()
    for name, cases in sorted(shown.items(), key=lambda item: -len(item[1]))[: arguments.shrink]:
        case, found = min(cases, key=lambda pair: len(pair[0].xml))
        print(f"\n== {name} ({len(cases)} times, seeds {', '.join(str(c.seed) for c, _ in cases[:5])})")
        print(f"{found}\nticks={case.ticks} halt_before={case.halt_before} sets={case.sets} board={case.board}")
        print(case.xml.strip())
    print(
        "\nseeds", arguments.seed, "to", arguments.seed + arguments.count - 1, dict(categories), "known", dict(knowns)
    )
    return 0 if set(categories) <= {"same"} else 1


def main(arguments: list[str] | None = None) -> int:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=20000, help="number of trees (default 20000)")
    parser.add_argument("--seed", type=int, default=1, help="seed of the first tree (default 1)")
    parser.add_argument("--runner", help="the program of tools/btcpp (default: $BTCPP_RUNNER)")
    parser.add_argument("--shrink", type=int, default=40, help="kinds of differences to shrink and show (default 40)")
    parser.add_argument("--only", default="", help="kinds of nodes and conditions that may come, with commas")
    parser.add_argument("--without", default="", help="kinds that do not come, with commas")
    parser.add_argument("--once", action="store_true", help="compare with tickOnce, not tickExactlyOnce")
    return run(parser.parse_args(arguments))


if __name__ == "__main__":
    sys.exit(main())
