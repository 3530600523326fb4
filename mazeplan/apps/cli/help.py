"""The help text of a command: what it does, its arguments and options, and an example at the end."""

from __future__ import annotations

import re
import shutil
from collections.abc import Iterator
from typing import Any

import typer
from typer.core import TyperCommand

from mazeplan.apps.cli.option_checks import check_outputs

WIDEST = 120  # columns; longer lines are hard to read
NAMED = re.compile(r"[a-z]\w*=[^=]+")  # a value of --columns; a log has no such name
SETTINGS: dict[str, Any] = {"help_option_names": ["-h", "--help"]}
HELP = {  # what it does in one line of 50 characters, and an example
    "navigate": ("Bring the ball from one ring to another.", "mazeplan navigate --from ring1 --to ring5"),
    "evaluate": ("Run many navigations, and summarise them.", "mazeplan evaluate --rig toy --runs 16 --workers 2"),
    "collect": (
        "Excite a rig with random sines, and write a log.",
        "mazeplan collect --rig toy --rings --seconds 600 -o runs/toy.mcap",
    ),
    "learn": ("Fit the model of a rig to its logs.", "mazeplan learn runs/toy.mcap -o runs/model"),
    "score": ("Judge how well a model predicts a log.", "mazeplan score toy runs/toy.mcap"),
    "compare": ("Compare kinds of models, ring by ring.", "mazeplan compare runs/toy.mcap --ring 2"),
    "diagnose": (
        "Find the physical effect that a model lacks.",
        "mazeplan diagnose runs/toy.mcap --model toy -o runs/diagnosis",
    ),
    "improve": (
        "Collect, diagnose, update the model, and navigate.",
        "mazeplan improve --rig runs/leaning.yaml --rounds 2 -o runs/improved",
    ),
    "report": (
        "Draw runs, models and diagnoses into one HTML file.",
        "mazeplan report runs/a.mcap -o runs/report.html",
    ),
    "view": ("Open the page: drive a rig, or show logs.", "mazeplan view"),
    "doctor": ("Show what is installed, and how to add the rest.", "mazeplan doctor"),
    "map check": ("Check maps, and name the line of each problem.", "mazeplan map check maps/mine.yaml"),
    "map show": ("Draw a map, a route, or the trail of a run.", "mazeplan map show cme --route -o maze.png"),
    "map route": ("Find the fastest expected route.", "mazeplan map route cme --from ring1 --close 1-2@45"),
    "map learn": ("Learn rings and openings from logs.", "mazeplan map learn runs/toy.mcap -o learned.yaml"),
    "log info": ("Summarise a run log.", "mazeplan log info runs/a.mcap"),
    "log export": ("Write the ticks of a run log as CSV.", "mazeplan log export runs/a.mcap -o runs/a.csv"),
    "log replay": ("Run the tree again on a recorded run.", "mazeplan log replay runs/a.mcap"),
    "behavior check": ("Check trees, and name the line of each problem.", "mazeplan behavior check mine.xml --map cme"),
    "behavior show": ("Show a tree as text or picture.", "mazeplan behavior show navigate"),
    "behavior list": ("List the nodes of trees, and their ports.", "mazeplan behavior list"),
    "behavior palette": ("Write the leaves for the palette of Groot2.", "mazeplan behavior palette -o palette.xml"),
    "rig list": ("List the rigs, and the settings of a simulated rig.", "mazeplan rig list"),
    "rig check": ("Check that a rig keeps the rules of every rig.", "mazeplan rig check toy"),
    "model list": ("List the packaged models.", "mazeplan model list"),
    "model show": ("Show plate, camera and effects of a model.", "mazeplan model show toy"),
    "policy train": ("Train a network that imitates the planner.", "mazeplan policy train --rig toy -o runs/policy"),
    "effect list": ("List the physical effects.", "mazeplan effect list"),
    "effect show": ("Show formula, source and parameters of an effect.", "mazeplan effect show viscous_friction"),
    "calibrate camera": (
        "Calibrate the camera above the plate.",
        "mazeplan calibrate camera --rig hardware --boards boards/",
    ),
    "calibrate tilt": ("Calibrate the tilt sensor and the servos.", "mazeplan calibrate tilt --rig hardware"),
    "data import-cme": (
        "Recover the data of the published model files.",
        "mazeplan data import-cme CircularMaze/Models -o runs/cme",
    ),
    "new map": ("Write a copy of a packaged map, to be changed.", "mazeplan new map cme -o maps/mine.yaml"),
    "new tree": ("Write a copy of a packaged tree, to be changed.", "mazeplan new tree navigate -o mine.xml"),
    "new rig": ("Write a folder with a rig of your own to start from.", "mazeplan new rig my_rig"),
}


class Command(TyperCommand):
    """A command whose help names arguments as they are typed.

    Before it begins, it checks that no output is an input."""

    def invoke(self, ctx: Any) -> Any:
        """Run the command."""
        check_outputs(ctx)
        return super().invoke(ctx)

    def collect_usage_pieces(self, ctx: Any) -> list[str]:
        """`[OPTIONS]` and the arguments: LOG; LOG... if several are allowed; [LOG] if it is optional."""
        pieces = [self.options_metavar] if self.options_metavar else []
        for parameter in self.get_params(ctx):
            if parameter.param_type_name == "argument":
                name = f"{parameter.metavar or parameter.name}{'...' * (parameter.nargs != 1)}"
                pieces.append(name if parameter.required else f"[{name}]")
        return pieces

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Take several values after one `--columns`, as if each had the option."""
        spread: list[str] = []
        for word in args:
            if NAMED.fullmatch(word) and spread[-2:-1] == ["--columns"]:
                spread.append("--columns")
            spread.append(word)
        return super().parse_args(ctx, spread)

    def format_options(self, ctx: Any, formatter: Any) -> None:
        """Write arguments and options."""
        rows: dict[str, list[tuple[str, str]]] = {"Arguments": [], "Options": []}
        for parameter in self.get_params(ctx):
            record = parameter.get_help_record(ctx)
            if record is None:
                continue
            if parameter.param_type_name == "argument":
                rows["Arguments"].append((parameter.metavar or parameter.name or "", record[1]))
            else:
                rows["Options"].append(record)
        for title, found in rows.items():
            if found:
                with formatter.section(title):
                    formatter.write_dl(found)

    def format_epilog(self, ctx: Any, formatter: Any) -> None:
        """Write the example."""
        if self.epilog:
            with formatter.section("Example"):
                formatter.write(f"{'':{formatter.current_indent}}{self.epilog}\n")


def context_settings() -> dict[str, Any]:
    """Settings of typer: -h as well as --help, and help as wide as the terminal, up to WIDEST."""
    return {**SETTINGS, "max_content_width": min(shutil.get_terminal_size((80, 24)).columns, WIDEST)}


def with_help(app: typer.Typer) -> None:
    """Give each command its class, its line in lists of commands, and its example."""
    for path, command in _commands(app, ()):
        command.cls = Command
        command.short_help, command.epilog = HELP[path]


def _commands(app: typer.Typer, above: tuple[str, ...]) -> Iterator[tuple[str, Any]]:
    for command in app.registered_commands:
        name = command.name or str(getattr(command.callback, "__name__", "")).replace("_", "-")
        yield " ".join((*above, name)), command
    for group in app.registered_groups:
        if group.typer_instance is not None:
            yield from _commands(group.typer_instance, (*above, str(group.name)))
