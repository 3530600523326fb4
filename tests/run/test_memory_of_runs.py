"""Many runs in one process: what a run has made dies with it, and memory stays as it is."""

import gc
from pathlib import Path
from weakref import ref

import numpy as np
import pytest

from mazeplan import navigate
from mazeplan.behavior.context import RunContext
from mazeplan.maze.mapfile import load_map
from mazeplan.rigs.registry import make_rig

MAZE = load_map("cme")
STATUS = Path("/proc/self/status")


@pytest.fixture
def no_collector():
    gc.collect()
    gc.disable()
    yield
    gc.enable()


class Born:
    """Makes rigs, and remembers what they and their runs are made of without keeping it."""

    def __init__(self):
        self.parts = {}

    def rig(self, name="toy"):
        rig = make_rig(name, MAZE)
        self.parts["rig"], self.parts["machine"] = ref(rig), ref(rig.machine)
        return rig

    def watch(self, tree, context: RunContext):
        self.parts["tree"], self.parts["context"] = ref(tree), ref(context)
        self.parts["leaf"] = ref(list(tree.nodes())[-1])

    def left(self):
        return [name for name, part in self.parts.items() if part() is not None]


@pytest.mark.slow
def test_a_rig_its_model_and_the_tree_die_when_the_run_has_ended(no_collector):
    born = Born()
    navigate(1, 2, rig=born.rig(), time_limit=0.5, watch=born.watch)
    assert born.parts.keys() == {"rig", "machine", "tree", "context", "leaf"}
    assert born.left() == []


def test_a_closed_rig_lets_go_of_its_model(no_collector):
    rig = make_rig("toy", MAZE)
    rig.reset(ring=1, theta=0.3, rng=np.random.default_rng(0))
    gimbal = ref(rig.machine.gimbal)
    rig.close()
    assert gimbal() is None


def resident_mb():
    line = next(line for line in STATUS.read_text().splitlines() if line.startswith("VmRSS"))
    return int(line.split()[1]) / 1024


@pytest.mark.skipif(not STATUS.exists(), reason="reads /proc")
@pytest.mark.slow
def test_memory_is_flat_over_sixty_runs():
    rings = len(MAZE.rings)
    grown = []
    for seed in range(60):
        navigate(1 + seed % (rings - 1), seed=seed, time_limit=0.8)
        grown.append(resident_mb())
    assert max(grown[10:]) - grown[9] < 15.0
