"""Time is the rig's: nothing that decides looks at a clock on the wall, and a run is the same at any speed."""

from __future__ import annotations

import ast
import time
from pathlib import Path

import pytest
from planar_rig import PATIENT, PlanarRig, known

import mazeplan
from mazeplan.core import resources
from mazeplan.core.progress import Display
from mazeplan.maze.mapfile import load_map
from mazeplan.run.loop import Run
from mazeplan.run.specification import Job, Setup

PACKAGE = Path(mazeplan.__file__).parent
CLOCKS = ("time", "datetime", "timeit", "sched", "asyncio", "calendar")
LOOKS = ("perf_counter", "perf_counter_ns", "monotonic", "monotonic_ns", "process_time", "time_ns", "sleep", "utcnow",
         "today", "clock_gettime", "times")  # fmt: skip
ALLOWED = {  # who may look at it, and for what
    "control/ilqg.py": {"import time", "perf_counter"},  # handed in; what it decided is in the log
    "run/loop.py": {"from time import perf_counter"},  # how long a tick took, for the report
    "rigs/watchdog.py": {"from time import monotonic"},  # judges the loop from outside
    "rigs/faults/faulty.py": {"from time import monotonic"},  # when a call was made to hang ...
    "rigs/paced.py": {"from time import monotonic"},  # holds a simulation to it, where somebody looks
    # ... and how long it did, for the report; and what a run cost
    "run/campaign/one_run.py": {f"from time import {name}" for name in ("monotonic", "perf_counter", "process_time")},
    "run/campaign/store.py": {"from datetime import UTC", "from datetime import datetime"},  # when it ended
    "core/logs/run_log.py": {"from datetime import UTC", "from datetime import datetime"},  # when it began, told
    "apps/cli/progress.py": {"from time import monotonic"},  # how long nothing was printed
    "apps/cli/map.py": {"import time", "sleep"},  # how often a file is looked at
    "apps/cli/live.py": {"from time import monotonic"},  # how long nobody has looked
    "apps/cli/calibrate.py": {"from datetime import date", "today"},  # when a calibration was made
}
MACHINES = (
    "rigs/link/",
    "rigs/camera/source.py",
    "rigs/hardware/",
)  # of wood and wire: a rig's clock is made of theirs
PEOPLE = ("apps/view/",)  # the page is drawn so many times a second, in a process of its own, and decides nothing
MAZE = load_map("cme")


def looks_at_clocks(source: str) -> set[str]:
    """What in a module's source gets at wall time."""
    found = set()
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            found |= {f"import {a.name}" for a in node.names if a.name.split(".")[0] in CLOCKS}
        elif isinstance(node, ast.ImportFrom) and (node.module or "").split(".")[0] in CLOCKS:
            found |= {f"from {node.module} import {a.name}" for a in node.names}
        elif isinstance(node, ast.Attribute) and node.attr in LOOKS:
            found.add(node.attr)
        elif isinstance(node, ast.Constant) and node.value in ("now", "today"):
            found.add(repr(node.value))  # numpy.datetime64("now")
    return found


def test_only_stopwatches_and_the_watchdog_look_at_a_clock():
    files = {path.relative_to(PACKAGE).as_posix(): path for path in PACKAGE.rglob("*.py")}
    for room in ("behavior", "control", "control/estimation", "core/logs", "maze", "learning"):
        assert any(name.startswith(f"{room}/") for name in files)
    found = {
        name: looks_at_clocks(path.read_text(encoding="utf-8"))
        for name, path in files.items()
        if not name.startswith(MACHINES + PEOPLE)
    }
    assert {name: looks for name, looks in found.items() if looks} == ALLOWED


@pytest.mark.parametrize(
    "source",
    [
        "import time",
        "import time as t",
        "from time import monotonic as m",
        "from datetime import datetime",
        "import datetime; datetime.datetime.now()",
        "def f():\n    import asyncio",
        "clock.perf_counter()",
        "import os; os.times()",
        "import numpy as np; np.datetime64('now')",
    ],
)
def test_every_way_to_a_clock_is_found(source):
    assert looks_at_clocks(source)
    assert not looks_at_clocks("from mazeplan.behavior import context\ncontext.now\nrun.clock()\ntimeout = 3")


class Paced:
    """A rig whose samples come no earlier than they are due, at `speed` times real time; 0: as fast as it can."""

    def __init__(self, rig: PlanarRig, speed: float) -> None:
        self.rig, self.speed, self.rate_hz = rig, speed, rig.rate_hz
        self.began, self.slept = time.monotonic(), 0.0

    def __getattr__(self, name):
        return getattr(self.rig, name)

    def reset(self, **more):
        self.rig.reset(**more)
        self.began = time.monotonic()

    def observe(self):
        observation = self.rig.observe()
        if self.speed:
            left = self.began + observation.t / self.speed - time.monotonic()
            self.slept += max(left, 0.0)
            time.sleep(max(left, 0.0))
        return observation


class Kept(Display):
    """Notes leaves and events with their rig times."""

    def __init__(self):
        self.seen = []

    def event(self, t, text):
        self.seen.append((t, text))

    def tick(self, t, ring, text):
        self.seen.append((t, ring, text))


def hide(rig):
    rig.hidden = 0.3 < rig.t < 1.1  # lost: there is waiting in it


def waiting(tmp_path):
    """The packaged tree behind everything that waits: Delay, Timeout, and Wait where there is one."""
    text = (resources.share("behaviors") / "navigate.xml").read_text(encoding="utf-8")
    text = text.replace('main_tree_to_execute="Navigate"', 'main_tree_to_execute="Late"')
    late = (
        '<BehaviorTree ID="Late"><Timeout msec="9000"><Delay delay_msec="250"><SubTree ID="Navigate" '
        '_autoremap="true"/></Delay></Timeout></BehaviorTree></root>'
    )
    path = tmp_path / "late.xml"
    path.write_text(text.replace("</root>", late), encoding="utf-8")
    return str(path)


@pytest.mark.slow
def test_a_run_is_the_same_at_any_speed(tmp_path):
    setup = Setup(MAZE, known(MAZE), waiting(tmp_path), "planar", settings=PATIENT)
    seen, took = {}, {}
    for speed in (0.0, 1.0, 50.0):
        rig = PlanarRig(MAZE, mishap=hide)
        paced, kept = Paced(rig, speed), Kept()
        run = Run(paced, setup, Job(3, 5, 0.3), None, kept)  # pyright: ignore
        began = time.monotonic()
        result = run.drive()
        took[speed] = time.monotonic() - began
        assert result.success
        assert speed != 1.0 or paced.slept > 0.0
        seen[speed] = kept.seen, rig.commands, result.rings, result.failures, result.time_s
    assert seen[0.0] == seen[1.0] == seen[50.0]
    assert took[1.0] > result.time_s - 0.1  # it was real time
    assert took[50.0] < took[1.0]
    texts = {entry[-1] for entry in seen[0.0][0]}
    assert any("ball_lost" in text for text in texts)
    assert seen[0.0][1][5] == (0.0, 0.0)  # still in Delay
