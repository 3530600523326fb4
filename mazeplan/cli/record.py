"""`record`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from mazeplan.cli.navigate import Behavior, Json, Map, Model, RigName, To
from mazeplan.cli.output import print_json, say
from mazeplan.errors import InputError


def record(
    episodes: Annotated[int, typer.Option("--episodes", min=1, help="How many.")] = 16,
    output: Annotated[Path | None, typer.Option("-o", "--output", help="Parquet file to write.")] = None,
    minari: Annotated[
        str | None, typer.Option("--minari", help="Name of a Minari data set to make instead, such as maze/expert-v0.")
    ] = None,
    rig: RigName = "toy",
    map_: Map = "cme",
    model: Model = None,
    behavior: Behavior = "navigate",
    start: Annotated[str, typer.Option("--from", help="Ring to start in, such as ring1, or any.")] = "ring1",
    goal: To = "centre",
    observation: Annotated[str, typer.Option("--observation", help="state or pixels.")] = "state",
    reward: Annotated[str, typer.Option("--reward", help="sparse or dense.")] = "sparse",
    seed: Annotated[int, typer.Option("--seed", min=0, help="Seed of the first episode; the others follow.")] = 0,
    as_json: Json = False,
) -> None:
    """Let the planner play episodes of the Gymnasium environment, and keep them as a data set."""
    from mazeplan.cli.progress import Working

    if (output is None) == (minari is None):
        raise InputError("got both or neither of -o FILE.parquet and --minari NAME, expected one")
    if output is not None:
        from mazeplan.cli.arguments import check_folder

        if output.suffix != ".parquet":
            raise InputError(f"-o: got {output}, expected a name that ends in .parquet")
        check_folder("-o", output.parent)
    from mazeplan.environment.record import Recording
    from mazeplan.environment.record import record as to_parquet
    from mazeplan.environment.record import record_minari as to_minari

    options = {
        "map": map_, "rig": rig, "observation": observation, "reward": reward, "start_ring": start,
        "goal_ring": None if goal == "centre" else goal,
    }  # fmt: skip
    plan = Recording(episodes, seed, options, model, behavior)
    try:
        with Working("episodes") as shown:
            advance = shown.advance
            done = to_minari(plan, minari, advance) if minari else to_parquet(plan, Path(str(output)), advance)
    except KeyboardInterrupt:
        say("no episode is kept: a data set is written whole or not at all")
        raise
    if as_json:
        print_json(done)
        return
    mean = "" if done["mean_time_s"] is None else f", in {done['mean_time_s']:.2f} s on average"
    say(f"{done['success']} of {done['episodes']} episodes arrived{mean}")
    say(f"wrote {done['steps']} steps to {done['written']}")
