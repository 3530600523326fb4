"""The Gymnasium environment: the section `gym` of BENCHMARKS.md.

How many samples a second it makes, alone and many at once, on one thread and on two; what of that the walls cost; and
whether walls that cost less change anything.
"""

from __future__ import annotations

# pyright: reportAttributeAccessIssue=false
# (MuJoCo's compiled module tells type checkers nothing of its names)
import time
from collections.abc import Callable
from typing import Any

import gymnasium
import mujoco
import numpy as np

import mazeplan.apps.environment as room
from mazeplan.core.display import NullDisplay
from mazeplan.core.records import LEVEL, Command
from mazeplan.learning.modelfile import load_model
from mazeplan.maze.mapfile import load_map
from mazeplan.rigs.sim.fleet import Fleet
from mazeplan.rigs.sim.mjcf import mjcf
from mazeplan.rigs.sim.nearwalls import near_walls
from mazeplan.rigs.sim.settings import SimulatedSettings
from mazeplan.rigs.sim.simulated import SimulatedRig
from mazeplan.run.loop import Run
from mazeplan.run.specification import Job, Setup

ASKED = 3000.0  # samples a second on two cores; at 30 Hz 100 s of rig time
SIZES = (1, 4, 16, 64, 256, 512)
HOLD = 5  # samples for which a drawn action stays
SEGMENTS = (192, 360, 720)


def rate(number: int, threads: int, seconds: float, **options: Any) -> float:
    """Samples a second of all environments together, with random actions from all rings."""
    envs = gymnasium.make_vec(room.ID, num_envs=number, threads=threads, start_ring="any", **options)
    envs.reset(seed=0)
    rng = np.random.default_rng(0)

    def play(seconds: float) -> float:
        steps, began = 0, time.perf_counter()
        actions = np.zeros((number, 2), dtype=np.float32)
        while time.perf_counter() - began < seconds:
            if steps % HOLD == 0:
                actions = rng.uniform(-1.0, 1.0, (number, 2)).astype(np.float32)
            envs.step(actions)
            steps += 1
        return steps * number / (time.perf_counter() - began)

    play(0.5 * seconds)  # models of walls are made where balls come for the first time
    reached = play(seconds)
    envs.close()
    return reached


def _placed(model: mujoco.MjModel, ring: int) -> mujoco.MjData:
    maze, data = load_map("cme"), mujoco.MjData(model)
    data.qpos[2:6] = maze.track_radius(ring), 0.0, maze.ball.radius, 1.0
    return data


def cost_of_walls(settings: SimulatedSettings, samples: int) -> tuple[int, float, int, float, bool]:
    """Boxes and us a step of MuJoCo with all walls, the same with those near the ball, and whether the ball went the
    same way to the last bit, in all of these samples."""
    maze = load_map("cme")
    whole, near = mujoco.MjModel.from_xml_string(mjcf(maze, settings)), near_walls(maze, settings)
    same, took = True, np.zeros(2)

    def passed(step: Callable[[], object]) -> float:
        began = time.thread_time()
        step()
        return time.thread_time() - began

    for ring in (1, 2, 3, 4):
        rng, one, other = np.random.default_rng(ring), _placed(whole, ring), _placed(near.any, ring)
        mujoco.mj_forward(whole, one)
        mujoco.mj_forward(near.at(*other.qpos[2:4]), other)
        for k in range(samples):
            if k % HOLD == 0:
                one.ctrl[:] = other.ctrl[:] = rng.uniform(-1.0, 1.0, 2) * maze.tilt_limit
            took[0] += passed(lambda data=one: mujoco.mj_step(whole, data, nstep=20))
            took[1] += passed(lambda data=other: [near.step(data, 4) for _ in range(5)])
            same = same and np.array_equal(one.qpos, other.qpos) and np.array_equal(one.qvel, other.qvel)
    us = 1e6 * took / (4 * 20 * samples)
    return whole.ngeom, float(us[0]), near.any.ngeom, float(us[1]), same


