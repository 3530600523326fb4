"""`compare`: kinds of ball models on the same data."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from mazeplan.cli.arguments import check_channel, check_folder, logged_map
from mazeplan.cli.output import print_json, say
from mazeplan.errors import InputError

if TYPE_CHECKING:
    from mazeplan.comparison import RingScores

RATES = ("auto", "smoothed", "delayed", "filtered")
KERNELS = ("auto", "rbf", "exponential")
SMOOTHINGS = ("savgol", "rts")
PICTURES = (".png", ".svg", ".pdf")


def compare(
    logs: Annotated[list[Path], typer.Argument(help="Run logs (MCAP) or tables (CSV).")],
    test: Annotated[
        list[Path] | None,
        typer.Option("--test", help="Log or table to test on (repeatable); else every fourth block of 5 s."),
    ] = None,
    map_: Annotated[
        str | None, typer.Option("--map", help="Packaged map or YAML file; default: that of the first log, else cme.")
    ] = None,
    ring: Annotated[
        int | None,
        typer.Option("--ring", min=1, help="Only this ring; where a table does not tell rings, that of all its rows."),
    ] = None,
    radius: Annotated[
        float | None, typer.Option("--radius", help="Its track radius in m, instead of the map's.")
    ] = None,
    delay: Annotated[
        float | None, typer.Option("--delay", help="Seconds that the camera is behind the tilt sensor; default: found.")
    ] = None,
    rates: Annotated[
        str,
        typer.Option(
            "--rates", help=f"How the rate of theta is taken: {', '.join(RATES)}; filtered: late, as published."
        ),
    ] = "auto",
    smoothing: Annotated[
        str, typer.Option("--smoothing", help=f"Where the table brings no derivatives: {', '.join(SMOOTHINGS)}.")
    ] = "savgol",
    kernel: Annotated[str, typer.Option("--kernel", help=f"Of the processes: {', '.join(KERNELS)}.")] = "auto",
    most: Annotated[int, typer.Option("--most", min=50, help="Training rows of a process.")] = 5000,
    device: Annotated[str, typer.Option("--device", help="cpu or cuda, for training and bands.")] = "cpu",
    curve: Annotated[
        Path | None, typer.Option("--curve", help="Draw learning curves into this PNG, SVG or PDF.")
    ] = None,
    page: Annotated[
        Path | None, typer.Option("--report", help="HTML file with tables and pictures, learning curves among them.")
    ] = None,
    bands: Annotated[
        int,
        typer.Option(
            "--bands",
            min=0,
            help="Roll-outs of each kind and ring, all doubts drawn, for bands of 90 %: 50 a window, so N / 50 windows "
            "at most; 0: none.",
        ),
    ] = 2000,
    seed: Annotated[int, typer.Option("--seed", min=0, help="Seed of all that is drawn: starts, forests, bands.")] = 0,
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON document on stdout.")] = False,
) -> None:
    """nRMSE of theta_dd and roll-out errors of rf, p, pi, np, sp (and npd), ring by ring."""
    from mazeplan.cli.arguments import positive
    from mazeplan.cli.progress import Working
    from mazeplan.cli.report import check_page, write_report
    from mazeplan.compare import compare as run
    from mazeplan.comparison import THOROUGH, CompareOptions
    from mazeplan.data.smoothing import Smoothing
    from mazeplan.data.table import read_table
    from mazeplan.models.confidence import DRAWS, ConfidenceOptions
    from mazeplan.models.fitting import FitOptions
    from mazeplan.models.gp_training import require_torch
    from mazeplan.models.samples import SampleOptions

    for option, value, allowed in (
        ("--rates", rates, RATES),
        ("--kernel", kernel, KERNELS),
        ("--smoothing", smoothing, SMOOTHINGS),
    ):
        if value not in allowed:
            raise InputError(f"{option}: got {value!r}, expected one of {', '.join(allowed)}")
    if 0 < bands < DRAWS:
        raise InputError(f"--bands: got {bands}, expected 0 (none), or {DRAWS} (those of one window) or more")
    if curve is not None:
        _check_picture(curve)  # not minutes later
    if page is not None:
        check_page("--report", page)
    require_torch()
    maze, known = logged_map(map_, logs[0])
    if ring is not None and radius is None:  # with a radius the map need not have it
        check_channel(ring, maze)
    options = CompareOptions(
        smoothing=Smoothing("rts") if smoothing == "rts" else Smoothing(window=9),
        delay=delay,
        samples=SampleOptions(ring=ring, radius=None if radius is None else positive("--radius", radius)),
        rates=rates,
        fit=FitOptions(most=most, training=replace(THOROUGH, family=kernel, device=device), seed=seed),
        curve=curve is not None or page is not None,
        bands=ConfidenceOptions(bands, device),
        seed=seed,
    )
    with Working("comparing") as shown:
        shown.tell("reading")
        tables, held = ([read_table(log) for log in group] for group in (logs, test or []))
        scores = run(
            tables, held, maze, options, openings_known=known, progress=shown.tell, advance=shown.advance, left_out=say
        )
    if curve is not None:
        _draw(scores, curve)
    document = {f"ring{score.ring}": score.document() for score in scores}
    if page is not None:
        write_report("comparison", document, page, ", ".join(log.name for log in logs))
    if as_json:
        print_json(document)
        return
    report(scores)


def report(scores: list[RingScores]) -> None:
    """The tables, as text. Where windows or blocks of time are too few to say how sure a number is, that is said."""
    from mazeplan.models.enough import TOO_FEW, enough

    kinds = list(scores[0].nrmse_test)
    print(f"{'nRMSE of theta_dd':24s}" + "".join(f"{kind:>16s}" for kind in kinds))
    for s in scores:
        cells = "".join(f"{s.nrmse_train[kind]:8.3f}/{s.nrmse_test[kind]:.3f}  " for kind in kinds)
        print(f"ring {s.ring} train/test          {cells}")
        low = "".join(f"   [{a:.3f}, {b:.3f}]" for a, b in (s.interval["nrmse_test"][kind] for kind in kinds))
        few = f"   {TOO_FEW}: {_count(s.blocks['test'], 'block')} of time"
        print(f"   95 % of the test      {low if enough(blocks=s.blocks['test']) else few}")
    print("\nmean absolute error of theta after 20 / 40 samples, rad (± half of the 95 % interval)")
    for s in scores:
        if not len(s.windows):
            print(f"ring {s.ring}  0 windows: no stretch of test rows is long enough")
            continue
        cells = "".join(f"  {kind} {_give(s, kind, '20')}/{_give(s, kind, '40')}" for kind in s.rollout)
        few = "" if _sure(s) else f" in {_count(s.blocks['windows'], 'block')} of time ({TOO_FEW} for ±)"
        print(f"ring {s.ring}  {_count(len(s.windows), 'window')}{few}, {s.windows.chosen}: {cells}")
    if any(s.confidence for s in scores):
        print("\nhow often the measured angle lies in the band of 90 % of roll-outs after 20 / 40 samples, %")
    for s in scores:
        cells = "".join(
            f"  {k} {100 * c['coverage20']:.0f}/{100 * c['coverage40']:.0f}" for k, c in s.confidence.items()
        )
        if cells:
            some = next(iter(s.confidence.values()))
            told = cells if enough(some["windows"]) else f" {TOO_FEW} for a share"
            print(f"ring {s.ring}  {some['rollouts']} roll-outs of {_count(some['windows'], 'window')}:{told}")
    notes = {name for s in scores for name, sign in zip(("beta", "gamma"), s.signs, strict=True) if sign < 0}
    for name in sorted(notes):
        print(f"note: {name} is counted the other way round in these data (gravity pulls uphill); it was turned round")
    off = [f"ring {s.ring} {1e3 * s.centre[0]:.1f}, {1e3 * s.centre[1]:.1f}" for s in scores if any(s.centre)]
    if off:
        print(f"note: the camera counts the angle about another point than the rings' centre, in mm: {'; '.join(off)}")
    s = scores[0]
    print(f"rates: {s.rates}; ball {1e3 * s.delay:.0f} ms behind the tilt")
    print(f"training rows: {', '.join(str(x.n_train) for x in scores)}")


def _give(s: RingScores, kind: str, steps: str) -> str:
    """An error with half of its 95 % interval, where there is one."""
    low, high = s.interval[steps].get(kind, (math.nan, math.nan))
    give = f" ± {0.5 * (high - low):.3f}" if math.isfinite(high - low) and _sure(s) else ""
    return f"{s.rollout[kind][steps]:.3f}{give}"


def _sure(s: RingScores) -> bool:
    """Whether a ring has windows enough, in blocks of time enough, for an interval."""
    from mazeplan.models.enough import enough

    return enough(len(s.windows), s.blocks["windows"])


def _count(n: int, what: str) -> str:
    return f"{n} {what}{'' if n == 1 else 's'}"


def _check_picture(path: Path) -> None:
    """Whether a picture could be written there. Raises InputError."""
    if path.suffix not in PICTURES or path.is_dir():
        folder = ", a folder" if path.is_dir() else ""
        raise InputError(f"--curve: got {str(path)!r}{folder}, expected a file that ends in {', '.join(PICTURES)}")
    check_folder("--curve", path.absolute().parent)


def _draw(scores: list[RingScores], path: Path) -> None:
    """Learning curves: test nRMSE over training rows, a panel a ring."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(3.2 * len(scores), 3.2), layout="constrained")
    styles: dict[str, Any] = {
        "pi": ("o", "#0072b2"),
        "rf": ("s", "#999999"),
        "np": ("^", "#d55e00"),
        "sp": ("D", "#009e73"),
    }
    for i, s in enumerate(scores):
        axes = figure.add_subplot(1, len(scores), i + 1)
        for kind, points in s.curve.items():
            marker, colour = styles[kind]
            n, y = zip(*points, (s.n_train, s.nrmse_test[kind]), strict=True)
            axes.plot(n, y, marker=marker, color=colour, label=kind, lw=1.2, ms=4)
        axes.set_xscale("log")
        rows = sorted({n for points in s.curve.values() for n, _ in points} | {s.n_train})
        axes.set_xticks(rows, [str(n) for n in rows])
        axes.minorticks_off()
        axes.set_ylim(bottom=0.0)
        axes.set_title(f"ring {s.ring}", fontsize=10)
        axes.set_xlabel("training rows")
        axes.grid(alpha=0.3)
        if i == 0:
            axes.set_ylabel("test nRMSE of theta_dd")
            axes.legend(frameon=False)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        figure.savefig(path, dpi=150)
    except (OSError, ValueError) as problem:
        raise InputError(f"cannot be drawn: {problem}", file=path) from None
    say(f"wrote {path}")
