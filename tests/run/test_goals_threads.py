"""Requests with wrong names raise in the call; any thread may make requests."""

from __future__ import annotations

import threading

from planar_rig import PlanarRig
from talking import MAZE, NAMES, go, said

from mazeplan.core.logs.run_log import read_log
from mazeplan.run.goals import Goals
from mazeplan.run.navigate import navigate


def test_threads_may_all_talk_at_once(tmp_path):
    """Every message arrives, once; the newest goal is the one that is reached."""
    goals, threads = Goals(MAZE), []
    ready, last = threading.Barrier(5), threading.Event()

    def talk(n):
        ready.wait(10.0)
        for k in range(50):
            assert goals.aim(2 + (n + k) % 3)
            assert goals.close(NAMES[-1 - n])
            assert goals.open(NAMES[-1 - n])

    def start():
        threads.extend(threading.Thread(target=talk, args=(n,), daemon=True) for n in range(4))
        for thread in threads:
            thread.start()
        ready.wait(10.0)

    def join():
        for thread in threads:
            thread.join()
        goals.aim(2)
        last.set()

    result, rig = go({2: start, 20: join}, goals=goals, log=tmp_path / "a.mcap")
    assert last.is_set()
    assert result.success
    assert rig.ring == 2
    events = [kind for _, kind, _ in said(read_log(tmp_path / "a.mcap"))]
    assert (events.count("goal"), events.count("closed"), events.count("opened")) == (201, 200, 200)


def test_a_thread_of_the_user_gives_another_goal_through_the_public_names():
    from mazeplan import Goals

    goals, began = Goals("cme"), threading.Event()

    def person():
        began.wait(10.0)
        goals.aim("ring2")
        goals.aim("ring3")
        seen.set()

    seen = threading.Event()
    thread = threading.Thread(target=person, daemon=True)
    thread.start()

    class Waiting(PlanarRig):
        def observe(self):
            if len(self.commands) == 10:
                began.set()
                assert seen.wait(10.0)
            return super().observe()

    rig = Waiting(MAZE)
    result = navigate("ring1", "ring5", map=MAZE, rig=rig, start_angle_deg=20.0, goals=goals)
    thread.join()
    assert result.success
    assert rig.ring == 3
