"""`learn`: fit the model of a rig to its logs."""

from __future__ import annotations

from mazeplan.apps.cli import options as opt
from mazeplan.apps.cli.output import print_json, say


def learn(
    logs: opt.Logs,
    output: opt.OutputFolder,
    kind: opt.Kind = "sp",
    device: opt.Device = "cpu",
    most: opt.LearnRows = 4000,
    smoothing: opt.Smoothing = "rts",
    seed: opt.Seed = 0,
    rig: opt.DrivenRig = None,
    map_: opt.MapOfLog = None,
    columns: opt.Columns = None,
    force: opt.Force = False,
    as_json: opt.AsJson = False,
) -> None:
    """Fit the model of a rig, stage and ball, to its logs."""
    from mazeplan.core.logs.table import check_there

    for log in logs:  # checked before torch loads
        check_there(log)
    from mazeplan.apps.cli.model import model_lines
    from mazeplan.apps.cli.progress import ProgressBar
    from mazeplan.apps.report.words import verdict_lines
    from mazeplan.learning.fits import fits_words
    from mazeplan.run.commands.learn import learn as fit

    if device == "cuda":
        say("--device cuda: all kinds train on the processor")
    with ProgressBar("learning") as bar:
        learned = fit(
            logs, output, kind=kind, device=device, most=most, smoothing=smoothing, seed=seed, rig=rig, map=map_,
            columns=columns or [], progress=bar.show, advance=bar.advance,
        )  # fmt: skip
    if as_json:
        print_json(learned.document)
        return
    done, model = learned.learned, learned.model
    lines = [*model_lines(model), f"fit: {fits_words(model)}", done.judgement.words()]
    lines += [f"rigid ball: {done.why}"] if model.body is None and done.why else []
    driven: dict[str, float] = model.scores.get("driven_s", {})
    lines += [f"driven: {', '.join(f'{name} {time:.2f} s' for name, time in driven.items())}"] if driven else []
    print("\n".join([*lines, f"wrote {learned.document['model']}", *verdict_lines(learned.document["score"])]))
