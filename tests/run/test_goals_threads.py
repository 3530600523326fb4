"""Requests with wrong names raise in the call; any thread may make requests."""

from __future__ import annotations

import threading

from planar_rig import PlanarRig
from talking import MAZE

from mazeplan.run.execution import navigate


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
