"""Draw the pictures of reports that README and docs show: `python tools/draw_reports.py` writes them into docs/.

The run begins where an opening is missed and the ball falls back, so that there is something to be seen."""

from __future__ import annotations

import tempfile
from pathlib import Path

from mazeplan.apps.report.evaluation import evaluation_section
from mazeplan.apps.report.inputs import Input
from mazeplan.apps.report.page import PagePicture, PageSection
from mazeplan.apps.report.run import run_section
from mazeplan.core.logs.run_log import read_log
from mazeplan.run.campaign.evaluate import Campaign, evaluate, setup_document, summary
from mazeplan.run.navigate import navigate

DOCS = Path(__file__).resolve().parent.parent / "docs"


def save(section: PageSection, name: str, target: str) -> None:
    """The picture of a section by its name."""
    picture = next(part for part in section.parts if isinstance(part, PagePicture) and part.name == name)
    (DOCS / target).write_bytes(picture.files()[1])
    print(f"wrote {DOCS / target}")


def main() -> None:
    with tempfile.TemporaryDirectory() as folder:
        log = Path(folder) / "run.mcap"
        navigate(rig="rough", seed=0, start_angle_deg=11.25, log=log)
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
