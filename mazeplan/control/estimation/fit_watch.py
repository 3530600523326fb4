"""Whether a rig behaves as its model says, in the first seconds of motion: its stage and its ball.

The plate has to follow its commands. A bank of stages (at once, first order, second order; with dead times) gets the
commands of the run. Each predicts the measured tilts by its impulse response; sums of squares and products are all that
is kept. With P the predictions of one stage, y the measured tilts and G the matrix that fits best,

    y = G P + e,    G = (sum y P') (sum P P')^-1

G is near the identity on a healthy rig. A negative diagonal is a wrong sign, a large secondary diagonal exchanged
axes, another diagonal a gain. If G is right, but another stage of the bank leaves much less of the tilt, the servo is
another. A limited rate is no linear stage: it is simulated from the commands of the whole run.

The ball has to follow the plate as physics says. A bank of estimators gets the same commands and tilts, and pictures
that are mirrored or turned over in the ways in which a camera is mounted or wired wrongly. On a healthy rig, the
pictures as they are give the smallest innovations.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable
from dataclasses import replace
from functools import cache, lru_cache
from itertools import product

import numpy as np

from mazeplan.control.estimation.delay_bank import EstimatorBank
from mazeplan.control.estimation.estimator import EstimatorOptions
from mazeplan.core.records import Array, Command, Observation
from mazeplan.learning.rig_model import RigModel
from mazeplan.maze.geometry import Maze
from mazeplan.physics.rig.stage import StageAxis, StageModel, simulate_axis, step_response

FIRST = (6.0, 9.0, 13.0, 19.0, 28.0)  # rad/s
SECOND, DAMPINGS = (8.0, 10.0, 12.0, 14.0, 17.0, 20.0, 24.0, 29.0, 36.0), (0.2, 0.35, 0.6, 0.9, 1.3)  # rad/s, -
LATE = (0.0, 1.0 / 60.0, 1.0 / 30.0, 0.05, 1.0 / 15.0, 1.0 / 12.0, 0.1, 2.0 / 15.0)  # s, dead times
MEMORY_S = 1.4  # s of commands that a stage remembers
LEAST_S = 0.4  # s of motion before the first word
MOVED = math.radians(0.7)  # rad; rms of the predicted tilt, so that there is something to compare
OFF = math.radians(0.5)  # rad; rms of the difference from which a stage is wrong
RATES = (25.0, 32.0, 40.0, 50.0, 63.0, 80.0, 100.0, 125.0, 160.0)  # deg/s, limits that are tried
LIMITS, ALIKE = 3.0, 1.1  # times less that a limit must leave; times more than the best other stage that it may leave
CLEAR_LIMITS = 5.0  # the same for a fitted stage: servos with another limit (`ideal`) reach 4.3, limited ones 6 or more
BETTER = 2.0  # times less than the present stage must be left with another one
GAIN, LEAST_GAIN = 0.15, 0.2  # difference of a gain from 1 that counts; a smaller gain is another fault
LEAST = 1e-9  # rad^2; keeps sums invertible
FAR = 0.25  # rad; no plate of such a rig tilts so far: the sample is wrong
SOON = 1e-9  # s; a command acts at the sample at which its dead time ends
HALF = 0.5  # share of y that must come from the other axis, or from the other sign

# how long the watches last; limits for the ball
WATCHED_S = 4.0  # s from the first sample; what shows later is a fault, not a misfit
LEARNED_OFF = math.radians(2.0)  # rad; rms from which a fitted stage is wrong: fast commands reach limits of any servo
MOST_STAGES = 3  # stages that a run adopts
EVERY = 2  # samples between judgements
USUAL_LATE = 1.0 / 30.0  # s; delay of the picture where the model knows none
FEWEST = 5  # samples of a moving ball
BALL_OFF = 0.4e-3  # m; rms of the innovations from which pictures as they are may be wrong
# times smaller rms in another way; gain of -2 log L, with the variance unknown: in 980 healthy runs on 223 rigs it was
# 32 once, else less; with mirrored or exchanged pictures it reaches 42 to 370
WAY_BETTER, CLEARLY = 1.2, 40.0
Place = Callable[[float, float], tuple[float, float]]
WAYS: dict[str, Place] = {
    "": lambda x, y: (x, y),
    "the ball runs against the tilt beta: the sign of beta, or of x, is reversed": lambda x, y: (-x, y),
    "the ball runs against the tilt gamma: the sign of gamma, or of y, is reversed": lambda x, y: (x, -y),
    "the ball runs against the tilt: the signs of beta and gamma, or of x and y, are reversed": lambda x, y: (-x, -y),
    "the ball follows beta along y and gamma along x: the axes are exchanged": lambda x, y: (y, x),
}


class StageWatch:
    """The bank of one run. stage: of the model, in measured tilts."""

    def __init__(self, stage: StageModel, rate_hz: float) -> None:
        self._dt = 1.0 / rate_hz
        bank = _bank()
        self._axes = [(stage.beta, stage.gamma), *((axis, axis) for axis in bank)]
        count = math.ceil(MEMORY_S / self._dt)
        own, tried = (_impulse(axis, count, self._dt) for axis in self._axes[0]), _impulses(count, self._dt)
        self._impulses = np.stack([np.vstack([response, tried]) for response in own])  # (2, C, L)
        self._offset = np.array([stage.beta.offset, stage.gamma.offset])
        self._u: deque[tuple[float, float]] = deque([(0.0, 0.0)] * count, maxlen=count)  # newest first
        self._yp, self._pp = np.zeros((len(self._axes), 2, 2)), np.zeros((len(self._axes), 2, 2))
        self._yy, self._count = np.zeros((2, 2)), 0
        self._measured: list[tuple[float, float]] = []
        self._commands: list[tuple[float, float]] = []

    def sent(self, command: Command) -> None:
        """Note the command of a tick."""
        self._u.appendleft((command.u_beta, command.u_gamma))

    def update(self, observation: Observation) -> None:
        """Compare a sample with all predictions."""
        near = abs(observation.beta) < FAR and abs(observation.gamma) < FAR
        self._measured.append((observation.beta, observation.gamma) if near else (math.nan, math.nan))
        self._commands.append(self._u[0])
        y = np.array([observation.beta, observation.gamma]) - self._offset
        if not np.all(np.abs(y) < FAR):  # also NaN
            return
        u = np.array(self._u)
        # the newest command was given after the last sample: it is one sample old
        p = np.stack([self._impulses[i] @ u[:, i] for i in range(2)], axis=1)  # (C, 2)
        self._yp += y[None, :, None] * p[:, None, :]
        self._pp += p[:, :, None] * p[:, None, :]
        self._yy += np.outer(y, y)
        self._count += 1

    @property
    def ready(self) -> bool:
        """Whether the plate has moved enough, in both axes, to say something."""
        if self._count * self._dt < LEAST_S:
            return False
        return bool(np.min(np.linalg.eigvalsh(self._pp[0])) > self._count * MOVED**2 / 4.0)

    def left(self) -> Array:
        """rms of measured minus predicted tilt for each stage of the bank, rad, (C,); the first is the model's."""
        square = np.trace(self._yy) - 2.0 * np.trace(self._yp, axis1=1, axis2=2) + np.trace(self._pp, axis1=1, axis2=2)
        return np.sqrt(np.maximum(square, 0.0) / (2.0 * max(self._count, 1)))

    def adopt(self, stage: StageModel) -> None:
        """Watch another stage of the bank from now on, with all sums so far."""
        i = self._axes.index((stage.beta, stage.gamma))
        self._axes[0], self._impulses[:, 0] = self._axes[i], self._impulses[:, i]
        self._yp[0], self._pp[0] = self._yp[i], self._pp[i]

    def judge(self, off: float = OFF) -> tuple[str, StageModel | None]:
        """What is wrong, in words, and the stage that explains it, None if no stage does; "" if nothing is wrong.

        off: rms of the difference from which the stage is wrong, rad; below it, a limited rate counts from OFF on if it
        leaves nearly nothing"""
        left = self.left()
        if left[0] <= OFF or not self.ready:
            return "", None
        best = int(np.argmin(left))
        limited, rest = self._limited()
        times = LIMITS if left[0] > off else CLEAR_LIMITS
        if rest < ALIKE * left[best] and left[0] > times * rest:
            words = f"the plate turns at most {math.degrees(limited.beta.rate_limit):.0f} degrees a second"
            return f"{words}: {_less(rest, left[0])}", limited
        if left[0] <= off:
            return "", None
        if words := self._mixed_up():
            return words, None
        gains = np.diag(self._yp[0]) / np.maximum(np.diag(self._pp[0]), LEAST)
        rest = np.trace(self._yy) - float(gains @ np.diag(self._yp[0]))
        by_gain = math.sqrt(max(rest, 0.0) / (2.0 * self._count))
        if BETTER * by_gain < left[0] and by_gain <= left[best]:
            return self._gain(gains)
        if left[0] < BETTER * left[best]:
            return "", None
        beta, gamma = self._axes[best]
        words = f"the plate follows its commands {_words(beta)}, not {_words(self._axes[0][0])}"
        return f"{words}: {_less(left[best], left[0])}", StageModel(beta, gamma)

    def _limited(self) -> tuple[StageModel, float]:
        """The present stage, or one that else follows at once, with the rate limit that leaves least; and the rms that
        it leaves, rad."""
        y, sent = np.array(self._measured), np.array(self._commands)
        u = np.vstack([[0.0, 0.0], sent[1:], sent[-1:]])  # level at first; then what was sent after each sample
        good, best = np.isfinite(y[:, 0]), (StageModel(*self._axes[0]), math.inf)
        for pair in _limits(*self._axes[0], 0.5 * self._dt):  # samples show a dead time only to a sample
            off = [y[good, i] - simulate_axis(axis, u[:, i], self._dt)[1:][good] for i, axis in enumerate(pair)]
            rest = math.sqrt(sum(float(one @ one) for one in off) / (2.0 * np.count_nonzero(good)))
            if rest < best[1]:
                best = StageModel(*pair), rest
        return best

    def _mixed_up(self) -> str:
        """Words for exchanged axes or a wrong sign, if they explain most of the tilt with any stage."""
        whole = np.trace(self._yy)
        gains = self._yp @ np.linalg.inv(self._pp + LEAST * np.eye(2))  # (C, 2, 2)
        rest = whole - np.einsum("cij,cij->c", gains, self._yp)
        c = int(np.argmin(rest))
        usual = 2.0 * self._count * float(np.min(self.left())) ** 2  # of a stage with its axes and signs right
        if rest[c] > 0.25 * whole or usual < BETTER**2 * rest[c]:
            return ""
        G = gains[c]
        if abs(G[0, 1]) > HALF and abs(G[1, 0]) > HALF and max(abs(G[0, 0]), abs(G[1, 1])) < HALF:
            return "the measured tilts of beta and gamma are exchanged, or their commands are"
        turned = [name for name, g in (("beta", G[0, 0]), ("gamma", G[1, 1])) if g < -HALF]
        return f"the measured tilt of {' and '.join(turned)} has the opposite sign of its command" if turned else ""

    def _gain(self, gains: Array) -> tuple[str, StageModel | None]:
        """Words for other gains (2,) of the present axes, and the stage with them; it joins the bank."""
        if np.max(np.abs(gains - 1.0)) < GAIN or np.min(gains) < LEAST_GAIN:
            return "", None
        beta, gamma = (replace(a, gain=a.gain * float(g)) for a, g in zip(self._axes[0], gains, strict=True))
        self._axes.append((beta, gamma))
        words = f"the plate tilts by {gains[0]:.2f} (beta) and {gains[1]:.2f} (gamma) of its commands"
        self._impulses = np.concatenate([self._impulses, self._impulses[:, :1] * gains[:, None, None]], axis=1)
        self._yp = np.concatenate([self._yp, self._yp[:1] * gains])
        self._pp = np.concatenate([self._pp, self._pp[:1] * np.outer(gains, gains)])
        return words, StageModel(beta, gamma)