def navigations(runs: int) -> tuple[int, int, int]:
    """Navigations on the toy with all its walls, each command given to a fleet's rig as well: how many arrived, how
    many samples, and in how many of them both were the same to the last bit."""
    maze = load_map("cme")
    arrived = samples = same = 0
    for seed in range(runs):
        rig, fleet = SimulatedRig(maze, toy(maze)), Fleet(maze, toy(maze), 1, threads=1)
        theta, row = float(np.random.default_rng(seed).uniform(-np.pi, np.pi)), np.array([0])
        rig.reset(ring=1, theta=theta, rng=np.random.default_rng(seed))
        fleet.reset(row, [1], [theta], [np.random.default_rng(seed)])
        told = _Told(rig)
        run = Run(told, Setup(maze, load_model("toy"), rig_name="toy"), Job(1, 5, theta), None, NullDisplay())  # pyright: ignore[reportArgumentType]
        observation, status = rig.observe(), "RUNNING"
        while status == "RUNNING" and observation.t < 20.0:
            status = run.tick(observation)
            fleet.step(row, np.array([[told.last.u_beta, told.last.u_gamma]]))
            observation = rig.observe()
            positions, velocities = fleet.state(0)
            data = rig.machine.data
            same += np.array_equal(positions, data.qpos) and np.array_equal(velocities, data.qvel)
            samples += 1
        arrived += status == "SUCCESS"
    return arrived, samples, same


class _Told:
    """A rig that keeps its last command."""

    def __init__(self, rig: SimulatedRig) -> None:
        self.rate_hz, self.last, self._rig = rig.rate_hz, LEVEL, rig

    def command(self, u_beta: float, u_gamma: float) -> None:
        self.last = Command(u_beta, u_gamma)
        self._rig.command(u_beta, u_gamma)


def toy(maze: object, segments: int | None = None) -> SimulatedSettings:
    """Settings of the packaged rig, with so many boxes a circle of wall."""
    from mazeplan.rigs.registry import make_rig

    rig = make_rig("toy", maze)  # pyright: ignore[reportArgumentType]
    settings = rig.settings
    return settings if segments is None else settings.model_copy(update={"wall_segments": segments})


def gym_section(quick: bool) -> list[str]:
    """Steps a second, cost of walls, and what cheaper walls change."""
    seconds, maze = (0.5 if quick else 8.0), load_map("cme")
    rows = [
        "## Gymnasium environment",
        "",
        f"`{room.ID}` on `toy`, random actions held for {HOLD} samples, balls in all rings. Samples (30 a second of",
        f"the rig) of all environments together, a second; asked for: {ASKED:,.0f} on two cores.",
        "",
        "| environments | one thread | two threads | of one |",
        "|---|---|---|---|",
    ]
    best = 0.0
    for number in SIZES[:3] if quick else SIZES:
        one, two = (rate(number, threads, seconds) for threads in (1, 2))
        best = max(best, two)
        rows.append(f"| {number} | {one:,.0f} | {two:,.0f} | {two / one:.2f} |")
    pixels = rate(4, 2, seconds, observation="pixels")
    rows += ["", f"With pictures of 96 x 96, 4 environments, two threads: {pixels:,.0f} a second.", ""]
    word = "reached" if best >= ASKED else "not reached"
    rows += [f"The most on two threads is {best:,.0f} samples, {best / 30.0:,.0f} s of rig time, a second: {word}.", ""]
    rows += [
        "### Walls",
        "",
        "Processor time of one step of MuJoCo (20 a sample), all walls against those near the ball.",
    ]
    rows += ["", "| boxes a circle | boxes in all | us a step | boxes near | us a step | times | the ball went |"]
    rows.append("|---|---|---|---|---|---|---|")
    for segments in SEGMENTS:
        geoms, slow, few, fast, same = cost_of_walls(toy(maze, segments), 30 if quick else 200)
        way = "the same way to the last bit" if same else "another way"
        rows.append(f"| {segments} | {geoms} | {slow:.1f} | {few} | {fast:.1f} | {slow / fast:.2f} | {way} |")
    arrived, samples, same = navigations(1 if quick else 8)
    rows += [
        "",
        f"{1 if quick else 8} navigations on `toy` with all walls, each command given to a rig of a fleet as well: "
        f"{arrived} arrived,",
        f"ball and plate were the same to the last bit after {same} of {samples} samples. So energy lost in a turn, "
        "passages of",
        "openings and times of navigations are those of all walls.",
    ]
    return rows
