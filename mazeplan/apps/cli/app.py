"""The tree of commands."""

from __future__ import annotations

from typing import Annotated

import typer

from mazeplan import __version__
from mazeplan.apps.cli import behavior, calibrate, data, effect, log, map, model, new, policy, rig
from mazeplan.apps.cli.collect import collect
from mazeplan.apps.cli.compare import compare
from mazeplan.apps.cli.diagnose import diagnose
from mazeplan.apps.cli.doctor import doctor
from mazeplan.apps.cli.evaluate import evaluate
from mazeplan.apps.cli.help import context_settings, with_help
from mazeplan.apps.cli.improve import improve
from mazeplan.apps.cli.learn import learn
from mazeplan.apps.cli.navigate import navigate
from mazeplan.apps.cli.report import report
from mazeplan.apps.cli.view import view

app = typer.Typer(
    name="mazeplan", no_args_is_help=True, pretty_exceptions_enable=False, rich_markup_mode=None,
    context_settings=context_settings(),
)  # fmt: skip


def _print_version(wanted: bool) -> None:
    if wanted:
        print(f"mazeplan {__version__}")
        raise typer.Exit


Version = Annotated[bool, typer.Option("--version", callback=_print_version, is_eager=True, help="Print the version.")]


@app.callback()
def options(version: Version = False) -> None:
    """Plan, learn and navigate a ball through a circular maze on a tilting plate."""


for command in (navigate, evaluate, collect, learn, model.score, compare, diagnose, improve, report, view, doctor):
    app.command()(command)
for group in (map, log, behavior, rig, model, policy, effect, calibrate, data, new):
    app.add_typer(group.app, name=group.__name__.rpartition(".")[2])
with_help(app)
