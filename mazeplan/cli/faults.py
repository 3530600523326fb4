"""`evaluate --faults`: what is noticed and got over, in one table."""

from __future__ import annotations

from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mazeplan.cli.output import print_json

if TYPE_CHECKING:
    from mazeplan.evaluate import Campaign


def evaluate_faulty(
    campaign: Campaign, faults: str, workers: int | None, dask: str | None, folder: Path | None,
    as_json: bool, page: Path | None = None,
) -> int:  # fmt: skip
    """Do it and print it, and write a report into `page`; the exit status: 0 when every run ended as it should."""
    from mazeplan.cli.campaign import evaluate_all_faults
    from mazeplan.cli.report import write_report
    from mazeplan.evaluate import setup_document, summary
    from mazeplan.faultcampaign import good, report
    from mazeplan.rigs.faultschedule import every_kind, load_schedule

    trials = every_kind() if faults == "all" else load_schedule(faults)
    outcomes = evaluate_all_faults(campaign, trials, workers, dask, folder)
    rows = [report(trial, of_it) for trial, of_it in zip(trials, outcomes, strict=True)]
    document = summary([outcome.result for outcome in chain(*outcomes)])
    document["results"] = [outcome.to_json() for outcome in chain(*outcomes)]
    document |= {"setup": setup_document(campaign), "faults": rows}
    if page is not None:
        write_report("evaluation", document, page, f"{document['setup']['rig']} with faults")
    if as_json:
        print_json(document)
    else:
        print_rows(rows)
    return 0 if good(rows) else 1


def print_rows(rows: list[dict[str, Any]]) -> None:
    """A line for each fault, for people; below it what must not be."""
    width = max(len("fault"), *(len(row["fault"]) for row in rows))
    print(f"{'fault':{width}s}  arrived  noticed  after s  recoveries, and how the others ended")
    for row in rows:
        after = "-" if row["noticed_s"] is None else f"{row['noticed_s']['p50']:.2f}"
        ends = [f"{reason} {count}" for reason, count in row["stopped"].items()]
        if row["because"]:
            ends.append(f"not to be survived: {row['because']}")
        told = "; ".join([", ".join(row["recoveries"]) or "none", *ends])
        arrived, noticed = f"{row['arrived']}/{row['runs']}", f"{row['noticed']}/{row['faulted']}"
        print(f"{row['fault']:{width}s}  {arrived:>7s}  {noticed:>7s}  {after:>7s}  {told}")
        for wrong in row["wrong"]:
            print(f"{'':{width}s}  WRONG: {wrong}")
