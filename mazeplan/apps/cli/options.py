"""Options and arguments of several commands, and of the long ones. Each has its help text and its check.

A check runs while typer reads the command line, before any work begins. One rule holds for all outputs: an output
replaces a file only with --force, and never an input of the same command. An option for a new file or folder has
`callback=new_output`, and its command has `force: Force`; then `check_outputs` compares all paths.
"""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Annotated, Any, Literal

from typer import Argument, BadParameter, CallbackParam, Context, Option

from mazeplan.core.errors import InputError
from mazeplan.core.whole_file import in_dev, is_stream

YAML, TREE = (".yaml", ".yml"), ".xml"
PORT = 8080
PATHS = {"DIR", "FILE", "FOLDER", "INPUT", "LOG", "MAP", "MODEL", "OUT", "RIG", "TREE"}  # metavars of files, folders
_OUTPUTS = "mazeplan.outputs"


# -- checks ----------------------------------------------------------------------------------------------------------


def number(least: float, most: float) -> Callable[[str], float]:
    """Parser of a number from `least` to `most`."""

    def parse(text: str) -> float:
        try:
            value = float(text)
        except ValueError:
            value = math.nan
        if not least <= value <= most:
            raise BadParameter(f"got {str(text)!r}, expected a number from {least:g} to {most:g}")
        return value

    return parse


def ring(text: str) -> int:
    """Parser of a ring that has a channel: 2, or ring2."""
    number = text.lower().removeprefix("ring")
    if not (number.isdecimal() and number.isascii() and int(number) >= 1):
        raise BadParameter(f"got {text!r}, expected a ring such as ring2")
    return int(number)


def folder(text: str) -> Path:
    """Parser of a folder to write into."""
    path = Path(text).absolute()
    place = next(place for place in (path, *path.parents) if place.exists())
    if not text or not place.is_dir() or not os.access(place, os.W_OK):
        raise BadParameter(f"got {text!r}, expected a folder that can be made or written to")
    return Path(text)


def file(*endings: str, chosen: bool = False) -> Callable[[str], Path]:
    """Parser of a file to write, with one of the endings.

    chosen: whether the ending selects what is written; otherwise names in /dev need no ending"""

    def parse(text: str) -> Path:
        path = Path(text)
        if path.is_dir() or (path.suffix.lower() not in endings and (chosen or not in_dev(path))):
            raise BadParameter(f"got {text!r}, expected a file that ends in {', '.join(endings)}")
        folder(str(path.parent))
        return path

    return parse


def check_new(option: str, path: Path, force: bool) -> None:
    """Raises InputError for a file that exists, or a folder with files that are not hidden, unless `force` is true.

    Devices and pipes, such as /dev/null, may always be written."""
    folder = path.is_dir()
    hidden = folder and all(name.startswith(".") for name in os.listdir(path))
    if os.path.lexists(path) and not (force or hidden or is_stream(path)):
        what = "files in it" if folder else "it"
        raise InputError(f"{option}: {path} exists; expected a new name, or --force to replace {what}")


def new_output(ctx: Context, param: CallbackParam, path: Path | None) -> Path | None:
    """Check of an output: a new file, or a new or empty folder, unless --force is given. Raises InputError."""
    if path is not None:
        ctx.meta.setdefault(_OUTPUTS, set()).add(param.name)  # for `check_outputs`
        check_new(min(param.opts, key=len), path, bool(ctx.params.get("force")))
    return path


def check_outputs(ctx: Context) -> None:
    """Raises InputError for an output that is also another file of the command line, even under another name."""
    outputs, named = ctx.meta.get(_OUTPUTS, ()), list[tuple[str, str, Path]]()
    for param in ctx.command.params:
        metavar, name = str(getattr(param, "metavar", "")).partition(" ")[0], param.name or ""
        value = ctx.params.get(name)
        for text in value if isinstance(value, list | tuple) else [value]:
            if metavar in PATHS and text:
                option = metavar if param.param_type_name == "argument" else min(param.opts, key=len)
                named.append((name, option, Path(text)))
    for output, option, path in named:
        for name, other, path2 in named if output in outputs and not is_stream(path) else ():
            if name != output and os.path.realpath(path2) == os.path.realpath(path):
                raise InputError(f"{option}: {path} is the file of {other}, too; expected another name")


