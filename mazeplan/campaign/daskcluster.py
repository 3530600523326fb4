"""Work on the workers of a Dask scheduler. The only file that imports dask and distributed.

Short tasks travel some at a time. Each worker has two such lots at any time: it never waits, and little has to be
called back when it ends. Which lot goes to whom is decided here, by who has least to do: a scheduler takes all lots to
be equally long, and towards the end one worker would have a queue while another has nothing. Dask does the tasks of a
dead worker again elsewhere, until too many workers died of one; since others that waited at the same workers come under
suspicion, too, each of these is then tried once more alone.
"""

from __future__ import annotations

import logging
import math
import os
import platform
import queue
import threading
import uuid
import warnings
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import CancelledError
from contextlib import ExitStack, contextmanager, suppress
from time import monotonic
from typing import TYPE_CHECKING, Any

from mazeplan.campaign.executor import LOCAL, MOST_DEATHS, Executor, Lost, Result, Value, Words
from mazeplan.campaign.processes import interrupts_held, one_thread
from mazeplan.campaign.program import program, unlike
from mazeplan.campaign.work import measured
from mazeplan.errors import InputError, RigError
from mazeplan.resources import to_install

if TYPE_CHECKING:
    from distributed import Client, Future

LOOPBACK = "127.0.0.1"
CONNECT_S = 5.0  # s that a scheduler has to answer
WORKERS_S = 10.0  # s until the first worker must have come
TOLD_S = 4.0  # s without any worker after which that is said
ALONE_S = 60.0  # s without any worker after which nobody waits any more
POLL_S = 1.0  # s after which waiting looks whether there is still anybody
PROTOCOLS = ("tcp", "tls", "ws", "wss", "ucx")
COUNT_S = 2.0  # s after which workers are counted again
AT_EACH = 2  # lots at a worker: what is done, and what comes next
TOGETHER_S = 1.0  # s of work that are sent as one; what is kept as it ends is at most so much later there
ANYBODY = ""  # no worker is told by name
LARGE = 1 << 30  # bytes; files of a user may be larger than what Dask warns of
_one_at_a_time = threading.Lock()  # a run takes its process for itself


@contextmanager
def dask_executor(address: str, workers: int | None, carry: Sequence[Any], say: Words) -> Iterator[Executor]:
    """The workers at an address, or of a cluster of one's own. Raises as `executor.open_executor`."""
    try:
        import distributed
    except ImportError:
        raise InputError(f"--dask needs dask and distributed: {to_install('campaign')}") from None
    with ExitStack() as stack:
        stack.enter_context(_silence())
        stack.enter_context(_settings())
        target = stack.enter_context(_own_cluster(workers)) if address == LOCAL else _checked(address)
        try:
            client = stack.enter_context(distributed.Client(target, timeout=CONNECT_S, set_as_default=False))
        except (OSError, ValueError, TypeError, ImportError) as problem:
            raise InputError(f"--dask: got {address}: no scheduler answers there: {_line(problem)}") from None
        _carry(carry)
        _check_workers(client, address, say)
        say(_dashboard(client))
        yield Dask(client, address, say)


@contextmanager
def _silence() -> Iterator[None]:
    """Not a word of Dask's own, which are for who runs a cluster: what a person must know is said here."""
    from distributed.versions import VersionMismatchWarning

    names = [name for name in logging.root.manager.loggerDict if name.partition(".")[0] in ("distributed", "tornado")]
    before = {name: logging.getLogger(name).level for name in names}
    for name in names:
        logging.getLogger(name).setLevel(logging.CRITICAL + 1)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", VersionMismatchWarning)  # `_check_workers` looks at what matters
            yield
    finally:
        for name, level in before.items():
            logging.getLogger(name).setLevel(level)


def _settings() -> Any:
    from dask import config

    return config.set(
        {
            "distributed.comm.timeouts.connect": CONNECT_S,
            "distributed.scheduler.allowed-failures": MOST_DEATHS - 1,
            "distributed.admin.large-graph-warning-threshold": LARGE,
            # of workers of one's own: to look at them a hundred times a second takes a tenth of their time
            "distributed.worker.profile.enabled": False,
            "distributed.admin.tick.interval": "1s",
            "distributed.worker.memory.monitor-interval": "1s",
        }
    )


def _checked(address: str) -> str:
    """tcp://host:port for host:port. Raises InputError for what is no address."""
    full = address if "://" in address else f"tcp://{address}"
    protocol, _, place = full.partition("://")
    host, _, port = place.rpartition(":")
    if not (protocol in PROTOCOLS and host and port.isdecimal() and 0 < int(port) < 65536):
        raise InputError(f"--dask: got {address!r}, expected local or an address such as tcp://scheduler:8786")
    return full