@cache
def _bank() -> tuple[StageAxis, ...]:
    """The stages that are tried."""
    kinds = [
        StageAxis.prompt(), *(StageAxis(1.0, pole, 1.0, order=1) for pole in FIRST),
        *(StageAxis(1.0, frequency, damping) for frequency, damping in product(SECOND, DAMPINGS)),
    ]  # fmt: skip
    return tuple(replace(axis, dead_time=late) for late in LATE for axis in kinds)


@cache
def _impulses(count: int, dt: float) -> Array:
    """`_impulse` of the stages that are tried, (C, count)."""
    return np.array([_impulse(axis, count, dt) for axis in _bank()])


@lru_cache(maxsize=8)
def _limits(beta: StageAxis, gamma: StageAxis, half: float) -> tuple[tuple[StageAxis, StageAxis], ...]:
    """Both axes as they are, or as they would follow at once, with each limited rate. half: half a sample, s"""
    bases = ((beta, gamma), (_prompt(beta), _prompt(gamma)), (_prompt(beta, half), _prompt(gamma, half)))
    limits = [math.radians(rate) for rate in RATES]
    return tuple((replace(a, rate_limit=r), replace(b, rate_limit=r)) for a, b in bases for r in limits)


def _prompt(axis: StageAxis, earlier: float = 0.0) -> StageAxis:
    """An axis that follows at once, with gain and offset of another, and its dead time or an earlier one, s."""
    return StageAxis.prompt(axis.gain, max(axis.dead_time - earlier, 0.0), axis.offset)


