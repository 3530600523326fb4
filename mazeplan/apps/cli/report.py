"""`report`: runs, evaluations, models and diagnoses in one HTML file; `view`: the page of a rig or of a log."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

from typer import Argument

from mazeplan.apps.cli import options as opt
from mazeplan.apps.cli.output import say
from mazeplan.apps.cli.progress import ProgressBar

Inputs = Annotated[
    list[Path],
    Argument(
        metavar="INPUT",
        help="Run logs; JSON documents of evaluate, compare, diagnose or improve; folders of diagnose -o.",
    ),
]
Page = Annotated[Path, opt.output_file("HTML file to write.", ".html", ".htm")]
ViewedLog = Annotated[Path | None, Argument(metavar="LOG", help="Run log to show.")]


def report(inputs: Inputs, output: Page, force: opt.Force = False) -> None:
    """Draw runs, evaluations, models and diagnoses into one HTML file without external content."""
    from mazeplan.apps.report.inputs import read_input
    from mazeplan.apps.report.write import write_inputs

    with ProgressBar("drawing", compiles=False) as bar:
        write_inputs([part for path in inputs for part in read_input(path)], output, show=bar.show)
    say(f"wrote {output}")


def view(
    log: ViewedLog = None,
    map_: opt.Map = "cme",
    rig: opt.RigName = "toy",
    model: opt.Model = None,
    behavior: opt.Behavior = "navigate",
    time_limit: opt.TimeLimit = 20.0,
    port: opt.PagePort = opt.PORT,
) -> None:
    """Open the page in the browser: operate a rig, or show a recorded run. Ctrl-C closes it.

    `navigate --view` has more options."""
    if log is not None:
        from mazeplan.apps.view.replay import open_recording, show_log

        with ProgressBar("reading") as bar:
            bar.show(log.name)
            recording = open_recording(log)
        show_log(recording, port)
        return
    from mazeplan.apps.cli.live import navigate_live
    from mazeplan.run.request import NavigationRequest

    request = NavigationRequest(map=map_, rig=rig, model=model, behavior=behavior, time_limit=time_limit)
    sys.exit(navigate_live(request, port, begin=False))