@contextmanager
def _own_cluster(workers: int | None) -> Iterator[Any]:
    """A scheduler and workers on this machine that nobody else can reach."""
    import distributed

    with interrupts_held():
        cluster = distributed.LocalCluster(
            n_workers=workers or _cores(), threads_per_worker=1, processes=True, host=LOOPBACK,
            silence_logs=logging.CRITICAL, dashboard_address=f"{LOOPBACK}:0",
            worker_dashboard_address=f"{LOOPBACK}:0",
        )  # fmt: skip
    with cluster:
        yield cluster


def _cores() -> int:
    """Those that this process may use, where the system tells."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def _has_bokeh() -> bool:
    from importlib.util import find_spec

    return find_spec("bokeh") is not None


def _dashboard(client: Client) -> str:
    """Where Dask's own page is, in words."""
    port = client.scheduler_info()["services"].get("dashboard")
    bokeh = "bokeh, which it needs, is not installed" + ("" if client.cluster else " at the scheduler")
    if port is None:
        return f"Dask has no dashboard: {bokeh}" if not _has_bokeh() else "Dask has no dashboard: it was switched off"
    try:
        client.run_on_scheduler(__import__, "bokeh")
    except Exception:  # whatever a scheduler elsewhere says
        return f"Dask has no dashboard: {bokeh}"
    return f"Dask's dashboard: {client.dashboard_link}"


def _carry(modules: Sequence[Any]) -> None:
    import cloudpickle

    for module in modules:
        cloudpickle.register_pickle_by_value(module)


def _line(problem: BaseException) -> str:
    return " ".join(f"{problem}".split()) or type(problem).__name__


def _check_workers(client: Client, address: str, say: Words) -> None:
    """Whether there are workers that would compute the same. Raises InputError."""
    try:
        client.wait_for_workers(1, timeout=WORKERS_S)
    except TimeoutError:
        start = f"dask worker {address} --nthreads 1"
        raise InputError(f"--dask: the scheduler at {address} has no workers; start some: {start}") from None
    found: Any = client.run(facts, on_error="return")
    for worker, theirs in found.items():
        if isinstance(theirs, BaseException) and "No module named 'mazeplan'" in str(theirs):
            raise InputError(f"--dask: worker {worker} has no mazeplan: install the same one there")
        if isinstance(theirs, BaseException):
            raise InputError(f"--dask: worker {worker} cannot do this: {_line(theirs)}")
        if other := unlike(program(), theirs):
            raise InputError(f"--dask: worker {worker} would not compute the same: it has {other}")
    threads: Any = client.nthreads()
    if many := sum(count > 1 for count in threads.values()):
        more = "worker has" if many == 1 else "workers have"
        say(f"{many} {more} several threads, of which one is used: a run takes its process (dask worker --nthreads 1)")


def facts() -> dict[str, str]:
    """What computes on a worker."""
    return dict(program())


