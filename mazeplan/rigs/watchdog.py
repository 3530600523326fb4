"""A rig that is watched: whatever hangs, the plate goes level and the program comes to its end.

    loop          observe() ........ command()        observe() ...
    rig's thread  [rig.observe] wait [rig.command]    [rig.observe] ...
                                |--| longer than timeout_s: level, and RigError in the loop

All calls of a rig run in a thread of its own, which is also the watchdog: after a sample it waits for the command and
judges by the monotonic clock, outside the loop. The loop in turn waits for each call no longer than is sensible for it;
only reset() may take as long as it likes, as a person places the ball. A loop that hangs in Python code, or waits for
something, is woken by a signal where the system has them. One that hangs in compiled code cannot be, and is ended
with its process where that is allowed (`own_process`). Code that never gives the interpreter's lock back stops this
thread, too: against that only a watchdog in the machine itself helps.
"""

from __future__ import annotations

import os
import queue
import signal
import sys
import threading
import traceback
from time import monotonic
from typing import Any, cast

import numpy as np

from mazeplan.errors import MazeplanError, RigError
from mazeplan.records import Observation
from mazeplan.rigs.interface import Rig

TIMEOUT_S = 0.2  # s from a sample to the command that answers it
SAMPLES = 15  # periods that observe() may take ...
START_S = 5.0  # s ... and so much longer after reset(), when cameras start
LEVEL_S, CLOSE_S = 1.0, 2.0  # s
WAKE_S = 2.0  # s after which a loop that was woken and not heard of is ended with its process
STDLIB = os.path.dirname(os.__file__) + os.sep
WAKE = getattr(signal, "SIGUSR2", None)  # not on every system


def watched(rig: Rig, *, own_process: bool = False) -> Rig:
    """The rig, watched unless it says `realtime = False`, as simulations do that wait for nobody; what such a one of
    somebody else's raises is a RigError all the same.

    own_process: see `WatchedRig`."""
    if isinstance(rig, WatchedRig | ToldRig):
        return rig
    if not getattr(rig, "realtime", True):
        ours = type(rig).__module__.partition(".")[0] == __name__.partition(".")[0]
        return rig if ours else cast(Rig, ToldRig(rig))
    return cast(Rig, WatchedRig(rig, own_process=own_process))  # a rig but for how it is made


class _Call:
    """One call of a method of the rig, for another thread to do."""

    def __init__(self, rig: Rig, name: str, *args: Any, **more: Any) -> None:
        self.name, self._rig, self._args, self._more = name, rig, args, more
        self.begun, self.done = threading.Event(), threading.Event()
        self.result: Any = None
        self.error: BaseException | None = None

    def run(self) -> None:
        self.begun.set()
        try:
            self.result = getattr(self._rig, self.name)(*self._args, **self._more)
        except BaseException as error:  # anybody's rig may raise anything; who waits is told
            self.error = error

    def outcome(self) -> Any:
        """What was returned. Raises RigError for what the rig raised, with the place in its code."""
        error = self.error
        if error is None:
            return self.result
        if isinstance(error, MazeplanError | KeyboardInterrupt):
            raise error
        frame = traceback.extract_tb(error.__traceback__)[-1]
        what = " ".join(f"{type(error).__name__}: {error}".split())
        raise RigError(f"{self.name}() of the rig raised {what} ({frame.filename}:{frame.lineno})") from error


class ToldRig:
    """A rig that waits for nobody: its calls as they are, but whatever they raise is a RigError with the place."""

    realtime = False

    def __init__(self, rig: Rig) -> None:
        self._rig = rig

    def __getattr__(self, name: str) -> Any:
        if name.startswith("_"):  # while being copied there is no _rig yet
            raise AttributeError(name)
        return getattr(self._rig, name)

    def reset(self, *, ring: int, theta: float, rng: np.random.Generator) -> None:
        """As the rig's."""
        self._ask("reset", ring=ring, theta=theta, rng=rng)

    def observe(self) -> Observation:
        """As the rig's."""
        return self._ask("observe")

    def command(self, u_beta: float, u_gamma: float) -> None:
        """As the rig's."""
        self._ask("command", u_beta, u_gamma)

    def level(self) -> None:
        """As the rig's."""
        self._ask("level")

    def close(self) -> None:
        """As the rig's."""
        self._ask("close")

    def _ask(self, name: str, *args: Any, **more: Any) -> Any:
        call = _Call(self._rig, name, *args, **more)
        call.run()
        return call.outcome()


