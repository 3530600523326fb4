"""The documentation as a site: `make docs`. Nothing is fetched, neither when it is built nor when it is read."""

from __future__ import annotations

import re
import sys
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parent))
import generate

project = "mazeplan"
author = copyright = "the mazeplan authors"
extensions = ["myst_parser", "sphinx.ext.autodoc"]
exclude_patterns = ["_build"]
html_theme = "furo"
html_title = "mazeplan"
html_copy_source = False
html_show_sphinx = False
smartquotes = False
html_theme_options = {"footer_icons": []}
pygments_style = "friendly"
myst_enable_extensions = ["colon_fence"]
myst_heading_anchors = 3
autodoc_member_order = "bysource"
autodoc_typehints = "signature"
autodoc_preserve_defaults = True
autodoc_default_options = {"members": True}
autodoc_type_aliases = {"Array": "Array"}
maximum_signature_line_length = 100

FIELD = re.compile(r"\w+(, \w+)*( \([^)]*\))?:\s")  # a line of a docstring about an argument or field
ELSEWHERE = {
    "../BENCHMARKS.md": "benchmarks.md",
    "../CHANGELOG.md": "changes.md",
    "../CONTRIBUTING.md": "contributing.md",
}


def within_the_site(app: Any, name: str, source: list[str]) -> None:
    """Links to files above docs/, as they are right in the repository, lead to the pages that show those files."""
    for path, page in ELSEWHERE.items():
        source[0] = source[0].replace(f"]({path}", f"]({page}")


def as_markup(app: Any, what: str, name: str, obj: Any, options: Any, lines: list[str]) -> None:
    """Docstrings are plain text with `code` in it. This keeps what Sphinx would read as markup, tables as they are,
    and a line for each argument."""
    out: list[str] = []
    for paragraph in "\n".join(lines).split("\n\n"):
        rows = paragraph.strip("\n").split("\n")
        if any(re.search(r"^ |\S {2,}\S", row) for row in rows):
            out += ["::", "", *(f"  {row}" for row in rows), ""]
        elif FIELD.match(rows[0]) and len(rows) > 1:
            out += [*(f"| {_escaped(row)}" if FIELD.match(row) else f"  {_escaped(row)}" for row in rows), ""]
        else:
            out += [*(_escaped(row) for row in rows), ""]
    lines[:] = out


def _escaped(row: str) -> str:
    parts = re.split(r"(`[^`]+`)", row)
    return "".join(f"`{p}`" if p.startswith("`") else re.sub(r"([*_|\\])", r"\\\1", p) for p in parts)


def setup(app: Any) -> None:
    """Called by Sphinx."""
    app.connect("builder-inited", lambda app: generate.pages(Path(app.srcdir)))
    app.connect("source-read", within_the_site)
    app.connect("autodoc-process-docstring", as_markup)
