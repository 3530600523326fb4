"""What a verdict on a record of tests/contactrig.py is worth: right or wrong names, unknown, silent; its sizes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from bench_kit import Table
from contacteffects import EFFECTS

NULL = "nothing"  # the effect of a record in which nothing changed
SIZES = ("small", "middle", "large")
SHARE, SURE = 0.2, 3.0  # a size is right within this share of the change, or this many standard errors
INSIDE = 1.96  # standard errors of a 95 % interval
OUTCOMES = ("right", "also wrong names", "wrong names", "unknown", "silent")


@dataclass(frozen=True)
class Job:
    """A record: of which rig, with what effect (NULL: none) of what size (0 to 2), and the seed of its sines."""

    rig: int
    effect: str
    size: int
    seed: int


@dataclass(frozen=True)
class Outcome:
    """What a record was called. sizes: per parameter told and known [true, told, standard error, before]; remaining,
    before, after: of the verdict; seconds: that it took, without its reference."""

    job: Job
    verdict: str
    names: list[str]
    alike: list[list[str]]
    sizes: dict[str, list[float]]
    remaining: float
    before: float
    after: float
    seconds: float
    sentence: str = ""

    @property
    def expected(self) -> tuple[str, ...]:
        """Names that are right; nothing else than silence is, where there are none."""
        return () if self.job.effect == NULL else EFFECTS[self.job.effect].names

    @property
    def nameless(self) -> bool:
        """Whether something changed that has no name."""
        return self.job.effect != NULL and EFFECTS[self.job.effect].nameless

    @property
    def outcome(self) -> str:
        """One of OUTCOMES. A name that the verdict cannot tell from a right one is right, too."""
        own = set(self.expected)
        doubts = {name for group in self.alike if own & set(group) for name in group}
        near = set() if self.job.effect == NULL else set(EFFECTS[self.job.effect].near)
        named = set(self.names)
        if self.nameless:
            told = self.verdict == "unknown_effect"
            return "wrong names" if named - near else "right" if told else "silent"
        right = bool(named & (own | doubts)) if own else not named and self.verdict == "nothing_missing"
        surplus = named - own - doubts - near
        if right:
            return "also wrong names" if surplus else "right"
        if named:
            return "wrong names"
        return "unknown" if self.verdict == "unknown_effect" else "silent"

    @property
    def size_right(self) -> bool | None:
        """Whether all sizes are near the truth; None without any."""
        near = [
            abs(told - true) <= max(SHARE * abs(true - before), SURE * stderr)
            for true, told, stderr, before in self.sizes.values()
        ]
        return all(near) if near else None

    @property
    def inside(self) -> list[bool]:
        """Which 95 % intervals hold the truth."""
        return [abs(told - true) <= INSIDE * stderr for true, told, stderr, _ in self.sizes.values()]


def rows(done: Sequence[Outcome]) -> Table:
    """A row for each size of each effect."""
    head = ("effect", "size", *OUTCOMES, "size right", "other names", "error 40 samples ahead, rad", "s")
    table = Table(head)
    for name in (NULL, *EFFECTS):
        for i, size in enumerate(SIZES):
            here = [o for o in done if o.job.effect == name and o.job.size == i]
            if not here:
                continue
            judged = [o.size_right for o in here if o.size_right is not None]
            table.add(
                name, "" if name == NULL else size,
                *(sum(o.outcome == kind for o in here) or "" for kind in OUTCOMES),
                f"{sum(judged)} of {len(judged)}" if judged else "",
                ", ".join(sorted({name for o in here for name in o.names if name not in o.expected})),
                f"{_mean([o.before for o in here]):.3f} -> {_mean([o.after for o in here]):.3f}",
                f"{_mean([o.seconds for o in here]):.0f}",
            )  # fmt: skip
    return table


def totals(done: Sequence[Outcome]) -> Table:
    """Figures over all records."""
    nameless = [o for o in done if o.nameless]
    quiet = [o for o in done if not o.expected and not o.nameless]
    loud = [o for o in done if o.expected]
    right = [o for o in loud if o.outcome in ("right", "also wrong names")]
    sizes = [o.size_right for o in right if o.size_right is not None]
    inside = [held for o in right for held in o.inside]
    table = Table(("what", "figure"))
    table.add("alarms where nothing changed", _share(sum(o.outcome != "right" for o in quiet), len(quiet)))
    table.add("effects named rightly", _share(len(right), len(loud)))
    table.add("and nothing else", _share(sum(o.outcome == "right" for o in loud), len(loud)))
    unknown = sum(o.outcome == "right" for o in nameless)
    table.add("called unknown where nothing has a name", _share(unknown, len(nameless)))
    wrong = sum("wrong" in o.outcome for o in (*loud, *nameless))
    table.add("wrong names", _share(wrong, len(loud) + len(nameless)))
    table.add(
        f"sizes within {100 * SHARE:.0f} % of the change or {SURE:g} standard errors", _share(sum(sizes), len(sizes))
    )
    table.add("95 % intervals that hold the truth", _share(sum(inside), len(inside)))
    return table


def _mean(values: Sequence[float]) -> float:
    return sum(values) / len(values)


def _share(part: int, whole: int) -> str:
    return f"{part} of {whole} ({100.0 * part / whole:.0f} %)" if whole else "none"
