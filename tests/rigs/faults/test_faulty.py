"""Each kind of fault does what it says: on a rig inside whose samples and commands are known."""

from __future__ import annotations

import math
import threading
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from mazeplan.core.errors import RigError
from mazeplan.core.records import Observation
from mazeplan.maze.mapfile import load_map
from mazeplan.rigs.faults.faulty import FaultyRig
from mazeplan.rigs.faults.kinds import KINDS
from mazeplan.rigs.faults.schedule import Drawn, every_kind
from mazeplan.rigs.interface import Rig

MAZE = load_map("cme")
DT = 1.0 / 30.0
AT, UNTIL = 10 * DT, 20 * DT  # s: samples 10 to 19


class Scripted:
    """Sample k: t = k / 30, x = 0.08 + k / 1e4, y = k / 1e4, beta = k / 1e3, gamma = -k / 1e3."""

    rate_hz = 30.0

    def __init__(self, maze=MAZE, settings=None):
        self.commands, self.injected, self.k, self.levelled = [], [], 0, 0

    def reset(self, *, ring, theta, rng):
        self.k = 0

    @staticmethod
    def sample(k):
        return Observation(k * DT, 0.08 + 1e-4 * k, 1e-4 * k, 1e-3 * k, -1e-3 * k)

    def observe(self):
        self.k += 1
        return self.sample(self.k - 1)

    def command(self, u_beta, u_gamma):
        self.commands.append((self.k - 1, u_beta, u_gamma))

    def level(self):
        self.levelled += 1

    def close(self):
        pass


class Machine(Scripted):
    def inject(self, fault):
        self.injected.append((self.k - 1, fault))


def drawn(name, size=None, axes=(0,), until=UNTIL, seed=5):
    kind = KINDS[name]
    size = size if size is not None else kind.size[0] if kind.size else 0.0
    return Drawn(kind, AT - 1e-6, until - 1e-6, size, axes, seed)


def outer(*faults, inside=None, shut=str, aimed_at=lambda: None):
    rig = FaultyRig(inside or Scripted(), MAZE, faults, shut)
    rig.aimed_at = aimed_at
    rig.reset(ring=1, theta=0.0, rng=np.random.default_rng(0))
    return rig


def seen(*faults, n=30):
    rig = outer(*faults)
    return [rig.observe() for _ in range(n)]


def told(rig, n=30):
    """Commands by number that reached the rig inside, as (sample, number), of one a sample."""
    for k in range(n):
        rig.observe()
        rig.command(1e-4 * k, 0.0)
    return [(k, round(1e4 * u)) for k, u, _ in rig.inside.commands]


def outside_is_untouched(samples):
    return all(sample == Scripted.sample(k) for k, sample in enumerate(samples) if not 10 <= k < 20)


def test_it_is_a_rig_and_without_faults_nothing_changes():
    assert isinstance(outer(), Rig)
    assert seen() == [Scripted.sample(k) for k in range(30)]
    assert told(outer()) == [(k, k) for k in range(30)]


TRUE = Scripted.sample
EXPECTED = {
    "frames_lost": lambda k: replace(TRUE(k), x=None, y=None),
    "frames_frozen": lambda k: replace(TRUE(k), x=TRUE(9).x, y=TRUE(9).y),
    "frames_late": lambda k: replace(TRUE(k), x=TRUE(k - 3).x, y=TRUE(k - 3).y),
    "axes_swapped": lambda k: replace(TRUE(k), x=TRUE(k).y, y=TRUE(k).x),
    "tilt_frozen": lambda k: replace(TRUE(k), beta=TRUE(9).beta),
    "tilt_drift": lambda k: replace(TRUE(k), beta=TRUE(k).beta + math.radians(1.0) * (k - 10) / 10),
}


@pytest.mark.parametrize("name", EXPECTED)
def test_what_arrives(name):
    samples = seen(drawn(name))
    assert outside_is_untouched(samples)
    for k in range(10, 20):
        for field in ("t", "x", "y", "beta", "gamma"):
            expected = getattr(EXPECTED[name](k), field)
            got = getattr(samples[k], field)
            assert got == (None if expected is None else pytest.approx(expected, abs=1e-6)), (k, field)


@pytest.mark.parametrize(("name", "fields"), [("position_nan", ("x", "y")), ("tilt_nan", ("beta",))])
def test_what_is_no_number(name, fields):
    samples = seen(drawn(name))
    assert outside_is_untouched(samples)
    for sample in samples[10:20]:
        for field in ("t", "x", "y", "beta", "gamma"):
            assert math.isnan(getattr(sample, field)) == (field in fields)


def test_duplicated_and_out_of_order_samples_keep_their_time():
    copies = seen(drawn("frames_duplicated", 0.5, until=300 * DT), n=310)
    assert all(sample in (TRUE(k), TRUE(k - 1)) for k, sample in enumerate(copies))
    assert 100 < sum(sample == TRUE(k - 1) for k, sample in enumerate(copies)) < 190
    mixed = seen(drawn("frames_out_of_order", 3.0, until=300 * DT), n=310)
    back = [k - round(sample.t / DT) for k, sample in enumerate(mixed)]
    assert set(back[10:300]) == {0, 1, 2}
    assert not any(back[:10] + back[300:])
    assert sum(b.t < a.t for a, b in pairwise(mixed)) > 30