def _impulse(axis: StageAxis, count: int, dt: float) -> Array:
    """Angle (count,) now by a unit command that was held for one sample, 1, 2 ... samples ago."""
    times: Array = dt * np.arange(1, count + 1, dtype=np.float64) - axis.dead_time + SOON
    response = axis.gain * step_response(axis, times)
    impulse = np.diff(response, prepend=0.0)
    impulse[-1] += axis.gain - response[-1]
    return impulse


def _words(axis: StageAxis) -> str:
    """A servo in a few words."""
    late = f" after {1e3 * axis.dead_time:.0f} ms" if axis.dead_time > 5e-3 else ""
    if axis.order == 0:
        return f"at once{late}"
    if axis.order == 1:
        return f"as a first-order servo of {axis.natural_frequency:.0f} rad/s{late}"
    return f"as a servo of {axis.natural_frequency:.0f} rad/s and damping {axis.damping:.2g}{late}"


def _less(left: float, now: float) -> str:
    return f"{math.degrees(left):.1f} in place of {math.degrees(now):.1f} degrees off"


class BallWatch:
    """The bank of one run."""

    def __init__(self, maze: Maze, model: RigModel, rate_hz: float) -> None:
        late = model.camera_delay if model.delay_known else max(USUAL_LATE, -model.stage.dead_time)
        planar = replace(model, camera_delay=late, camera_delay_stderr=0.0, body=None)
        self._bank = EstimatorBank(maze, [planar] * len(WAYS), EstimatorOptions(), rate_hz)
        self.sent = self._bank.plate.sent

    def update(self, observation: Observation) -> None:
        """Take in a sample."""
        x, y, pictures = observation.x, observation.y, list[Observation]()
        for place in WAYS.values():
            seen = (None, None) if x is None or y is None else place(x, y)
            pictures.append(replace(observation, x=seen[0], y=seen[1], others=()))
        self._bank.update(observation, self._bank.each[0], pictures)

    def judge(self) -> str:
        """What is wrong, in words; "" if nothing is, or if the ball has not moved enough."""
        count = self._bank.count
        if count < FEWEST:
            return ""
        rms = np.sqrt(self._bank.squares / count)
        best = int(np.argmin(rms))
        ratio = rms[0] / max(rms[best], 1e-9)
        wrong = rms[0] > BALL_OFF and ratio > WAY_BETTER and 4.0 * count * math.log(ratio) > CLEARLY
        return list(WAYS)[best] if wrong else ""


