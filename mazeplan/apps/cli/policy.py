"""`policy train`: a network that imitates the planner."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import typer

from mazeplan.apps.cli import options as opt
from mazeplan.apps.cli.output import print_json

if TYPE_CHECKING:
    from mazeplan.run.campaign.imitation import Round

app = typer.Typer(help="Train policies that imitate the planner.", no_args_is_help=True)
Rounds = Annotated[
    int, typer.Option("--rounds", min=1, metavar="N", help="Rounds; in the first one the planner drives.")
]
RoundRuns = Annotated[int, typer.Option("--runs", min=1, metavar="N", help="Runs of each round.")]
Epochs = Annotated[int, typer.Option("--epochs", min=1, metavar="N", help="Passes over the samples in each fit.")]


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
    from mazeplan.apps.cli.navigate import note_missing_model
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