class WatchedRig:
    """See `interface.Rig`. timeout_s: from a sample to its command; own_process: whether the process may be ended, with
    exit status 3, when nothing else can end a loop that hangs.

    Once it has struck (`reason` says why), the plate is level and observe, command and reset raise RigError."""

    realtime = True

    def __init__(self, rig: Rig, timeout_s: float = TIMEOUT_S, *, own_process: bool = False) -> None:
        self._rig, self.timeout_s, self._own_process = rig, timeout_s, own_process
        self.rate_hz = rig.rate_hz
        self.reason: str | None = None
        self._calls: queue.SimpleQueue[_Call | None] = queue.SimpleQueue()
        self._thread: threading.Thread | None = None
        self._lock = threading.Lock()  # of reason and _listens
        self._heard = threading.Event()  # the loop came back after the watchdog had struck
        self._first, self._hangs, self._level_hangs = True, False, False
        self._listens, self._handler_before = False, None

    def __getattr__(self, name: str) -> Any:
        if name.startswith("_"):  # while being copied there is no _rig yet
            raise AttributeError(name)
        return getattr(self._rig, name)

    # -- the loop's side --------------------------------------------------------------------------------------------

    def reset(self, *, ring: int, theta: float, rng: np.random.Generator) -> None:
        """As the rig's, without a limit of time."""
        self._listen()
        self._first = True
        self._ask("reset", None, ring=ring, theta=theta, rng=rng)

    def observe(self) -> Observation:
        """As the rig's. Raises RigError when no sample comes in time."""
        limit = SAMPLES / self.rate_hz + (START_S if self._first else 0.0)
        observation = self._ask("observe", limit)
        self._first = False
        return observation

    def command(self, u_beta: float, u_gamma: float) -> None:
        """As the rig's. Raises RigError when it comes too late or is not taken in time."""
        self._ask("command", self.timeout_s, u_beta, u_gamma)

    def level(self) -> None:
        """As the rig's, at most LEVEL_S, and past a call that hangs."""
        self._heard.set()
        if self._level_hangs:  # that has been said, and once more would only take longer
            return
        call = self._give("level")
        if not call.done.wait(LEVEL_S):
            self._level_hangs = True
            raise RigError(self._after(f"level() of the rig did not return within {LEVEL_S:g} s"))
        call.outcome()

    def close(self) -> None:
        """As the rig's, at most CLOSE_S, and past a call that hangs."""
        self._heard.set()
        call = self._give("close")
        self._calls.put(None)
        self._thread = None
        done = call.done.wait(CLOSE_S)
        self._stop_listening()
        if not done:
            raise RigError(self._after(f"close() of the rig did not return within {CLOSE_S:g} s"))
        call.outcome()

    def _ask(self, name: str, limit: float | None, *args: Any, **more: Any) -> Any:
        """Have the rig's thread do it, within so many seconds."""
        if self.reason is None:
            call = _Call(self._rig, name, *args, **more)
            self._put(call)
            if call.done.wait(limit):
                if self.reason is not None:  # the watchdog was quicker than this call
                    self._heard.set()
                return call.outcome()
            self._strike(f"{name}() of the rig did not return within {limit:g} s")
            self._hangs = True
            self.level()
        self._heard.set()
        raise RigError(str(self.reason))

    def _give(self, name: str) -> _Call:
        """Have it done by the rig's thread; by another one as well when that hangs."""
        call = _Call(self._rig, name)
        self._put(call)  # also when it hangs: what it does when it comes to itself must not be the last word
        if call.begun.wait(0.0 if self._hangs else 2.0 / self.rate_hz):
            return call
        apart = _Call(self._rig, name)
        threading.Thread(target=self._do, args=(apart,), name=f"mazeplan rig {name}", daemon=True).start()
        return apart

    def _after(self, problem: str) -> str:
        return problem if self.reason is None else f"{self.reason}; then {problem}"

    # -- the rig's thread -------------------------------------------------------------------------------------------

    def _put(self, call: _Call) -> None:
        if self._thread is None:
            self._calls = queue.SimpleQueue()  # a former thread may hang and still wake
            self._thread = threading.Thread(target=self._work, args=(self._calls,), name="mazeplan rig", daemon=True)
            self._thread.start()
        self._calls.put(call)

    @staticmethod
    def _do(call: _Call) -> None:
        call.run()
        call.done.set()

    def _work(self, calls: queue.SimpleQueue[_Call | None]) -> None:
        due: float | None = None  # when a command must have come
        t = 0.0
        while True:
            try:
                call = calls.get(timeout=None if due is None else max(0.0, due - monotonic()))
            except queue.Empty:
                due = None
                self._strike(f"no command within {self.timeout_s:g} s of the sample at t = {t:.3f} s", stuck=True)
                self._do(_Call(self._rig, "level"))
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

    # -- striking ---------------------------------------------------------------------------------------------------

    def _strike(self, problem: str, *, stuck: bool = False) -> None:
        """Note why, and wake the loop if it is that which hangs."""
        with self._lock:
            if self.reason is not None:
                return
            self.reason = f"watchdog: {problem}{_whereabouts() if stuck and self._listens else ''}"
            if not stuck:
                return
            if self._listens and WAKE is not None:
                signal.pthread_kill(_main_ident(), WAKE)
        if self._own_process:
            threading.Thread(target=self._end_process, name="mazeplan end", daemon=True).start()

    def _end_process(self) -> None:
        if not self._heard.wait(WAKE_S):
            print(f"mazeplan: {self.reason}; nothing could wake it", file=sys.stderr, flush=True)
            os._exit(RigError.exit_status)

    def _listen(self) -> None:
        """Let the watchdog wake this thread, which must be the main one: others take no signals."""
        if WAKE is None or self._listens or threading.get_ident() != _main_ident():
            return
        self._handler_before = signal.signal(WAKE, self._on_wake)
        self._listens = True

    def _stop_listening(self) -> None:
        if self._listens and threading.get_ident() == _main_ident():
            with self._lock:  # no signal may be under way to a handler that is gone
                self._listens = False
                signal.signal(WAKE, self._handler_before or signal.SIG_DFL)  # pyright: ignore[reportArgumentType]

    def _on_wake(self, number: int, frame: Any) -> None:
        if self.reason is not None and not self._heard.is_set():
            raise RigError(self.reason)


def _main_ident() -> int:
    return threading.main_thread().ident or 0


def _whereabouts() -> str:
    """Where the main thread is now: the innermost place that is none of Python's own."""
    frame = sys._current_frames().get(_main_ident())
    while frame is not None and frame.f_code.co_filename.startswith(("<", STDLIB)):
        frame = frame.f_back
    return "" if frame is None else f" ({frame.f_code.co_filename}:{frame.f_lineno})"
