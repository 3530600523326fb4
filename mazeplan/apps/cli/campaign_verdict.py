"""The verdict on a campaign of `evaluate`: what the runs show, and what to do next."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from mazeplan.core.records import FailureKind

NO_ROUTE = FailureKind.NO_ROUTE.value
SURE = 0.9  # good enough: minimum of the lower end of the 95 % interval of the share of runs that arrive
MANY = 64  # runs that are enough for SURE, if all of them arrive
OF_THE_RUN = ("--runs", "--report", "--force", "--json")  # options of `evaluate` that more runs do not need again
NAVIGATES = (
    "--rig", "--map", "--model", "--effects", "--policy", "--behavior", "--behavior-module", "--settings", "--from",
    "--to", "--balls", "--time-limit", "--sense",
)  # fmt: skip  # options that `navigate` has as well
FEW = 10  # fewer runs show nothing, even if all of them arrive


def verdict(document: dict[str, Any], given: Mapping[str, str] | None = None) -> dict[str, Any]:
    """`verdict` (good, fair, poor, or unknown: too few runs), `because` and `advice` for a campaign.

    document: of `evaluate` without faults
    given: the options of its command line as typed (`given_words`); the advice repeats them"""
    from mazeplan.apps.report.evaluation_runs import interval

    given = given or {}
    runs, arrived = document["runs"], document["success"]
    low, high = interval(arrived, runs)
    share = f"{100 * low:.0f} to {100 * high:.0f} %"
    because = f"{arrived} of {runs} runs arrived; of many runs {share} would (95 % interval)"
    lost = next((result for result in document["results"] if not result["success"]), None)
    advice = []
    if runs and all(result.get("reason") == NO_ROUTE for result in document["results"]):
        because = "no run found a way to its goal: see `openings` and `closed` in the file of the map"
        return {"verdict": "poor", "because": because, "advice": [show_route(document, given)]}
    if lost is not None:
        worst = max(document["failures"].items(), key=lambda item: item[1], default=None)
        because += f"; the most frequent failure is {worst[0]}" if worst else ""
        angle = f" --start-angle {math.degrees(lost['start']['theta']):.2f}" if lost.get("start") else ""
        same = "".join(words for option, words in given.items() if option in NAVIGATES)
        again = f"mazeplan navigate --seed {lost['seed']}{angle}{same} --log LOST.mcap"
        advice = [f"look at the first that did not: {again}, then mazeplan view LOST.mcap"]
    if low >= SURE:
        return {"verdict": "good", "because": because, "advice": [*advice, "nothing is left to do for this rig"]}
    if arrived == runs:
        same = "".join(words for option, words in given.items() if option not in OF_THE_RUN)
        more = f"{runs} runs cannot tell 90 % from 100 %: mazeplan evaluate --runs {MANY}{same}"
        return {"verdict": "good" if runs >= FEW else "unknown", "because": because, "advice": [more]}
    word = "fair" if arrived >= 0.5 * runs else "poor"
    same = given.get("--rig", "") + given.get("--map", "")
    model = given.get("--model", " --model MODEL").removeprefix(" --model")
    log = f"mazeplan collect --rings{same} -o NEW.mcap, then mazeplan score{model} NEW.mcap"
    return {"verdict": word, "because": because, "advice": [*advice, f"see whether its model is to blame: {log}"]}


def show_route(document: dict[str, Any], given: Mapping[str, str]) -> str:
    """The advice for a map without a way to the goal."""
    setup = document.get("setup", {})
    ends = f" --from ring{setup['start_ring']} --to ring{setup['goal_ring']}" if setup else ""
    map_ = given.get("--map", " --map MAP").removeprefix(" --map")
    return f"open a way in the map, until this finds one: mazeplan map route{map_}{ends}"
