"""A rig with a watchdog: if the program or the rig hangs, the plate goes level and the program ends.

    loop          observe() ........ command()        observe() ...
    rig's thread  [rig.observe] wait [rig.command]    [rig.observe] ...
                                |--| longer than timeout_s: level, and RigError in the loop

One thread makes all calls of a rig, and the same thread is the watchdog. After a sample the watchdog waits for the
command, by the monotonic clock. The loop waits for each call only for a limited time. reset() has no limit, because a
person places the ball.

Nothing wakes a loop that hangs, for example in a leaf. If it does not return within END_S, the watchdog ends the whole
process, if `own_process` allows it. Code that never releases the interpreter's lock stops the watchdog's thread, too.
Then only a watchdog in the machine itself helps.
"""

from __future__ import annotations

import os
import queue
import sys
import threading
import traceback
from time import monotonic
from typing import Any

import numpy as np

from mazeplan.core.errors import MazeplanError, RigError
from mazeplan.core.records import Observation
from mazeplan.core.whole_file import end_process
from mazeplan.rigs.interface import Rig, RigWrapper, traits

TIMEOUT_S = 0.2  # s from a sample to the command that answers it
SAMPLES = 15  # time limit of observe(), periods of the rig
START_S = 5.0  # s; the first observe() after reset() may take so much longer, because cameras start
LEVEL_S, CLOSE_S = 1.0, 2.0  # time limits of level() and close(), s
END_S = 2.0  # s after which the watchdog ends the process of a loop that hangs
STDLIB = os.path.dirname(os.__file__) + os.sep


def watched(rig: Rig, *, own_process: bool = False) -> Rig:
    """The rig with a watchdog. A simulation (`realtime = False`) gets no watchdog.

    A user's simulation gets a `CheckedRig`, which turns its errors into RigErrors.
    own_process: see `WatchedRig`."""
    if isinstance(rig, WatchedRig | CheckedRig):
        return rig
    if not traits(rig).realtime:
        ours = type(rig).__module__.partition(".")[0] == __name__.partition(".")[0]
        return rig if ours else CheckedRig(rig)
    return WatchedRig(rig, own_process=own_process)


class _Call:
    """One call of a method of the rig, to run in another thread."""

    def __init__(self, rig: Rig, name: str, *args: Any, **more: Any) -> None:
        self.name = name
        self._rig = rig
        self._args = args
        self._more = more
        self.begun = threading.Event()
        self.done = threading.Event()
        self.result: Any = None
        self.error: BaseException | None = None

    def run(self) -> None:
        self.begun.set()
        try:
            self.result = getattr(self._rig, self.name)(*self._args, **self._more)
        except BaseException as error:  # a user's rig may raise any error; `outcome` raises it again
            self.error = error

    def finish(self) -> None:
        self.run()
        self.done.set()

    def outcome(self) -> Any:
        """The returned value. If the rig raised an error, raises a RigError that names the line of the rig's code."""
        error = self.error
        if error is None:
            return self.result
        if isinstance(error, MazeplanError | KeyboardInterrupt):
            raise error
        frame = traceback.extract_tb(error.__traceback__)[-1]
        what = " ".join(f"{type(error).__name__}: {error}".split())
        raise RigError(f"{self.name}() of the rig raised {what} ({frame.filename}:{frame.lineno})") from error


class CheckedRig(RigWrapper):
    """A simulation without a watchdog. Each error that its calls raise becomes a RigError with the line of code."""

    realtime = False

    def _call(self, name: str, *args: Any, **more: Any) -> Any:
        call = _Call(self.inside, name, *args, **more)
        call.run()
        return call.outcome()


