"""The tree of commands."""

from __future__ import annotations

import typer

app = typer.Typer(
    name="mazeplan",
    help="Plan, learn and navigate a ball through a circular maze on a tilting plate.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)
