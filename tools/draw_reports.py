"""Draw the pictures of reports that README and docs show: `python tools/draw_reports.py` writes them into docs/.

Of runs from all around the circle the first is drawn that missed an opening and then arrived."""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np

from mazeplan.apps.report.evaluation import evaluation_section
from mazeplan.apps.report.inputs import Input
from mazeplan.apps.report.page import DPI, PagePicture, PageSection
from mazeplan.apps.report.run import run_section
from mazeplan.core.logs.run_log import read_log
from mazeplan.run.campaign.evaluate import Campaign, evaluate, setup_document, summary
from mazeplan.run.navigate import navigate

DOCS = Path(__file__).resolve().parent.parent / "docs"


def save(section: PageSection, name: str, target: str) -> None:
    """The picture of a section by its name."""
    picture = next(part for part in section.parts if isinstance(part, PagePicture) and part.name == name)
    picture.figure().savefig(DOCS / target, dpi=DPI)
    print(f"wrote {DOCS / target}")


def main() -> None:
    with tempfile.TemporaryDirectory() as folder:
        log = Path(folder) / "run.mcap"
        for start in np.arange(22.5, 360.0, 22.5):
            done = navigate(rig="rough", seed=0, start_angle_deg=float(start), log=log)
            if done.success and "missed_opening" in [failure.kind for failure in done.failures]:
                break
            log.unlink()
        else:
            raise SystemExit("no run missed an opening")
        run = run_section(read_log(log))
    save(run, "tree", "report-tree.png")
    given = []
    for rig in ("toy", "rough"):
        campaign = Campaign(runs=32, rig=rig)
        document = {**summary(evaluate(campaign)), "setup": setup_document(campaign)}
        given.append(Input("evaluation", Path(rig), rig, document))
    save(evaluation_section(given), "arrivals", "report-arrivals.png")


if __name__ == "__main__":
    main()