def listed(values: Iterable[str] | None) -> tuple[str, ...]:
    """The names of a repeatable option. Each value may have several names, separated by commas."""
    return tuple(name.strip() for text in values or () for name in text.split(","))


# -- kinds of options -------------------------------------------------------------------------------------------------


def value(name: str, metavar: str, help: str, **checks: Any) -> Any:
    """An option with a value."""
    return Option(name, metavar=metavar, help=help, **checks)


def output_file(help: str, *endings: str, names: tuple[str, ...] = ("-o", "--output"), chosen: bool = False) -> Any:
    """An option for a file to write: a new one, or with --force one that exists. chosen: see `file`"""
    return Option(*names, parser=file(*endings, chosen=chosen), callback=new_output, metavar="FILE", help=help)


def output_folder(help: str) -> Any:
    """An option for a folder to write: new or empty, or with --force another one."""
    return Option("-o", "--output", parser=folder, callback=new_output, metavar="FOLDER", help=help)


# -- several commands ---------------------------------------------------------------------------------------------

AsJson = Annotated[bool, Option("--json", help="Print one JSON document on stdout.")]
Force = Annotated[bool, Option("--force", is_eager=True, help="Replace files that exist.")]  # eager: parsed first
Logs = Annotated[list[Path], Argument(metavar="LOG", help="Run logs (MCAP) or tables (CSV).")]
RunLogFile = Annotated[Path, Argument(metavar="LOG", help="Run log (MCAP).")]
Map = Annotated[str, value("--map", "MAP", "Packaged map or YAML file.")]
MapOfLog = Annotated[str | None, value("--map", "MAP", "Packaged map or YAML file. Default: the log's map, else cme.")]
RigName = Annotated[str, value("--rig", "RIG", "Rig: a name from `rig list`, a YAML file, or MODULE:CLASS.")]
Model = Annotated[str | None, value("--model", "MODEL", "Packaged model or folder. Default: the rig's own model.")]
FirstModel = Annotated[
    Path | None,
    value("--learn", "FOLDER", "Learn a model first, from two minutes of record; use that of FOLDER.", parser=folder),
]
KnownModel = Annotated[str | None, value("--model", "MODEL", "Packaged model or folder with everything known so far.")]
EffectModule = Annotated[str | None, value("--effects", "MODULE:FUNCTION", "Function that returns your own effects.")]
Policy = Annotated[str | None, value("--policy", "DIR", "Folder of a learned policy to follow.")]
Behavior = Annotated[str, value("--behavior", "TREE", "Packaged behaviour tree or XML file.")]
BehaviorModule = Annotated[
    list[str] | None, value("--behavior-module", "MODULE", "Module with your own leaves; repeatable.")
]
Settings = Annotated[str | None, value("--settings", "FILE", "YAML file of costs, gains and windows.")]
StartRing = Annotated[str, value("--from", "RING", "Ring to start in, such as ring1.")]
GoalRing = Annotated[str, value("--to", "RING", "Ring to reach, such as ring5, or centre.")]
StartAngle = Annotated[
    float | None,
    value("--start-angle", "DEG", "Start angle in degrees. Default: by the seed.", parser=number(-3600.0, 3600.0)),
]
Balls = Annotated[int | None, value("--balls", "N", "Balls, 1 or 2. Default: as in the map.", min=1, max=2)]
Close = Annotated[list[str] | None, value("--close", "OPENING", "Openings to avoid, such as 1-2@45; repeatable.")]
Seed = Annotated[int, value("--seed", "N", "Seed of every random draw; of several runs, of the first one.", min=0)]
TimeLimit = Annotated[float, value("--time-limit", "S", "Time limit in s of rig time.", parser=number(1e-3, 1e5))]
Seconds = Annotated[float, value("--seconds", "S", "Length of the record, s of rig time.", parser=number(1.0, 1e5))]
PagePort = Annotated[int, value("--port", "PORT", "Port of the page; 0: any free port.", min=0, max=65535)]
OutputFolder = Annotated[Path, output_folder("Output folder.")]
MaybeOutputFolder = Annotated[Path | None, output_folder("Folder for logs, models and reports.")]
Report = Annotated[Path | None, output_file("Write an HTML report.", ".html", ".htm", names=("--report",))]
Columns = Annotated[
    list[str] | None, value("--columns", "NAME=COLUMN[:UNIT]", "Column and unit, as t=time_ms:ms; repeatable.")
]
Reference = Annotated[
    list[Path] | None, value("--reference", "LOG", "Log of the rig when its model was right; repeatable.")
]
Ring = Annotated[int | None, value("--ring", "RING", "Use only this ring. Default: all rings.", parser=ring)]
Radius = Annotated[float | None, value("--radius", "M", "Track radius, m. Default: map.", parser=number(0.002, 2.0))]
Most = Annotated[int, value("--most", "N", "Most training rows of a Gaussian process, per ring.", min=50)]
Device = Annotated[str, value("--device", "cpu|cuda", "Device for training: cpu or cuda (policies).")]
Rounds = Annotated[int, value("--rounds", "N", "Number of rounds.", min=1)]
RoundRuns = Annotated[int, value("--runs", "N", "Navigations of each round.", min=1)]
Workers = Annotated[int | None, value("--workers", "N", "Processes. Default: cores for a simulation, else 1.", min=1)]

