"""Checks the licences of all packages that mazeplan or an extra brings, in an environment with all extras.

Usage: python tools/licences.py. Prints package, version and licence; exit status 1: a package of the base install is
under GPL or AGPL, or the metadata of a package names no licence.
"""

from __future__ import annotations

from dependencies import BASE, UNKNOWN, Dependency, closure, copyleft, requirements


def groups() -> dict[str, list[Dependency]]:
    """{"base" or extra: all that it brings, an extra without what the base install has}."""
    wanted = requirements()
    base = closure(wanted[BASE])
    found = {BASE: list(base.values())}
    for extra, group in wanted.items():
        if extra != BASE:
            found[extra] = [one for name, one in closure(group).items() if name not in base]
    return {name: sorted(group, key=lambda one: one.name.lower()) for name, group in found.items()}


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
    for name, group in found.items():
        for one in group:
            print(f"{name:9s} {one.name} {one.version or 'not installed'}: {one.licence}")
    if bad := problems(found):
        raise SystemExit("\n".join(bad))


if __name__ == "__main__":
    main()
