"""`compare`: kinds of ball models on the same data."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

from mazeplan.apps.cli import options as opt
from mazeplan.apps.cli.output import plural, print_json, say

if TYPE_CHECKING:
    from mazeplan.learning.ring_scores import RingScores


def compare(
    logs: opt.Logs,
    test: opt.TestLogs = None,
    map_: opt.MapOfLog = None,
    columns: opt.Columns = None,
    ring: opt.Ring = None,
    radius: opt.Radius = None,
    kinds: opt.CompareKinds = "rf,p,pi,np,sp",
    most: opt.CompareRows = 5000,
    page: opt.Report = None,
    seed: opt.Seed = 0,
    force: opt.Force = False,
    as_json: opt.AsJson = False,
) -> None:
    """Compare kinds of ball models in each ring: nRMSE of theta_dd and roll-out errors."""
    from mazeplan.core.logs.table import check_there

    for log in (*logs, *(test or ())):
        check_there(log)
    from mazeplan.apps.cli.progress import ProgressBar
    from mazeplan.apps.cli.report import write_report
    from mazeplan.run.commands.compare import compare as score

    with ProgressBar("comparing") as bar:
        done = score(
            logs, test=test, map=map_, columns=columns or [], ring=ring, radius=radius, kinds=kinds, most=most,
            seed=seed, progress=bar.show, advance=bar.advance, say=say,
        )  # fmt: skip
    document, scores = done.document, done.scores
    if as_json:
        print_json(document)
    else:
        report(scores)
    # the files come last: one that cannot be written loses no result
    if page is not None:
        write_report("comparison", document, page, ", ".join(log.name for log in logs))


def report(scores: Sequence[RingScores]) -> None:
    """Print the tables. If there are too few windows or blocks of time for an interval, print this instead."""
    from mazeplan.learning.split import TOO_FEW, enough

    kinds = list(scores[0].nrmse_test)
    print(f"{'nRMSE of theta_dd':24s}" + "".join(f"{kind:>16s}" for kind in kinds))
    for s in scores:
        cells = "".join(f"{s.nrmse_train[kind]:8.3f}/{s.nrmse_test[kind]:.3f}  " for kind in kinds)
        print(f"ring {s.ring} train/test          {cells}")
        low = "".join(f"   [{a:.3f}, {b:.3f}]" for a, b in (s.interval["nrmse_test"][kind] for kind in kinds))
        few = f"   {TOO_FEW}: {plural(s.blocks['test'], 'block')} of time"
        print(f"   95 % of the test      {low if enough(blocks=s.blocks['test']) else few}")
    print("\nmean absolute error of theta after 20 / 40 samples, degrees (± half of the 95 % interval)")
    for s in scores:
        if not len(s.windows):
            print(f"ring {s.ring}  0 windows: no stretch of test rows is long enough")
            continue
        cells = "".join(f"  {kind} {_error(s, kind, '20')}/{_error(s, kind, '40')}" for kind in s.rollout)
        few = "" if _enough(s) else f" in {plural(s.blocks['windows'], 'block')} of time ({TOO_FEW} for ±)"
        print(f"ring {s.ring}  {plural(len(s.windows), 'window')}{few}, {s.windows.chosen}: {cells}")
    for s in scores:
        if s.best is not None:
            print(f"ring {s.ring}  {verdict(s)}")
    for index, name in enumerate(("beta", "gamma")):
        if any(s.signs[index] < 0 for s in scores):
            print(
                f"note: these data count {name} the other way round (gravity would pull uphill); its sign was changed"
            )
    off = [f"ring {s.ring} {1e3 * s.centre[0]:.1f}, {1e3 * s.centre[1]:.1f}" for s in scores if any(s.centre)]
    if off:
        print(f"note: the camera counts the angle about another point than the rings' centre, in mm: {'; '.join(off)}")
    print(f"rates: {scores[0].rates}; ball {1e3 * scores[0].delay:.0f} ms behind the tilt")
    print(f"training rows: {', '.join(str(s.n_train) for s in scores)}")


def verdict(s: RingScores) -> str:
    """A sentence on the kind that predicts best after 40 samples: by how much, and how certain the difference is."""
    from mazeplan.learning.split import TOO_FEW

    best = s.best
    if best is None:
        return "no two kinds to compare"
    less, low, high = (math.degrees(value) for value in (best.less, *best.interval))
    led = f"{less:.2f} degrees less error after 40 samples than {best.next}"
    if not _enough(s) or not math.isfinite(low):
        return f"least error: {best.kind}, {led}; {TOO_FEW} blocks of time to tell"
    interval = f"95 % interval {low:.2f} to {high:.2f}"
    return f"best: {best.kind}, {led} ({interval})" if low > 0.0 else (
        f"no clear best: {best.kind} has {led} ({interval})"
    )  # fmt: skip


def _error(s: RingScores, kind: str, steps: str) -> str:
    """A roll-out error with half of its 95 % interval, if there is one."""
    low, high = s.interval[steps].get(kind, (math.nan, math.nan))
    half = f" ± {math.degrees(0.5 * (high - low)):.2f}" if math.isfinite(high - low) and _enough(s) else ""
    return f"{math.degrees(s.rollout[kind][steps]):.2f}{half}"


def _enough(s: RingScores) -> bool:
    """Whether a ring has enough windows, in enough blocks of time, for an interval."""
    from mazeplan.learning.split import enough

    return enough(len(s.windows), s.blocks["windows"])
