"""`policy train`, `policy show`, `policy export`: a network that imitates the planner."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from mazeplan.apps.cli import options as opt
from mazeplan.apps.cli.option_checks import file, new_file
from mazeplan.apps.cli.output import print_json, say

if TYPE_CHECKING:
    from mazeplan.run.campaign.imitation import Round

app = typer.Typer(help="Train, show and export policies that imitate the planner.", no_args_is_help=True)
Rounds = Annotated[
    int, typer.Option("--rounds", min=1, metavar="N", help="Rounds; in the first one the planner drives.")
]
RoundRuns = Annotated[int, typer.Option("--runs", min=1, metavar="N", help="Runs of each round.")]
Epochs = Annotated[int, typer.Option("--epochs", min=1, metavar="N", help="Passes over the samples in each fit.")]
PolicyFolder = Annotated[Path, typer.Argument(metavar="DIR", help="Folder of a policy.")]
Exported = Annotated[
    Path,
    typer.Option(
        "-o", "--output", parser=file(".onnx", chosen=True), callback=new_file, metavar="FILE",
        help="File to write, such as policy.onnx.",
    ),
]  # fmt: skip


@app.command("train")
def train(
    output: opt.OutputFolder,
    rig: opt.RigName = "toy",
    map_: opt.Map = "cme",
    model: opt.Model = None,
    settings: opt.Settings = None,
    rounds: Rounds = 6,
    runs: RoundRuns = 80,
    epochs: Epochs = 20,
    seed: opt.Seed = 0,
    workers: opt.Processes = 1,
    device: opt.Device = "cpu",
    force: opt.Force = False,
    as_json: opt.AsJson = False,
) -> None:
    """Train a policy: runs of the planner, then of the policy with the planner's commands as its lessons."""
    from mazeplan.apps.cli.runs import note_missing_model
    from mazeplan.maze.mapfile import load_map
    from mazeplan.rigs.registry import make_rig

    make_rig(rig, load_map(map_))  # before torch loads, so that a rig that is missing is named at once
    note_missing_model(rig, model)
    from mazeplan.apps.cli.progress import ProgressBar
    from mazeplan.control.policy_file import policy_document, save_policy
    from mazeplan.learning.torch_device import require_device, require_torch
    from mazeplan.run.campaign.imitation import Options
    from mazeplan.run.campaign.imitation import train as train_policy
    from mazeplan.run.campaign.one_run import Campaign

    require_torch()
    require_device(device)
    campaign = Campaign(runs=runs, rig=rig, map=map_, model=model, settings=settings)
    lines: list[str] = []
    with ProgressBar("learning") as bar:

        def tell(done: Round) -> None:
            lines.append(round_line(done))
            bar.show(lines[-1])

        options = Options(rounds, runs, seed, workers, epochs, device=device)
        policy = train_policy(campaign, options, show=bar.show, advance=bar.advance, tell=tell)
    path = save_policy(policy, output)
    if as_json:
        print_json({"policy": str(path.parent), **policy_document(policy)})
    else:
        print("\n".join([*lines, f"wrote {path}"]))


def round_line(done: Round) -> str:
    """The result of a round of training, in one line."""
    return (
        f"round {done.number + 1}: {done.arrived} of {done.runs} arrived, {done.samples} samples so far, "
        f"commands off by {done.error:.2f} deg on average on those held out"
    )


@app.command("show")
def show(folder: PolicyFolder, as_json: opt.AsJson = False) -> None:
    """Show a policy: the network, and how it was trained."""
    from mazeplan.control.policy_file import load_policy, policy_document

    policy = load_policy(folder)
    document: dict[str, Any] = {**policy_document(policy), "numbers": policy.size, "centres": len(policy.centres)}
    if as_json:
        print_json(document)
        return
    hidden = " x ".join(str(width) for width in document["hidden"])
    print(f"network: {len(document['inputs'])} inputs, hidden layers {hidden}, 2 outputs: {policy.size} numbers")
    print(f"known states: {len(policy.centres)} centres of the training data")
    for key, value in policy.facts.items():
        print(f"{key}: {value}")


@app.command("export")
def export(folder: PolicyFolder, output: Exported, force: opt.Force = False) -> None:
    """Write the network as an ONNX graph."""
    from mazeplan.control.policy_file import load_policy
    from mazeplan.control.policy_onnx import save_onnx

    save_onnx(load_policy(folder), output)
    say(f"wrote {output}")