# -- navigate, evaluate -------------------------------------------------------------------------------------------

Via = Annotated[
    list[str] | None, value("--via", "RINGS", "Rings to visit on the way, such as ring3,ring2; repeatable.")
]
Video = Annotated[Path | None, output_file("Write a film of the run.", ".gif", names=("--video",), chosen=True)]
RunLog = Annotated[Path | None, output_file("Write a run log (MCAP).", ".mcap", names=("--log",))]
Page = Annotated[bool, Option("--view", help="Show and operate the run on a page in the browser.")]
Runs = Annotated[int | None, value("--runs", "N", "Number of runs. Default: 16; 10 per fault with --faults.", min=1)]
Dask = Annotated[str | None, value("--dask", "ADDRESS", "Run on a Dask scheduler, such as tcp://host:8786.")]
Store = Annotated[Path | None, value("--store", "DIR", "Keep runs in this folder; skip kept runs.", parser=folder)]
NoDeadline = Annotated[bool, Option("--no-deadline", help="Let plans take any time, for repeatable results.")]
Compare = Annotated[
    tuple[Path, Path] | None, value("--compare", "FILE FILE", "Run nothing: compare two documents of --json by seed.")
]
Faults = Annotated[str | None, value("--faults", "FILE", "YAML file of faults to inject, or all for each kind.")]

# -- collect, learn, compare, diagnose ----------------------------------------------------------------------------

CollectedLog = Annotated[Path, output_file("Run log (MCAP) to write.", ".mcap")]
FirstRing = Annotated[str, value("--ring", "RING", "Ring to start in, such as ring1.")]
AllRings = Annotated[bool, Option("--rings", help="Visit all rings in turn; drive the ball to the next one.")]
Place = Annotated[bool, Option("--place", help="With --rings: a person places the ball in each ring, every 20 s.")]
Tilt = Annotated[float | None, value("--tilt", "DEG", "Largest tilt, deg. Default: map.", parser=number(0.01, 90.0))]
HighestHz = Annotated[float, value("--highest-hz", "HZ", "Highest frequency in Hz.", parser=number(1e-3, 100.0))]
Kind = Annotated[
    Literal["p", "pi", "np", "sp"],
    value("--kind", "p|pi|np|sp", "p: nominal; pi: fitted effects; sp: and a Gaussian process; np: that alone."),
]
TestLogs = Annotated[
    list[Path] | None, value("--test", "LOG", "Log to test on; repeatable. Default: every fourth 5 s.")
]
CompareKinds = Annotated[str, value("--kinds", "KINDS", "Kinds to compare, of rf, p, pi, np, sp; separated by commas.")]
Declare = Annotated[list[str] | None, value("--declare", "EFFECT.PARAM=VALUE", "Known effect; repeatable.")]
TestLog = Annotated[Path | None, value("--test", "LOG", "Further record to score the model on.")]
System = Annotated[str, value("--system", "SYSTEM", "ring; emps: drive axis (.mat); MODULE:CLASS: your own.")]
