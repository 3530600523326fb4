"""Writes docs/licences.md: every package that mazeplan or an extra brings, with version and licence.

Usage: python tools/licences.py [FILE], in an environment with all extras that shall be listed
"""

from __future__ import annotations

import sys
from pathlib import Path

from dependencies import BASE, ROOT, UNKNOWN, Dependency, closure, copyleft, requirements

PAGE = ROOT / "docs" / "licences.md"
HEAD = """\
# Licences of dependencies

mazeplan itself is under Apache-2.0. `python tools/licences.py` writes this page from the metadata of the installed
packages. A test checks that every licence is known, and that no package of the base install is under GPL or AGPL.
Direct dependencies are bold. An extra lists what it adds to the base install."""
NOT_HERE = "not installed where this page was written"


def groups() -> dict[str, list[Dependency]]:
    """{"base" or extra: all that it brings, an extra without what the base install has}."""
    wanted = requirements()
    base = closure(wanted[BASE])
    found = {BASE: list(base.values())}
    for extra, group in wanted.items():
        if extra != BASE:
            found[extra] = [one for name, one in closure(group).items() if name not in base]
    return {name: sorted(group, key=lambda one: one.name.lower()) for name, group in found.items()}


def page(found: dict[str, list[Dependency]]) -> str:
    """The page in Markdown."""
    rows = [HEAD]
    for name, group in found.items():
        rows += [
            "",
            "## Base install" if name == BASE else f"## Extra `{name}`",
            "",
            "| package | version | licence |",
            "|---|---|---|",
        ]
        rows += [_row(one) for one in group]
    return "\n".join(rows) + "\n"


def _row(one: Dependency) -> str:
    name = f"**{one.name}**" if one.direct else one.name
    if one.version is None:
        return f"| {name} | | {NOT_HERE} |"
    return f"| {name} | {one.version.partition('+')[0]} | {one.licence.replace('|', '/')} |"


def problems(found: dict[str, list[Dependency]]) -> list[str]:
    """A line for each installed package without a known licence, and each under GPL or AGPL in the base install."""
    lines = []
    for name, group in found.items():
        for one in group:
            if one.version is not None and one.licence == UNKNOWN:
                lines.append(f"{name}: {one.name} {one.version}: its metadata names no licence")
            if name == BASE and copyleft(one.licence):
                lines.append(f"{name}: {one.name} {one.version}: {one.licence}")
    return lines


def main() -> None:
    found = groups()
    target = Path(sys.argv[1]) if len(sys.argv) > 1 else PAGE
    target.write_text(page(found), encoding="utf-8")
    print(f"wrote {target}: {len({one.name for group in found.values() for one in group})} packages")
    if bad := problems(found):
        raise SystemExit("\n".join(bad))


if __name__ == "__main__":
    main()
