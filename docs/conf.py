"""The documentation as a site: `make docs`. Nothing is fetched, neither when it is built nor when it is read."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

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


def command_pages(app: Any) -> None:
    """Write commands/*.md, a page for each command, from the program's own help."""
    from typer.main import get_command

    from mazeplan.apps.cli.app import app as commands

    folder = Path(app.srcdir) / "commands"
    folder.mkdir(exist_ok=True)
    group: Any = get_command(commands)  # typer promises a command; with several of them it is a group
    for name, command in group.commands.items():
        text = "\n".join(_command(f"mazeplan {name}", command, 1))
        page = folder / f"{name}.md"
        if not page.exists() or page.read_text(encoding="utf-8") != text:
            page.write_text(text, encoding="utf-8")


def _command(path: str, command: Any, level: int) -> list[str]:
    """A command's heading, what it does, its parameters, and its own commands."""
    lines = [f"{'#' * level} {path}", "", *(command.help or "").splitlines(), ""]
    if getattr(command, "commands", None):
        return lines + [
            line for name, inner in command.commands.items() for line in _command(f"{path} {name}", inner, 2)
        ]
    lines += ["| parameter | default | meaning |", "|---|---|---|"]
    for parameter in command.params:
        names = ", ".join(f"`{name}`" for name in (*parameter.opts, *parameter.secondary_opts))
        default = parameter.default
        shown = "" if default is None or callable(default) or default is False or default == () else f"`{default}`"
        meaning = (getattr(parameter, "help", None) or "").replace("|", "\\|").replace("<", "&lt;")
        lines.append(f"| {names} | {shown} | {meaning} |")
    return [*lines, ""]


def figures_page(app: Any) -> None:
    """Write figures.md, the tables of all figures, from history.json."""
    folder = Path(app.srcdir)
    lines = [
        "# All figures",
        "",
        "From docs/history.json, which tools/bench.py writes; [benchmarks](benchmarks.md) is the",
        "short page.",
        "",
    ]
    for section in json.loads((folder / "history.json").read_text(encoding="utf-8")).values():
        gone = " The program of this section has left." if section.get("gone") else ""
        lines += [
            f"## {section['title']}",
            "",
            f"{section['date']}, `{section['command']}`, {section['machine']}.{gone}",
            "",
        ]
        lines += ["\n\n".join(section["notes"]), ""]
        for table in section["tables"]:
            lines += [table["caption"], "", f"| {' | '.join(table['columns'])} |", "|---" * len(table["columns"]) + "|"]
            lines += [f"| {' | '.join(row)} |" for row in table["rows"]]
            lines.append("")
    text = "\n".join(lines)
    page = folder / "figures.md"
    if not page.exists() or page.read_text(encoding="utf-8") != text:
        page.write_text(text, encoding="utf-8")


def setup(app: Any) -> None:
    """Called by Sphinx."""
    app.connect("builder-inited", figures_page)
    app.connect("builder-inited", command_pages)
    app.connect("source-read", within_the_site)
    app.connect("autodoc-process-docstring", as_markup)