class FitWatch:
    """The watches of one run."""

    def __init__(self, maze: Maze, model: RigModel, rate_hz: float) -> None:
        self._maze, self._model, self._rate_hz, self._adopted, self._count = maze, model, rate_hz, 0, 0
        self._off = OFF if model.stage == StageModel() else LEARNED_OFF
        self._stage: StageWatch | None = StageWatch(model.stage, rate_hz)
        self._ball: BallWatch | None = BallWatch(maze, model, rate_hz)  # None: the watch is over
        self._began: float | None = None

    def sent(self, command: Command, t: float) -> None:
        """Note the command of a tick at rig time t, s."""
        if self._stage is not None:
            self._stage.sent(command)
        if self._ball is not None:
            self._ball.sent(command, t)

    def update(self, observation: Observation) -> tuple[str, StageModel | None] | None:
        """Take in a sample. Returns what does not fit, and the stage that would; None if nothing was found now."""
        if self._ball is None:
            return None
        t, self._count = observation.t, self._count + 1
        self._began = t if self._began is None else self._began
        if t - self._began > WATCHED_S:
            self._stage = self._ball = None
            return None
        self._ball.update(observation)
        if self._stage is not None:
            self._stage.update(observation)
        if self._count % EVERY != 0:
            return None
        words, stage = ("", None) if self._stage is None else self._stage.judge(self._off)
        if stage is not None:
            return words, self._adopt(stage)
        words = words or self._ball.judge()
        if not words:
            return None
        self._stage = self._ball = None
        return words, None

    def _adopt(self, stage: StageModel) -> StageModel:
        """Watch on with another stage. A stage with a limited rate is not judged again, but the ball is."""
        self._adopted += 1
        if self._stage is not None and self._adopted < MOST_STAGES and math.isinf(stage.beta.rate_limit):
            self._stage.adopt(stage)
        else:
            self._stage = None
        delay = max(self._model.camera_delay, -stage.dead_time)
        self._ball = BallWatch(self._maze, replace(self._model, stage=stage, camera_delay=delay), self._rate_hz)
        return stage