def test_clocks():
    late = [s.t - TRUE(k).t for k, s in enumerate(seen(drawn("clock_jitter", 5.0, until=300 * DT), n=310))]
    assert np.std(late[10:300]) == pytest.approx(5e-3, rel=0.2)
    assert not any(late[:10] + late[300:])
    jumped = [s.t - TRUE(k).t for k, s in enumerate(seen(drawn("clock_jump", 0.7, until=math.inf)))]
    assert jumped == pytest.approx([0.0] * 10 + [0.7] * 20)
    stopped = [s.t for s in seen(drawn("clock_stopped", until=math.inf))]
    assert stopped == pytest.approx([min(k, 9) * DT for k in range(30)])


def test_commands_that_are_lost_or_late():
    assert told(outer(drawn("commands_lost"))) == [(k, k) for k in range(30) if not 10 <= k < 20]
    late = told(outer(drawn("commands_late", 3 * DT)))
    assert [pair for pair in late if pair[0] < 20] == [(k, k) for k in range(10)] + [(k, k - 3) for k in range(13, 20)]
    assert late[-1] == (29, 29)
    assert [number for _, number in late] == sorted(number for _, number in late)  # never an older one after a newer


@pytest.mark.parametrize("name", ["commands_late", "commands_lost"])
def test_level_gets_through_and_nothing_comes_after_it(name):
    rig = outer(drawn(name, 3 * DT))
    for _ in range(12):
        rig.observe()
        rig.command(0.01, 0.0)
    before = list(rig.inside.commands)
    assert len(before) == 10
    assert not rig.levelled
    rig.level()
    assert rig.levelled
    assert rig.inside.levelled == 1
    for _ in range(6):
        rig.observe()
    assert rig.inside.commands == before


def test_observe_raises_or_hangs():
    rig = outer(drawn("observe_raises", until=math.inf))
    for _ in range(10):
        rig.observe()
    with pytest.raises(RigError, match="injected"):
        rig.observe()
    rig = outer(drawn("observe_hangs", 30.0))
    for _ in range(10):
        rig.observe()
    waiting = threading.Thread(target=rig.observe, daemon=True)
    waiting.start()
    waiting.join(0.2)
    assert waiting.is_alive()
    rig.close()  # lets go of it
    waiting.join(5.0)
    assert not waiting.is_alive()


MACHINE = {
    "ball_elsewhere": ["teleport"], "ball_taken_out": ["removed"], "ball_gone": ["removed"], "ball_stuck": ["stuck"],
    "ball_pushed": ["push"], "gate_blocked": ["blocked"], "gates_blocked": ["blocked"] * 4,
    "servo_stuck": ["dead_axis"], "servo_slow": ["slow_axis"], "servo_offset": ["offset_axis"],
    "brown_out": ["brown_out"],
}  # fmt: skip


@pytest.mark.parametrize("name", MACHINE)
def test_faults_of_the_machine_are_injected(name):
    rig = outer(drawn(name), inside=Machine())
    for _ in range(30):
        rig.observe()
    assert [k for k, _ in rig.inside.injected] == [10] * len(MACHINE[name])
    faults = [fault for _, fault in rig.inside.injected]
    assert [fault.kind for fault in faults] == MACHINE[name]
    assert faults[0].at_s == pytest.approx(AT)
    if name not in ("ball_elsewhere", "ball_pushed"):
        assert faults[0].duration_s == pytest.approx(UNTIL - AT, abs=1e-4)
    if name == "ball_elsewhere":
        assert faults[0].ring != 1
    if name in ("servo_slow", "servo_offset"):
        assert abs(faults[0].slew_deg_s if name == "servo_slow" else faults[0].offset_deg) == KINDS[name].size[0]
    if "blocked" in name:
        assert [fault.opening for fault in faults] == (
            ["1-2@45"] if len(faults) == 1 else [o.name for o in MAZE.openings_between(1, 2)]
        )


def test_orders_close_the_next_opening():
    closed = []
    driver = {"shut": closed.append, "aimed_at": lambda: "2-3@180"}
    rig = outer(drawn("opening_closed"), **driver)
    for _ in range(30):
        rig.observe()
    assert closed == ["2-3@180"]
    rig = outer(drawn("openings_closed"), **driver)
    for _ in range(30):
        rig.observe()
    assert sorted(closed[1:]) == sorted(o.name for o in MAZE.openings_between(2, 3))


def test_a_reset_begins_the_schedule_anew():
    rig = outer(drawn("frames_flicker", 0.5), drawn("opening_closed"))
    first = [rig.observe() for _ in range(30)]
    assert len(rig.begun) == 2
    rig.reset(ring=1, theta=0.0, rng=np.random.default_rng(0))
    assert rig.begun == []
    assert [rig.observe() for _ in range(30)] == first
    assert len(rig.begun) == 2


def test_every_kind_can_be_drawn_by_seed():
    trials = every_kind()
    assert len(trials) >= 30
    for trial in trials:
        (one,), (again,), (other,) = trial.draw(1), trial.draw(1), trial.draw(2)
        assert one == again
        assert one.at_s != other.at_s
        assert 0.3 <= one.at_s <= 1.5
        if one.kind.size is not None:
            assert one.kind.size[0] <= one.size <= one.kind.size[1]
