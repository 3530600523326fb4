"""`diagnose`: the effect that a model lacks, from a record."""

from __future__ import annotations

from mazeplan.apps.cli import options as opt
from mazeplan.apps.cli.output import print_json


def diagnose(
    logs: opt.Logs,
    model: opt.KnownModel = None,
    radius: opt.Radius = None,
    declare: opt.Declare = None,
    ring: opt.Ring = None,
    test: opt.TestLog = None,
    map_: opt.MapOfLog = None,
    system: opt.System = "ring",
    effects: opt.EffectModule = None,
    output: opt.DiagnosisFolder = None,
    reference: opt.Reference = None,
    columns: opt.Columns = None,
    force: opt.Force = False,
    as_json: opt.AsJson = False,
) -> None:
    """Find the effect that a model lacks, and the improvement of its predictions with the effect."""
    from mazeplan.apps.cli.progress import ProgressBar
    from mazeplan.run.commands.diagnose import diagnose as find

    with ProgressBar("diagnosing") as bar:
        done = find(
            logs, model=model, radius=radius, declare=declare or [], ring=ring, test=test, map=map_, system=system,
            effects=effects, output=output, reference=reference or [], columns=columns or [], progress=bar.show,
        )  # fmt: skip
    if as_json:
        print_json(done.document)
    else:
        print("\n".join(done.lines))
