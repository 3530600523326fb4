"""A conformance suite for any rig: `check_rig(rig, maze)` or `mazeplan rig check`.

Each check resets the rig, drives it for a second or two, and reports in one sentence. On hardware a person places the
ball at each reset. `repeatable=False` skips the checks that only a simulation can pass.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from numbers import Real

import numpy as np

from mazeplan.core.errors import MazeplanError
from mazeplan.core.maths.angles import difference
from mazeplan.core.records import Observation
from mazeplan.maze.geometry import Maze
from mazeplan.rigs.interface import Rig, traits

TILT = math.radians(3.0)  # rad, tilt of the test commands
SETTLED = math.radians(0.7)  # rad, allowed error of a tilt: servo, sensor noise and play together
SETTLE_S = 0.8  # s, twice the settling time of a slow servo
RAISED = "raised "  # begins the detail of a check in which the rig raised an error
CLOCK = 0.02  # largest relative error of a clock's period
UNEVEN = 0.3  # largest relative error of one step: pictures of a camera come a little early or late
LEAP = 4.5  # periods; a longer step between two samples means that the clock jumps or samples are lost
PLACED = 0.5  # rad, largest error of the ball's angle: a person places the ball by eye


@dataclass(frozen=True)
class CheckResult:
    """Result of one check."""

    name: str
    passed: bool
    detail: str


class UnfitError(Exception):
    """The rig fails a check; the message is a sentence about it."""


def _want(fit: bool, problem: str) -> None:
    if not fit:
        raise UnfitError(problem)


class RigTrial:
    """One rig under test."""

    def __init__(self, rig: Rig, maze: Maze, seed: int) -> None:
        self.rig = rig
        self.maze = maze
        self.seed = seed
        self.dt = 1.0 / rig.rate_hz
        self.leap: tuple[float, float] | None = None  # times before and after the clock's first jump, s

    def reset(self, ring: int = 1, theta: float = 0.0) -> None:
        """Reset with the same random numbers each time."""
        self.rig.reset(ring=ring, theta=theta, rng=np.random.default_rng(self.seed))

    def observe(self) -> Observation:
        """The next sample. Raises UnfitError if it is no Observation, or if its values are not numbers."""
        sample = self.rig.observe()
        got = type(sample).__name__
        _want(isinstance(sample, Observation), f"observe() returned {got}, expected Observation(t, x, y, beta, gamma)")
        if sample.beta is None and sample.gamma is None:  # a rig without a tilt sensor
            sample = replace(sample, beta=math.nan, gamma=math.nan)
        others, balls = len(sample.others), traits(self.rig).balls
        _want(others == balls - 1, f"others: got {others} samples, expected {balls - 1} of a rig with balls = {balls}")
        for ball, field in itertools.product((sample, *sample.others), fields(sample)):
            value, unseen = getattr(ball, field.name), field.name in ("x", "y")
            fit = field.name == "others" or isinstance(value, Real) or (value is None and unseen)
            _want(fit, f"{field.name}: got {value!r}, expected a number{' or None' if unseen else ''}")
        return sample

    def run(self, seconds: float, u_beta: float = 0.0, u_gamma: float = 0.0) -> list[Observation]:
        """Samples under a constant command, repeated after each sample."""
        samples = []
        for _ in range(max(2, round(seconds / self.dt))):
            samples.append(self.observe())
            self.rig.command(u_beta, u_gamma)
        for a, b in itertools.pairwise(samples):
            if self.leap is None and not 0.0 < b.t - a.t < LEAP * self.dt:
                self.leap = a.t, b.t
        return samples


def check_rig(rig: Rig, maze: Maze, *, seed: int = 0, repeatable: bool = True) -> list[CheckResult]:
    """Run all checks; then level and close the rig, also if Ctrl-C ends them.

    A rig that raises an error in a check fails that check. The other checks run as well."""
    trial = RigTrial(rig, maze, seed)
    checks: list[tuple[str, Callable[[RigTrial], None]]] = [
        ("clock", _clock),
        ("observation", _observation),
        ("tilt follows beta", lambda t: _follows(t, "beta")),
        ("tilt follows gamma", lambda t: _follows(t, "gamma")),
        ("sign of beta", lambda t: _turns(t, "beta", 0.5 * math.pi)),
        ("sign of gamma", lambda t: _turns(t, "gamma", 0.0)),
        ("level", _level),
        ("refuses NaN", lambda t: _refuses(t, math.nan)),
        ("refuses beyond the limit", lambda t: _refuses(t, 1.5 * maze.tilt_limit)),
        ("limit is kept", _limit),
    ]
    if repeatable:
        checks += [("placing", _placing), ("repeatable", _repeatable)]
    checks += [("clock goes on", _goes_on), ("close", _close)]
    results, first = [], dict[str, str]()
    for name, check in checks:
        problem = None
        try:
            check(trial)
        except UnfitError as unfit:
            problem = str(unfit)
        except Exception as error:  # a rig may raise anything; a check reports it
            problem = f"{RAISED}{type(error).__name__}: {error}"
        except BaseException:  # Ctrl-C or a signal: no later check levels the plate
            _leave(rig)
            raise
        if problem in first:
            results.append(CheckResult(name, False, f"for the same reason as: {first[problem]}"))
        else:
            results.append(CheckResult(name, problem is None, problem or "ok"))
            first |= {} if problem is None else {problem: name}
    return results


def _clock(trial: RigTrial) -> None:
    trial.reset()
    times = [o.t for o in trial.run(0.5)]
    _want(abs(times[0]) <= trial.dt, f"the first sample after reset is at t = {times[0]:.4f} s, expected about 0")
    steps = np.diff(times)
    period = float(np.polyfit(np.arange(len(times)), times, 1)[0])
    uneven = np.any(np.abs(steps - trial.dt) > UNEVEN * trial.dt)
    what = f"t goes up by {steps.min():.5f} to {steps.max():.5f} s, expected {trial.dt:.5f} s (1 / rate_hz)"
    _want(not uneven and not abs(period - trial.dt) > CLOCK * trial.dt, what)


def _observation(trial: RigTrial) -> None:
    trial.reset(theta=1.0)
    samples = trial.run(0.5)
    for o in samples:
        tilted = math.isfinite(o.beta + o.gamma) or (math.isnan(o.beta) and math.isnan(o.gamma))
        got = f"{o.t}, {o.beta}, {o.gamma}"
        wanted = "finite numbers, or no tilt in both axes"
        _want(math.isfinite(o.t) and tilted, f"t, beta, gamma: got {got}, expected {wanted}")
        _want((o.x is None) == (o.y is None), "x and y must both be None or both be numbers")
        seen = o.x is None or o.y is None or math.isfinite(o.x + o.y)
        _want(seen, f"x, y: got {o.x}, {o.y}, expected finite numbers, or None where the ball is not seen")
    _placed(trial.maze, 1, 1.0, samples)


def _placed(maze: Maze, number: int, theta: float, samples: list[Observation]) -> None:
    """The ball on the level plate is where `reset` placed it."""
    seen = [(o.x, o.y) for o in samples if o.x is not None and o.y is not None]
    _want(bool(seen), "the ball was never seen")
    ring, radius = maze.ring(number), float(np.median([math.hypot(*place) for place in seen]))
    where = f"the ball was to be placed in ring {number}"
    hint = "; x and y are in m" if radius > 2.0 * maze.ring(1).outer_radius else ""
    inside = ring.inner_radius - 0.01 <= radius <= ring.outer_radius + 0.01
    _want(inside, f"{where} but is seen at r = {radius * 1e3:.1f} mm{hint}")
    at = math.atan2(seen[0][1], seen[0][0])
    near = radius <= PLACED * ring.outer_radius or abs(difference(at, theta)) <= PLACED
    _want(near, f"{where} at {math.degrees(theta):.0f} deg but is seen at {math.degrees(at):.0f} deg")


def _placing(trial: RigTrial) -> None:
    for ring in trial.maze.rings:
        for theta in (2.0, -2.0):
            trial.reset(ring.number, theta)
            _placed(trial.maze, ring.number, theta, trial.run(0.2))


def _goes_on(trial: RigTrial) -> None:
    if trial.leap is not None:
        before, after = trial.leap
        step = f"t went from {before:.4f} to {after:.4f} s between two samples"
        raise UnfitError(f"{step}, expected {trial.dt:.4f} s more")


def _follows(trial: RigTrial, axis: str) -> None:
    for u in (TILT, -TILT):
        trial.reset()
        samples = trial.run(SETTLE_S + 0.4, **{f"u_{axis}": u})
        late = [o for o in samples if o.t - samples[0].t >= SETTLE_S]
        _want(bool(late), f"t went from {samples[0].t:.4f} to {samples[-1].t:.4f} s in {len(samples)} samples")
        got = float(np.mean([getattr(o, axis) for o in late]))
        other = float(np.mean([getattr(o, "gamma" if axis == "beta" else "beta") for o in late]))
        measured = f"measured {math.degrees(got):+.2f} deg after {SETTLE_S} s"
        _want(not abs(got - u) > SETTLED, f"commanded {math.degrees(u):+.1f} deg, {measured}")
        _want(not abs(other) > SETTLED, f"the other axis went to {math.degrees(other):+.2f} deg")


def _turns(trial: RigTrial, axis: str, theta: float) -> None:
    """A positive tilt turns the ball from theta about the centre in the negative direction, within a second."""
    trial.reset(theta=theta)
    samples = trial.run(1.0, **{f"u_{axis}": TILT})
    seen = [math.atan2(o.y, o.x) for o in samples if o.x is not None and o.y is not None]
    turned = float(sum(difference(b, a) for a, b in itertools.pairwise(seen))) if seen else math.nan
    what = f"a ball at {math.degrees(theta):.0f} deg turned by {math.degrees(turned):+.1f} deg, expected < -3"
    _want(turned < -0.05, f"{axis} > 0: {what}")


def _settled(trial: RigTrial, samples: list[Observation]) -> tuple[float, float]:
    """Mean beta and gamma of the last 0.4 s, rad."""
    late = samples[-max(2, round(0.4 / trial.dt)) :]
    return float(np.mean([o.beta for o in late])), float(np.mean([o.gamma for o in late]))


def _level(trial: RigTrial) -> None:
    trial.reset()
    trial.run(0.5, TILT, -TILT)
    trial.rig.level()
    samples = [trial.observe() for _ in range(max(2, round((SETTLE_S + 0.4) / trial.dt)))]
    worst = max(abs(tilt) for tilt in _settled(trial, samples))
    hint = "if it looks level, set the tilt sensor to zero"
    _want(not worst >= SETTLED, f"level() left the plate at {math.degrees(worst):.2f} deg: {hint}")


def _refuses(trial: RigTrial, value: float) -> None:
    trial.reset()
    trial.rig.observe()
    for command in ((value, 0.0), (0.0, value)):
        try:
            trial.rig.command(*command)
        except (MazeplanError, ValueError):
            continue
        raise UnfitError(f"command{command} was taken, expected RigError or ValueError")


def _limit(trial: RigTrial) -> None:
    trial.reset()
    limit = trial.maze.tilt_limit
    worst = max(_settled(trial, trial.run(SETTLE_S + 0.4, limit, limit)))
    _want(not worst > limit + SETTLED, f"the plate went to {math.degrees(worst):.2f} deg at the limit")


def _repeatable(trial: RigTrial) -> None:
    runs = []
    for _ in range(2):
        trial.reset(theta=0.7)
        runs.append(trial.run(1.0, TILT, 0.5 * TILT))
    for a, b in zip(*runs, strict=True):
        _want(a == b, f"two runs with the same seed differ at t = {a.t:.3f} s: {a} and {b}")


def _close(trial: RigTrial) -> None:
    _leave(trial.rig)
    trial.rig.close()  # the caller reports an error here


def _leave(rig: Rig) -> None:
    """Level the plate, and close the rig also if that fails."""
    try:
        rig.level()
    finally:
        rig.close()
