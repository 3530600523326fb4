"""Two evaluations of the same job, run by run: runs of one seed have the same start and the same noise.

    time       mean of b - a over the seeds with which both arrived; interval by Student's t
    arrivals   share of b - share of a; interval of Bonett and Price, 2012, doi:10.3102/1076998611411915
               (one more run of each kind of disagreement); p_value: exact test of McNemar

Intervals hold with a probability of 95 %.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from mazeplan.core.errors import InputError
from mazeplan.core.results import DocumentResult

LEVEL = 0.95
SAME = ("start_ring", "goal_ring")  # of both setups


@dataclass(frozen=True)
class PairedRuns(DocumentResult):
    """Two evaluations compared seed by seed: the document of `evaluate --compare --json`."""

    @property
    def sentence(self) -> str:
        """The comparison in words."""
        return self.document["sentence"]


def paired(
    a: Mapping[str, Any], b: Mapping[str, Any], names: tuple[str, str] = ("A", "B"), called: str = "B"
) -> PairedRuns:
    """The difference between two documents of `evaluate --json`, b - a.

    names: of their files; called: the second one in the sentence

    Raises InputError for documents that have no seed in common, or were not made by the same job."""
    runs = [_by_seed(document, name) for document, name in zip((a, b), names, strict=True)]
    for key in SAME:
        one, other = ((document.get("setup") or {}).get(key) for document in (a, b))
        if one != other:
            raise InputError(f"got {key} {other}, expected {one} as in {names[0]}", file=names[1], key="setup")
    seeds = sorted(set(runs[0]) & set(runs[1]))
    if not seeds:
        raise InputError(f"got no run with a seed of {names[0]}, expected runs of the same seeds", file=names[1])
    arrived = np.array([[bool(of[seed]["success"]) for seed in seeds] for of in runs])
    time = np.array([[float(of[seed]["time_s"]) for seed in seeds] for of in runs])
    document: dict[str, Any] = {
        "a": names[0], "b": names[1], "pairs": len(seeds), "unpaired": sum(map(len, runs)) - 2 * len(seeds),
        "time_s": _times((time[1] - time[0])[arrived.all(axis=0)]), "arrivals": _arrivals(*arrived),
    }  # fmt: skip
    return PairedRuns(document | {"sentence": _sentence(document, called)})


def _by_seed(document: Mapping[str, Any], name: str) -> dict[int, Mapping[str, Any]]:
    try:
        runs = {int(run["seed"]): run for run in document["results"]}
        count = len(document["results"])
    except (KeyError, TypeError, ValueError):
        raise InputError("got no results with a seed, expected the output of `evaluate --json`", file=name) from None
    if len(runs) < count:
        raise InputError(f"got {count} runs with {len(runs)} seeds, expected each seed once", file=name, key="results")
    return runs


def _times(difference: np.ndarray) -> dict[str, Any]:
    if len(difference) < 2:
        return {"pairs": len(difference), "difference": None, "interval": None}
    from scipy.stats import t  # slow to import

    mean, error = float(difference.mean()), float(difference.std(ddof=1)) / math.sqrt(len(difference))
    half = float(t.ppf(0.5 + 0.5 * LEVEL, len(difference) - 1)) * error
    interval = [round(mean - half, 4), round(mean + half, 4)]
    return {"pairs": len(difference), "difference": round(mean, 4), "interval": interval}


def _arrivals(a: np.ndarray, b: np.ndarray) -> dict[str, Any]:
    """Shares that arrived (N,), their difference with its interval, and the runs in which only one arrived."""
    from scipy.stats import binomtest, norm  # slow to import

    only_a, only_b, n = int((a & ~b).sum()), int((b & ~a).sum()), len(a)
    lost, won = (only_a + 1) / (n + 2), (only_b + 1) / (n + 2)
    half = float(norm.ppf(0.5 + 0.5 * LEVEL)) * math.sqrt((lost + won - (won - lost) ** 2) / (n + 2))
    interval = [round(max(won - lost - half, -1.0), 4), round(min(won - lost + half, 1.0), 4)]
    p = float(binomtest(only_b, only_a + only_b).pvalue) if only_a + only_b else 1.0
    return {
        "a": int(a.sum()), "b": int(b.sum()), "difference": round((only_b - only_a) / n, 4), "interval": interval,
        "only_a": only_a, "only_b": only_b, "p_value": round(p, 6),
    }  # fmt: skip


def _sentence(document: Mapping[str, Any], called: str) -> str:
    time, arrivals = document["time_s"], document["arrivals"]
    if time["difference"] is None:
        first = f"times cannot be compared: both arrived with {time['pairs']} seeds"
    else:
        way = "faster" if time["difference"] < 0.0 else "slower"
        sign = -1.0 if time["difference"] < 0.0 else 1.0
        low, high = sorted(sign * end for end in time["interval"])
        size = f"{abs(time['difference']):.2f} s {way}, {low:.2f} to {high:.2f}"
        first = f"{called} is {size}" if low > 0.0 else f"times differ by no more than chance ({called} is {size})"
    share = 100.0 * arrivals["difference"]
    low, high = sorted(math.copysign(100.0, share) * end for end in arrivals["interval"])
    way = "more" if share > 0.0 else "fewer"
    if arrivals["p_value"] < 1.0 - LEVEL:
        size = f"{abs(share):.0f} % {way} runs of {called} arrived, {low:.0f} to {high:.0f} %"
    else:
        size = f"no {'fewer' if share > 0.0 else 'more'} failures than chance"
    return f"{first}; {size}; {document['pairs']} pairs"
