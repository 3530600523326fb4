"""The tree of commands, and the class of each command."""

from __future__ import annotations

import re
import shutil
from collections.abc import Iterator
from typing import Annotated, Any

import typer
from typer.core import TyperCommand

from mazeplan import __version__
from mazeplan.apps.cli import behavior, calibrate, log, map, model, new, rig
from mazeplan.apps.cli.doctor import doctor
from mazeplan.apps.cli.learning import collect, diagnose, improve, learn, policy_app
from mazeplan.apps.cli.navigate import evaluate, navigate, view
from mazeplan.apps.cli.options import check_outputs
from mazeplan.apps.cli.output import say

WIDEST = 120  # columns of a help text; longer lines are hard to read
NAMED = re.compile(r"[a-z]\w*=[^=]+")  # a value of --columns; a log has no such name
app = typer.Typer(
    name="mazeplan", no_args_is_help=True, pretty_exceptions_enable=False, rich_markup_mode=None,
    context_settings={
        "help_option_names": ["-h", "--help"],
        "max_content_width": min(shutil.get_terminal_size((80, 24)).columns, WIDEST),
    },
)  # fmt: skip


class Command(TyperCommand):
    """A command. Before it begins, it checks that no output is an input."""

    def invoke(self, ctx: Any) -> Any:
        """Run the command. Notes on an exception are lines of their own."""
        check_outputs(ctx)
        try:
            return super().invoke(ctx)
        except BaseException as problem:
            for note in getattr(problem, "__notes__", ()):
                say(note)
            raise

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Take several values after one `--columns`, as if each had the option."""
        spread: list[str] = []
        for word in args:
            if NAMED.fullmatch(word) and spread[-2:-1] == ["--columns"]:
                spread.append("--columns")
            spread.append(word)
        return super().parse_args(ctx, spread)


def _commands(group: typer.Typer) -> Iterator[Any]:
    yield from group.registered_commands
    for inner in group.registered_groups:
        if inner.typer_instance is not None:
            yield from _commands(inner.typer_instance)


def _print_version(wanted: bool) -> None:
    if wanted:
        print(f"mazeplan {__version__}")
        raise typer.Exit


Version = Annotated[bool, typer.Option("--version", callback=_print_version, is_eager=True, help="Print the version.")]


@app.callback()
def options(version: Version = False) -> None:
    """Plan, learn and navigate a ball through a circular maze on a tilting plate."""


GROUPS = {"map": map.app, "log": log.app, "behavior": behavior.app, "rig": rig.app, "model": model.app}
GROUPS |= {"effect": model.effect_app, "calibrate": calibrate.app, "data": log.data_app, "new": new.app}
for command in (navigate, evaluate, collect, learn, model.score, model.compare, diagnose, improve):
    app.command()(command)
for command in (log.report, view, doctor):
    app.command()(command)
for name, group in {**GROUPS, "policy": policy_app}.items():
    app.add_typer(group, name=name)
for command in _commands(app):
    command.cls = Command
