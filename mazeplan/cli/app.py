"""The tree of commands."""

from __future__ import annotations

from typing import Annotated

import typer

from mazeplan import __version__
from mazeplan.cli import behavior, calibrate, data, effect, learn, log, map, new, rig
from mazeplan.cli.collect import collect
from mazeplan.cli.compare import compare
from mazeplan.cli.diagnose import diagnose
from mazeplan.cli.doctor import doctor
from mazeplan.cli.improve import improve
from mazeplan.cli.navigate import evaluate, navigate
from mazeplan.cli.record import record
from mazeplan.cli.report import report
from mazeplan.cli.view import view

app = typer.Typer(
    name="mazeplan",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)


def _version(wanted: bool) -> None:
    if wanted:
        print(f"mazeplan {__version__}")
        raise typer.Exit


@app.callback()
def whole(
    version: Annotated[bool, typer.Option("--version", callback=_version, is_eager=True, help="Print it and exit.")] = (
        False
    ),
) -> None:
    """Plan, learn and navigate a ball through a circular maze on a tilting plate."""


app.command()(navigate)
app.command()(evaluate)
app.command()(collect)
app.command()(learn.learn)
app.command()(compare)
app.command()(diagnose)
app.command()(improve)
app.command()(record)
app.command()(report)
app.add_typer(map.app, name="map")
app.add_typer(log.app, name="log")
app.add_typer(behavior.app, name="behavior")
app.add_typer(rig.app, name="rig")
app.add_typer(effect.app, name="effect")
app.add_typer(calibrate.app, name="calibrate")
app.add_typer(data.app, name="data")
app.add_typer(new.app, name="new")
app.command()(view)
app.command()(doctor)