class Dask:
    """See `Executor`."""

    apart = True

    def __init__(self, client: Client, address: str, say: Words) -> None:
        self._client, self._address, self._say = client, address, say
        self._workers: tuple[str, ...] = (ANYBODY,)  # addresses, where there are several
        self._counted, self._alone_since, self._told = -math.inf, math.inf, False
        self._typical_s = TOGETHER_S  # of a task

    def share(self, value: Value) -> Value:
        """As a task that returns it: where it dies with its worker, the scheduler has it returned once more."""
        shared: Any = self._client.submit(_itself, value, key=f"shared-{uuid.uuid4().hex}", pure=False)
        return shared

    def each(
        self, work: Callable[..., Result], tasks: Sequence[tuple[Any, ...]]
    ) -> Iterator[tuple[int, Result | Lost]]:
        """See `Executor`. Raises RigError when the scheduler is lost, or all workers are for long."""
        suspects: list[int] = []
        for index, result in self._each(work, tasks, range(len(tasks))):
            if isinstance(result, Lost):
                suspects.append(index)
            else:
                yield index, result
        for index in suspects:
            yield from self._each(work, tasks, [index])

    def _each(
        self, work: Callable[..., Result], tasks: Sequence[tuple[Any, ...]], which: Sequence[int]
    ) -> Iterator[tuple[int, Result | Lost]]:
        arrived: queue.SimpleQueue[Future] = queue.SimpleQueue()
        waiting, name = deque(which), uuid.uuid4().hex[:8]
        running: dict[Any, tuple[list[int], Future, str]] = {}

        def send(some: list[int], where: str, key: str) -> None:
            given = [tasks[index] for index in some]
            future = self._client.submit(
                _do, work, dict(program()), given, key=key, pure=False,
                workers=where or None, allow_other_workers=bool(where),
            )  # fmt: skip
            future.add_done_callback(arrived.put)
            running[key] = (some, future, where)

        try:
            while waiting or running:
                self._count()
                for key in self._astray(running):
                    some, future, _ = running.pop(key)
                    future.cancel()
                    send(some, ANYBODY, f"{key}-again")
                while (where := self._free([place for *_, place in running.values()], len(waiting))) is not None:
                    some = [waiting.popleft() for _ in range(self._together(len(waiting)))]
                    send(some, where, f"run-{name}-{some[0]}")
                try:
                    future = arrived.get(timeout=POLL_S)
                except queue.Empty:
                    continue
                if future.key not in running:  # was sent again
                    continue
                if future.status in ("pending", "lost"):  # its result died with its worker before it was fetched
                    future.add_done_callback(arrived.put)
                    continue
                some, *_ = running.pop(future.key)
                yield from zip(some, self._outcomes(future, len(some)), strict=True)
        finally:
            if running and self._client.status == "running":
                with suppress(Exception):  # whatever is the matter with the scheduler, something else is being told
                    self._client.cancel([future for _, future, _ in running.values()], force=True)

    def _astray(self, running: Mapping[Any, tuple[list[int], Future, str]]) -> list[Any]:
        """Lots that went to workers which are not there any more. The scheduler gives them to others, but for ever to
        nobody if at that moment there was no other."""
        gone = [key for key, (_, _, where) in running.items() if where and where not in self._workers]
        return [key for key in gone if running[key][1].status == "pending"]

    def _free(self, places: Sequence[str], waiting: int) -> str | None:
        """Who gets the next lot, by where those are that are not done; None: nobody yet. Of the last tasks nobody has
        one in store that another could begin at once."""
        load = {address: places.count(address) for address in self._workers}
        least = min(load, key=lambda address: load[address])
        most = AT_EACH if waiting > 2 * AT_EACH * len(load) else 1
        return least if waiting and load[least] < most else None

    def _together(self, waiting: int) -> int:
        """How many that wait are to be sent as one: a scheduler has some ms to do with each. So many that they take
        TOGETHER_S, as far as is known, and at the end so few that all workers end at about the same time."""
        fair = waiting // (2 * AT_EACH * len(self._workers))
        return max(1, min(int(TOGETHER_S / self._typical_s), fair))

    def _outcomes(self, future: Future, number: int) -> list[Any]:
        """What tasks returned. Raises what one raised, and RigError where the scheduler does not know them any more."""
        from distributed import KilledWorker

        try:
            seconds, results = future.result()
        except KilledWorker as killed:
            return [Lost(killed.allowed_failures + 1)] * number
        except CancelledError:
            raise self._lost() from None
        except OSError:  # of the way there, or of the work
            if future.status == "error":
                raise
            raise self._lost() from None
        self._typical_s = max(seconds / number, 1e-3)
        return results

    def _count(self) -> None:
        """How many workers there are, now and then. Raises RigError when there were none for too long."""
        now = monotonic()
        if self._client.status != "running":
            raise self._lost()
        if now - self._counted < COUNT_S:
            return
        try:
            threads: Any = self._client.nthreads()
        except (OSError, TimeoutError):
            raise self._lost() from None
        self._workers, self._counted = tuple(threads) if len(threads) > 1 else (ANYBODY,), now
        self._alone_since = math.inf if threads else min(self._alone_since, now)
        self._tell(now - self._alone_since)
        if now - self._alone_since > ALONE_S:
            raise RigError(f"the scheduler at {self._address} had no workers for {ALONE_S:g} s")

    def _tell(self, alone_s: float) -> None:
        """That nobody works, and that somebody does again."""
        if not self._told and alone_s >= TOLD_S:
            self._told = True
            self._say(f"the scheduler at {self._address} has no workers any more; waiting up to {ALONE_S:g} s for one")
        elif self._told and alone_s < 0.0:
            self._told = False
            self._say("there are workers again")

    def _lost(self) -> RigError:
        return RigError(f"the scheduler at {self._address} does not answer any more")


def _itself(value: Any) -> Any:
    return value


def _do(
    work: Callable[..., Any], expected: Mapping[str, str], tasks: Sequence[tuple[Any, ...]]
) -> tuple[float, list[Any]]:
    """Some tasks, on a worker, and how long they took, s; workers that came later are asked here what they are."""
    if other := unlike(expected, program()):
        raise InputError(f"--dask: worker {platform.node()}:{os.getpid()} would not compute the same: it has {other}")
    with _one_at_a_time, one_thread():
        results, wall_s, _ = measured(lambda: [work(*task) for task in tasks])
        return wall_s, results
