"""Effects of sizes that nobody chose, in records of the tests' own plant: the right name, and a value that fits its own
standard error."""

from __future__ import annotations

import pytest
from bench_plant import run
from hypothesis import given, settings
from hypothesis import strategies as st
from plant_cases import NAMES, NOISE, RADII, Job, sized

pytestmark = pytest.mark.slow

DRAWN = settings(deadline=None, derandomize=True, database=None)


@settings(DRAWN, max_examples=4)
@given(
    name=st.sampled_from(NAMES),
    size=st.floats(1.0, 10.0),
    ring=st.sampled_from(sorted(RADII)),
    seed=st.integers(1000, 2000),
)
def test_an_effect_of_any_size_is_named(name: str, size: float, ring: str, seed: int) -> None:
    job = Job("drawn", *sized(name, size), ring, seed)
    found = run(job)
    assert found.names == [name], found.sentence
    assert found.deviations, found.sentence
    far = {parameter: off for parameter, off in found.deviations.items() if abs(off) > 5.0}
    assert not far, (far, found.sentence)


@settings(DRAWN, max_examples=2)
@given(
    ring=st.sampled_from(sorted(RADII)),
    seed=st.integers(1000, 2000),
    process=st.sampled_from((0.0, NOISE)),
)
def test_nothing_is_named_where_nothing_is_missing(ring: str, seed: int, process: float) -> None:
    found = run(Job("nothing", {}, {}, ring, seed, process))
    assert (found.verdict, found.names) == ("nothing_missing", [])
