"""`collect`, `learn`, `diagnose` and `improve`: from a rig to a record, to a model, and round again; `policy train`."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING, Annotated, Any

import typer

from mazeplan.apps.cli import options as opt
from mazeplan.apps.cli.emergency import interrupt, stop_key
from mazeplan.apps.cli.model import model_lines
from mazeplan.apps.cli.navigate import note_missing_model
from mazeplan.apps.cli.output import print_json, print_result, say
from mazeplan.apps.cli.progress import ProgressBar

if TYPE_CHECKING:
    from mazeplan.run.campaign.imitation import Round


def collect(
    output: opt.CollectedLog,
    rig: opt.RigName = "toy",
    seconds: opt.Seconds = 300.0,
    map_: opt.Map = "cme",
    ring: opt.FirstRing = "ring1",
    rings: opt.AllRings = False,
    place: opt.Place = False,
    model: opt.Model = None,
    seed: opt.Seed = 0,
    tilt: opt.Tilt = None,
    highest_hz: opt.HighestHz = 1.5,
    force: opt.Force = False,
    as_json: opt.AsJson = False,
) -> None:
    """Excite a rig with 50 random sines per axis and write a log."""
    from mazeplan.run.collect import collect as record

    if rings and not place:
        note_missing_model(rig, model)
    try:
        with ProgressBar("seconds", transient=False) as bar:
            done = record(
                output, seconds, rig=rig, map=map_, ring=ring, rings=rings, place=place, model=model, seed=seed,
                tilt=tilt, highest_hz=highest_hz, own_process=True, guard=lambda machine: stop_key(machine, interrupt),
                advance=bar.advance,
            )  # fmt: skip
    except KeyboardInterrupt as problem:
        if output.exists():
            problem.add_note(f"the samples so far are in {output}")
        raise
    if (tour := done.tour) is not None:
        say("time       " + ", ".join(f"ring {ring} {time:.0f} s" for ring, time in tour.ring_s.items()))
        say(f"drives     {tour.drives}, {tour.failed} did not arrive; {tour.changes} changes of ring")
        say("openings   " + ", ".join(f"{name} {count}" for name, count in tour.passed.items()))
    if as_json:
        print_json(done.document)
    say(f"wrote {done.document['samples']} samples to {output}")


def learn(
    logs: opt.Logs,
    output: opt.OutputFolder,
    kind: opt.Kind = "sp",
    device: opt.Device = "cpu",
    most: opt.Most = 4000,
    seed: opt.Seed = 0,
    map_: opt.MapOfLog = None,
    columns: opt.Columns = None,
    force: opt.Force = False,
    as_json: opt.AsJson = False,
) -> None:
    """Fit the model of a rig, stage and ball, to its logs."""
    from mazeplan.apps.report.models import score_section
    from mazeplan.apps.report.page import section_text
    from mazeplan.learning.rig_model import fits_words
    from mazeplan.run.commands.learn import learn as fit

    if device == "cuda":
        say("--device cuda: all kinds train on the processor")
    with ProgressBar("learning") as bar:
        learned = fit(
            logs, output, kind=kind, device=device, most=most, seed=seed, map=map_,
            columns=columns or [], progress=bar.show, advance=bar.advance,
        )  # fmt: skip
    done, model = learned.learned, learned.model
    lines = [*model_lines(model), f"fit: {fits_words(model)}", done.judgement.words()]
    lines += [f"rigid ball: {done.why}"] if model.body is None and done.why else []
    scored = section_text(score_section(str(output), learned.document["score"]))
    print_result(as_json, learned.document, *lines, f"wrote {learned.document['model']}", scored)


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
    output: opt.MaybeOutputFolder = None,
    reference: opt.Reference = None,
    columns: opt.Columns = None,
    force: opt.Force = False,
    as_json: opt.AsJson = False,
) -> None:
    """Find the effect that a model lacks, and the improvement of its predictions with the effect."""
    from mazeplan.run.commands.diagnose import diagnose as find

    with ProgressBar("diagnosing") as bar:
        done = find(
            logs, model=model, radius=radius, declare=declare or [], ring=ring, test=test, map=map_, system=system,
            effects=effects, output=output, reference=reference or [], columns=columns or [], progress=bar.show,
        )  # fmt: skip
    print_result(as_json, done.document, *done.lines)


def improve(
    rig: opt.RigName,
    model: opt.KnownModel = None,
    rounds: opt.Rounds = 1,
    runs: opt.RoundRuns = 16,
    seconds: opt.Seconds = 400.0,
    reference: opt.Reference = None,
    columns: opt.Columns = None,
    effects: opt.EffectModule = None,
    map_: opt.Map = "cme",
    seed: opt.Seed = 0,
    workers: opt.Workers = None,
    output: opt.MaybeOutputFolder = None,
    force: opt.Force = False,
    as_json: opt.AsJson = False,
) -> None:
    """Collect, diagnose, update the model, and navigate with the old and the new model.

    Exit status 1: a diagnosis found an unknown effect, or not all navigations arrived with the last model."""
    from mazeplan.run.commands.improve import improve as run_rounds

    note_missing_model(rig, model)
    with ProgressBar("improving") as bar:
        improved = run_rounds(
            rig, model=model, rounds=rounds, runs=runs, seconds=seconds, reference=reference or [],
            columns=columns or [], effects=effects, map=map_, seed=seed, workers=workers, output=output,
            own_process=True, tell=bar.note, progress=bar.show, advance=bar.advance,
        )  # fmt: skip
    done = improved.rounds
    lines = [line for number, entry in enumerate(done, start=1) for line in _round_lines(number, entry)]
    print_result(as_json, {"rounds": done}, *lines)
    unknown = any(entry["diagnosis"]["verdict"] == "unknown_effect" for entry in done)
    sys.exit(1 if unknown or done[-1]["navigation"]["after"]["success"] != runs else 0)


def _round_lines(number: int, entry: dict[str, Any]) -> list[str]:
    """Lines for a round: the diagnosis, the navigations before and after, and the model."""
    diagnosis = entry["diagnosis"]
    lines = [f"round {number}: {diagnosis['sentence']}"]
    for when, n in entry["navigation"].items():
        mean = f", mean {n['time_s']['mean']:.2f} s" if n["time_s"]["mean"] else ""
        lines.append(f"  {when:7s} {n['success']} of {n['runs']} arrived{mean}")
    lines += [f"  {entry['compared']['sentence']}"] if entry.get("compared") else []
    lines += [f"  {line}" for line in diagnosis["advice"]]
    return lines + ([f"  model   {diagnosis['model']}"] if diagnosis["model"] else [])


policy_app = typer.Typer(help="Train policies that imitate the planner.", no_args_is_help=True)
Epochs = Annotated[int, opt.value("--epochs", "N", "Passes over the samples in each fit.", min=1)]


@policy_app.command("train")
def train(
    output: opt.OutputFolder,
    rig: opt.RigName = "toy",
    map_: opt.Map = "cme",
    model: opt.Model = None,
    settings: opt.Settings = None,
    rounds: opt.Rounds = 6,
    runs: opt.RoundRuns = 80,
    epochs: Epochs = 20,
    seed: opt.Seed = 0,
    workers: opt.Workers = 1,
    device: opt.Device = "cpu",
    force: opt.Force = False,
    as_json: opt.AsJson = False,
) -> None:
    """Train a policy: runs of the planner, then of the policy with the planner's commands as its lessons."""
    from mazeplan.maze.mapfile import load_map
    from mazeplan.rigs.registry import make_rig

    make_rig(rig, load_map(map_))  # before torch loads, so that a rig that is missing is named at once
    note_missing_model(rig, model)
    from mazeplan.control.policy import policy_document, save_policy
    from mazeplan.learning.policy_training import require_device, require_torch
    from mazeplan.run.campaign.imitation import Options
    from mazeplan.run.campaign.imitation import train as train_policy
    from mazeplan.run.campaign.one_run import Campaign

    require_torch()
    require_device(device)
    campaign = Campaign(runs=runs, rig=rig, map=map_, model=model, settings=settings)
    lines: list[str] = []
    with ProgressBar("learning") as bar:

        def tell(done: Round) -> None:
            held_out = f"commands off by {done.error:.2f} deg on average on those held out"
            samples = f"{done.samples} samples so far, {held_out}"
            lines.append(f"round {done.number + 1}: {done.arrived} of {done.runs} arrived, {samples}")
            bar.show(lines[-1])

        options = Options(rounds, runs, seed, workers or 1, epochs, device=device)
        policy = train_policy(campaign, options, show=bar.show, advance=bar.advance, tell=tell)
    path = save_policy(policy, output)
    document = {"policy": str(path.parent), **policy_document(policy)}
    print_result(as_json, document, *lines, f"wrote {path}")
