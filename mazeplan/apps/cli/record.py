"""`record`: episodes of the planner as a data set."""

from __future__ import annotations

from pathlib import Path

from mazeplan.apps.cli import options as opt
from mazeplan.apps.cli.output import print_json, say
from mazeplan.core.errors import InputError, SettingsError

OPTIONS = {"start_ring": "--from", "goal_ring": "--to"}  # {setting of the environment: option}


def record(
    episodes: opt.Episodes = 16,
    output: opt.ParquetFile = None,
    minari: opt.Minari = None,
    rig: opt.RigName = "toy",
    map_: opt.Map = "cme",
    model: opt.Model = None,
    behavior: opt.Behavior = "navigate",
    start: opt.EpisodeStart = "ring1",
    goal: opt.GoalRing = "centre",
    observation: opt.ObservationKind = "state",
    reward: opt.RewardKind = "sparse",
    seed: opt.Seed = 0,
    force: opt.Force = False,
    as_json: opt.AsJson = False,
) -> None:
    """Let the planner play episodes of the Gymnasium environment, and write them as a data set."""
    from mazeplan.apps.cli.progress import ProgressBar
    from mazeplan.apps.environment.record import Recording, record_minari
    from mazeplan.apps.environment.record import record as record_parquet

    if output is None and minari is None:
        raise InputError("got neither -o FILE.parquet nor --minari NAME, expected one of the two")
    options = {
        "map": map_, "rig": rig, "observation": observation, "reward": reward, "start_ring": start,
        "goal_ring": goal,
    }  # fmt: skip
    plan = Recording(episodes, seed, options, model, behavior)
    try:
        with ProgressBar("episodes") as bar:
            if minari:
                done = record_minari(plan, minari, bar.advance)
            else:
                done = record_parquet(plan, Path(str(output)), bar.advance)
    except SettingsError as problem:
        if problem.file is not None or problem.key not in OPTIONS:
            raise
        raise SettingsError(problem.problem, key=OPTIONS[problem.key]) from None
    except KeyboardInterrupt:
        say("no episode is kept: a data set is written only when it is complete")
        raise
    if as_json:
        print_json(done)
        return
    mean = "" if done["mean_time_s"] is None else f", in {done['mean_time_s']:.2f} s on average"
    say(f"{done['success']} of {done['episodes']} episodes arrived{mean}")
    say(f"wrote {done['steps']} steps to {done['written']}")