class WatchedRig(RigWrapper):
    """A rig with a watchdog, see `interface.Rig`.

    timeout_s: longest time from a sample to the command that answers it, s.
    own_process: True allows the watchdog to end the process, with exit status 3, if the loop hangs for good.

    When the watchdog strikes, it levels the plate. Then observe and command raise RigError until the next reset, and so
    does reset while a call hangs. `reason` says why the watchdog struck; None: it did not. `level` answers a sample as
    `command` does."""

    realtime = True

    def __init__(self, rig: Rig, timeout_s: float = TIMEOUT_S, *, own_process: bool = False) -> None:
        super().__init__(rig)
        self.timeout_s = timeout_s
        self._own_process = own_process
        self.reason: str | None = None
        self._calls: queue.SimpleQueue[_Call | None] = queue.SimpleQueue()
        self._thread: threading.Thread | None = None
        self._lock = threading.Lock()  # protects reason
        self._loop = 0  # the loop's thread
        self._heard = threading.Event()  # set when the loop returns after a strike
        self._late: list[_Call] = []  # calls that did not return in time
        self._first = True

    def reset(self, *, ring: int, theta: float, rng: np.random.Generator) -> None:
        """As the rig inside, without a time limit."""
        if self._hangs():
            raise RigError(self.reason or f"{self._late[-1].name}() of the rig has not returned yet")
        elif self._thread is not None:
            self.level()  # from now on nothing waits for a command, so that the watchdog cannot strike again
            self.reason = None
        self._first = True
        self._ask("reset", None, ring=ring, theta=theta, rng=rng)

    def observe(self) -> Observation:
        """As the rig inside. Raises RigError if no sample comes in time."""
        self._heard.clear()  # an earlier `level` set it, but the loop may hang after this sample
        self._loop = threading.get_ident()
        limit = SAMPLES / self.rate_hz + (START_S if self._first else 0.0)
        observation = self._ask("observe", limit)
        self._first = False
        return observation

    def command(self, u_beta: float, u_gamma: float) -> None:
        """As the rig inside. Raises RigError if the command comes too late or the call takes too long."""
        self._ask("command", self.timeout_s, u_beta, u_gamma)

    def level(self) -> None:
        """As the rig inside, for at most LEVEL_S, also while another call hangs."""
        self._heard.set()
        if self._hangs("level"):  # an earlier call has reported that; another try would only take longer
            return
        self._await(self._give("level"), LEVEL_S)

    def close(self) -> None:
        """As the rig inside, for at most CLOSE_S, also while another call hangs."""
        self._heard.set()
        call = self._give("close")
        self._calls.put(None)
        self._thread = None
        self._await(call, CLOSE_S)

    def _await(self, call: _Call, limit: float) -> None:
        """Wait for a call of `level` or `close`, for at most `limit` seconds."""
        if not call.done.wait(limit):
            if call.name == "level":
                self._late.append(call)
            problem = f"{call.name}() of the rig did not return within {limit:g} s"
            raise RigError(problem if self.reason is None else f"{self.reason}; then {problem}")
        call.outcome()

    def _ask(self, name: str, limit: float | None, *args: Any, **more: Any) -> Any:
        """Call a method in the rig's thread, for at most `limit` seconds (None: without a limit)."""
        if self.reason is None:
            call = _Call(self.inside, name, *args, **more)
            self._put(call)
            if call.done.wait(limit):
                if self.reason is not None:  # the watchdog struck before this call
                    self._heard.set()
                return call.outcome()
            self._strike(f"{name}() of the rig did not return within {limit:g} s")
            self._late.append(call)
            self.level()
        self._heard.set()
        raise RigError(str(self.reason))

    def _give(self, name: str) -> _Call:
        """Call a method in the rig's thread; if that thread hangs, call it in a new thread, too."""
        call = _Call(self.inside, name)
        self._put(call)  # also while a call hangs: if that call ends late, this one comes after it
        if call.begun.wait(0.0 if self._hangs() else 2.0 / self.rate_hz):
            return call
        apart = _Call(self.inside, name)
        threading.Thread(target=apart.finish, name=f"mazeplan rig {name}", daemon=True).start()
        return apart

    def _hangs(self, *names: str) -> bool:
        """Whether a late call (of these names, if any) still hangs."""
        return any(not call.done.is_set() for call in self._late if not names or call.name in names)

    def _put(self, call: _Call) -> None:
        if self._thread is None:
            self._calls = queue.SimpleQueue()  # an earlier thread may hang and wake later
            self._thread = threading.Thread(target=self._work, args=(self._calls,), name="mazeplan rig", daemon=True)
            self._thread.start()
        self._calls.put(call)

    def _work(self, calls: queue.SimpleQueue[_Call | None]) -> None:
        due: float | None = None  # latest time of the command
        t = 0.0
        while True:
            try:
                call = calls.get(timeout=None if due is None else max(0.0, due - monotonic()))
            except queue.Empty:
                due = None
                self._strike(f"no command within {self.timeout_s:g} s of the sample at t = {t:.3f} s", stuck=True)
                _Call(self.inside, "level").run()
                continue
            if call is None:
                return
            due = None
            if self.reason is not None and call.name not in ("level", "close"):
                call.error = RigError(self.reason)
            else:
                call.run()
            if call.name == "observe" and call.error is None:
                due, t = monotonic() + self.timeout_s, getattr(call.result, "t", 0.0)
            call.done.set()

    def _strike(self, problem: str, *, stuck: bool = False) -> None:
        """Store the reason. stuck: the loop hangs"""
        with self._lock:
            if self.reason is not None:
                return
            self.reason = f"watchdog: {problem}{_whereabouts(self._loop) if stuck else ''}"
        if stuck and self._own_process:
            threading.Thread(target=self._end_process, name="mazeplan end", daemon=True).start()

    def _end_process(self) -> None:
        if not self._heard.wait(END_S):
            print(f"mazeplan: {self.reason}; the program is ended", file=sys.stderr, flush=True)
            end_process(RigError.exit_status)


def _whereabouts(thread: int) -> str:
    """The line that a thread runs now: the innermost one outside Python's standard library."""
    frame = sys._current_frames().get(thread)
    while frame is not None and frame.f_code.co_filename.startswith(("<", STDLIB)):
        frame = frame.f_back
    return "" if frame is None else f" ({frame.f_code.co_filename}:{frame.f_lineno})"
