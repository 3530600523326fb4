"""Versions of this program and of the packages that affect its results, to compare them with another machine."""

from __future__ import annotations

import hashlib
import platform
from collections.abc import Iterator, Mapping
from functools import cache
from importlib.metadata import version
from pathlib import Path

from mazeplan.core import resources

PACKAGES = ("mazeplan", "numpy", "scipy", "numba", "mujoco")
NOT_FOR_RESULTS = {"cli", "view", "report", "_share", "__pycache__"}  # folders of the package
KINDS = {".py", ".yaml", ".xml", ".npz", ".png"}


@cache
def program() -> Mapping[str, str]:
    """{package: version}, `python`, and `sources`: a digest of all files of the package that affect results."""
    digest = hashlib.sha256()
    for name, path in sorted(_files()):
        content = path.read_bytes()
        digest.update(f"{name} {len(content)}\n".encode())
        digest.update(content)
    versions = {name: version(name) for name in PACKAGES}
    return {**versions, "python": ".".join(platform.python_version_tuple()[:2]), "sources": digest.hexdigest()[:16]}


def _files() -> Iterator[tuple[str, Path]]:
    """Names and paths of the files that affect results. Names are the same in a checkout and in an installed wheel."""
    for path in resources.PACKAGE.rglob("*"):
        inside = path.relative_to(resources.PACKAGE)
        if path.suffix in KINDS and not NOT_FOR_RESULTS & set(inside.parts):
            yield inside.as_posix(), path
    for kind in ("maps", "behaviors"):
        for path in resources.share(kind).iterdir():
            if path.suffix in KINDS:
                yield f"{kind}/{path.name}", path


def program_mismatch(ours: Mapping[str, str], theirs: Mapping[str, str]) -> str:
    """In words, in what another machine's program differs from ours; empty if in nothing."""
    differing = [name for name in ours if theirs.get(name) != ours[name]]
    if differing == ["sources"]:
        return f"mazeplan {ours['mazeplan']} of other sources"
    others = [f"{name} {theirs.get(name, 'none')} instead of {ours[name]}" for name in differing if name != "sources"]
    return ", ".join(others)
