"""Options and arguments of several commands, and of the long ones. Each has its help text and its check."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal

from typer import Argument, Option

from mazeplan.apps.cli.option_checks import file, folder, new_file, new_folder, number, ring

YAML, TREE = (".yaml", ".yml"), ".xml"
PORT = 8080


def output_file(help: str, *endings: str, names: tuple[str, ...] = ("-o", "--output"), chosen: bool = False) -> Any:
    """An option for a file to write: a new one, or with --force one that exists. chosen: see `file`"""
    return Option(*names, parser=file(*endings, chosen=chosen), callback=new_file, metavar="FILE", help=help)


def output_folder(help: str) -> Any:
    """An option for a folder to write: new or empty, or with --force another one."""
    return Option("-o", "--output", parser=folder, callback=new_folder, metavar="FOLDER", help=help)


# -- several commands ---------------------------------------------------------------------------------------------

AsJson = Annotated[bool, Option("--json", help="Print one JSON document on stdout.")]
Force = Annotated[bool, Option("--force", is_eager=True, help="Replace files that exist.")]  # eager: parsed first
Logs = Annotated[list[Path], Argument(metavar="LOG", help="Run logs (MCAP) or tables (CSV).")]
RunLogFile = Annotated[Path, Argument(metavar="LOG", help="Run log (MCAP).")]
Map = Annotated[str, Option("--map", metavar="MAP", help="Packaged map or YAML file.")]
MapOfLog = Annotated[
    str | None, Option("--map", metavar="MAP", help="Packaged map or YAML file. Default: the log's map, else cme.")
]
RigName = Annotated[
    str, Option("--rig", metavar="RIG", help="Rig: a name from `rig list`, a YAML file, or MODULE:CLASS.")
]
Model = Annotated[
    str | None, Option("--model", metavar="MODEL", help="Packaged model or folder. Default: the rig's own model.")
]
KnownModel = Annotated[
    str | None, Option("--model", metavar="MODEL", help="Packaged model or folder with everything known so far.")
]
EffectModule = Annotated[
    str | None, Option("--effects", metavar="MODULE:FUNCTION", help="Function that returns your own effects.")
]
Policy = Annotated[str | None, Option("--policy", metavar="DIR", help="Folder of a learned policy to follow.")]
Behavior = Annotated[str, Option("--behavior", metavar="TREE", help="Packaged behaviour tree or XML file.")]
BehaviorModule = Annotated[
    list[str] | None,
    Option("--behavior-module", metavar="MODULE", help="Python module with your own leaves; repeatable."),
]
Settings = Annotated[str | None, Option("--settings", metavar="FILE", help="YAML file of costs, gains and windows.")]
StartRing = Annotated[str, Option("--from", metavar="RING", help="Ring to start in, such as ring1.")]
GoalRing = Annotated[str, Option("--to", metavar="RING", help="Ring to reach, such as ring5, or centre.")]
StartAngle = Annotated[
    float | None,
    Option(
        "--start-angle", parser=number(-3600.0, 3600.0), metavar="DEG",
        help="Start angle in degrees. Default: 0 on a map, in a run by the seed.",
    ),
]  # fmt: skip
Balls = Annotated[
    int | None,
    Option("--balls", min=1, max=2, metavar="N", help="Number of balls, 1 or 2. Default: as in the map, else 1."),
]
Close = Annotated[
    list[str] | None,
    Option("--close", metavar="OPENING", help="Openings to avoid, such as 1-2@45,1-2@135; repeatable."),
]
Seed = Annotated[
    int, Option("--seed", min=0, metavar="N", help="Seed of every random draw; of several runs, of the first one.")
]
TimeLimit = Annotated[
    float, Option("--time-limit", parser=number(1e-3, 1e5), metavar="S", help="Time limit in s of rig time.")
]
Seconds = Annotated[
    float, Option("--seconds", parser=number(1.0, 1e5), metavar="S", help="Length of the record, s of rig time.")
]
PagePort = Annotated[
    int, Option("--port", min=0, max=65535, metavar="PORT", help="Port of the page; 0: any free port.")
]
OutputFolder = Annotated[Path, output_folder("Output folder.")]
MaybeOutputFolder = Annotated[Path | None, output_folder("Folder for logs, models and reports.")]
Report = Annotated[Path | None, output_file("Write an HTML report.", ".html", ".htm", names=("--report",))]
Columns = Annotated[
    list[str] | None,
    Option("--columns", metavar="NAME=COLUMN[:UNIT]", help="Column and unit in a table, as t=time_ms:ms; repeatable."),
]
Reference = Annotated[
    list[Path] | None,
    Option("--reference", metavar="LOG", help="Log of the same rig while its model was right; repeatable."),
]
Ring = Annotated[
    int | None, Option("--ring", parser=ring, metavar="RING", help="Use only this ring. Default: all rings.")
]
Radius = Annotated[
    float | None,
    Option("--radius", parser=number(0.002, 2.0), metavar="M", help="Track radius in m. Default: the map's."),
]
Most = Annotated[int, Option("--most", min=50, metavar="N", help="Most training rows of a Gaussian process, per ring.")]
Device = Annotated[str, Option("--device", metavar="cpu|cuda", help="Device for training: cpu or cuda (policies).")]
Rounds = Annotated[int, Option("--rounds", min=1, metavar="N", help="Number of rounds.")]
RoundRuns = Annotated[int, Option("--runs", min=1, metavar="N", help="Navigations of each round.")]
Workers = Annotated[
    int | None,
    Option("--workers", min=1, metavar="N", help="Processes. Default: the cores for a simulated rig, else 1."),
]

# -- navigate, evaluate -------------------------------------------------------------------------------------------

Via = Annotated[
    list[str] | None,
    Option("--via", metavar="RINGS", help="Rings to visit before the goal, in order, such as ring3,ring2; repeatable."),
]
Video = Annotated[Path | None, output_file("Write a film of the run.", ".gif", names=("--video",), chosen=True)]
RunLog = Annotated[Path | None, output_file("Write a run log (MCAP).", ".mcap", names=("--log",))]
Page = Annotated[bool, Option("--view", help="Show and operate the run on a page in the browser.")]
Runs = Annotated[
    int | None, Option("--runs", min=1, metavar="N", help="Number of runs. Default: 16; 10 per fault with --faults.")
]
Dask = Annotated[
    str | None, Option("--dask", metavar="ADDRESS", help="Run on a Dask scheduler, such as tcp://host:8786.")
]
Store = Annotated[
    Path | None,
    Option("--store", parser=folder, metavar="DIR", help="Keep runs in this folder (JSON lines); skip kept runs."),
]
NoDeadline = Annotated[bool, Option("--no-deadline", help="Let plans take any time, for repeatable results.")]
Compare = Annotated[
    tuple[Path, Path] | None,
    Option(
        "--compare", metavar="FILE FILE",
        help="Run nothing: compare two documents of --json, A and B, seed by seed, with 95 % intervals.",
    ),
]  # fmt: skip
Faults = Annotated[
    str | None, Option("--faults", metavar="FILE", help="YAML file of faults to inject, or all for each kind.")
]

# -- collect, learn, compare, diagnose ----------------------------------------------------------------------------

CollectedLog = Annotated[Path, output_file("Run log (MCAP) to write.", ".mcap")]
FirstRing = Annotated[str, Option("--ring", metavar="RING", help="Ring to start in, such as ring1.")]
AllRings = Annotated[bool, Option("--rings", help="Visit all rings in turn; drive the ball to the next one.")]
Place = Annotated[bool, Option("--place", help="With --rings: a person places the ball in each ring, every 20 s.")]
Tilt = Annotated[
    float | None,
    Option("--tilt", parser=number(0.01, 90.0), metavar="DEG", help="Largest tilt in degrees. Default: the map's."),
]
HighestHz = Annotated[
    float,
    Option("--highest-hz", parser=number(1e-3, 100.0), metavar="HZ", help="Highest frequency of the sines in Hz."),
]
Kind = Annotated[
    Literal["p", "pi", "np", "sp"],
    Option(
        "--kind",
        metavar="p|pi|np|sp",
        help="Ball model. p: nominal; pi: fitted effects; sp: fitted effects and a Gaussian process; "
        "np: a Gaussian process alone.",
    ),
]
TestLogs = Annotated[
    list[Path] | None,
    Option("--test", metavar="LOG", help="Log or table to test on; repeatable. Default: every fourth 5 s block."),
]
CompareKinds = Annotated[
    str, Option("--kinds", metavar="KINDS", help="Kinds to compare, of rf, p, pi, np, sp; separated by commas.")
]
Declare = Annotated[
    list[str] | None,
    Option("--declare", metavar="EFFECT.PARAM=VALUE", help="Known parameter; with --system also EFFECT; repeatable."),
]
TestLog = Annotated[Path | None, Option("--test", metavar="LOG", help="Further record to score the model on.")]
System = Annotated[
    str,
    Option("--system", metavar="SYSTEM", help="ring: ball in its ring; emps: drive axis (.mat); MODULE:CLASS: yours."),
]
