from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
import pytest

from mazeplan.core.maths.fingerprint import fingerprint
from mazeplan.learning.modelfile import load_model
from mazeplan.maze.mapfile import load_map
from mazeplan.run.resolve import resolve_model


@dataclass(frozen=True)
class Thing:
    size: float = 1.0
    rows: np.ndarray = field(default_factory=lambda: np.arange(3.0))
    names: tuple[str, ...] = ("a", "b")
    more: dict = field(default_factory=lambda: {1: "x", 2: None})


@dataclass(frozen=True)
class Other:
    size: float = 1.0
    rows: np.ndarray = field(default_factory=lambda: np.arange(3.0))
    names: tuple[str, ...] = ("a", "b")
    more: dict = field(default_factory=lambda: {1: "x", 2: None})


@pytest.mark.parametrize(
    "other",
    [
        Thing(size=np.nextafter(1.0, 2.0)),
        Thing(rows=np.array([0.0, 1.0, np.nextafter(2.0, 3.0)])),
        Thing(rows=np.arange(3.0)[:, None]),
        Thing(rows=np.arange(3.0).astype(np.float32)),
        Thing(names=("ab",)),
        Thing(names=("b", "a")),
        Thing(more={1: "x", 2: 0}),
        Thing(more={1: "x"}),
        Other(),
    ],
)
def test_whatever_differs_is_told(other):
    assert fingerprint(other) != fingerprint(Thing())


def test_what_is_the_same_is_the_same():
    assert fingerprint(Thing()) == fingerprint(Thing(more={2: None, 1: "x"}))
    assert fingerprint(Thing(size=1.0)) == fingerprint(Thing(size=np.float64(1.0)))
    assert fingerprint(Thing(rows=np.arange(6.0)[::2])) == fingerprint(Thing(rows=np.array([0.0, 2.0, 4.0])))
    assert len(fingerprint(Thing())) == 64


def test_models_are_told_apart_by_every_number():
    toy = load_model("toy")
    assert fingerprint(toy) == fingerprint(resolve_model("toy", None, load_map("cme")))
    process = toy.processes[2]
    alpha = process.alpha.copy()
    alpha[7] = np.nextafter(alpha[7], 1.0)
    bent = replace(toy, processes={**toy.processes, 2: replace(process, alpha=alpha)})
    later = replace(toy, camera_delay=np.nextafter(toy.camera_delay, 1.0))
    assert len({fingerprint(model) for model in (toy, bent, later)}) == 3
