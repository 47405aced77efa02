"""Pools that compute calls: local processes, or any executor, such as that of a cluster."""

import abc
import contextlib
import dataclasses
import logging
import os
import platform
import signal
from concurrent.futures import BrokenExecutor, CancelledError, Executor, Future, ProcessPoolExecutor
from multiprocessing import get_context
from typing import TYPE_CHECKING, Any

from gmmjax._cores import available_cores
from gmmjax._worker_process import start_worker, use_cores
from gmmjax.errors import ComputationError, InputError, one_line

if TYPE_CHECKING:
    from distributed import Client


class AbstractPool(abc.ABC):
    """Takes functions and gives futures, as `concurrent.futures.Executor` does.

    Attributes:
        capacity: number of calls that are worth handing over before the first one is done.
    """

    capacity: int

    @abc.abstractmethod
    def submit(self, function: Any, *arguments: Any) -> "Future[Any]":
        """Hands a call over, of a module's function, so that another process finds it; never more than `capacity`."""

    @abc.abstractmethod
    def stop(self, *, at_once: bool) -> None:
        """Ends it; at once: without waiting for calls that are running."""

    def lost(self, error: BaseException) -> ComputationError | None:
        """The error to raise where that of a future means that there is no pool any more; None: it does not."""
        return None


class LocalPool(AbstractPool):
    """Processes of this machine, each with a share of its cores.

    Each is an executor of its own, so that one that dies takes its own call along and no other; it is replaced.
    """

    def __init__(self, workers: int, cores: int):
        """Starts no process yet; each will have so many cores."""
        self.capacity = workers
        self._cores = cores
        self._lanes: list[_Lane | None] = [None] * workers

    def submit(self, function: Any, *arguments: Any) -> "Future[Any]":
        """Hands a call to a process that has nothing to do; see `AbstractPool`."""
        number = next(number for number, lane in enumerate(self._lanes) if lane is None or lane.free)
        lane = self._lanes[number]
        if lane is not None:
            try:
                return lane.submit(function, *arguments)
            except BrokenExecutor:
                # It died while it had nothing to do, or with its last call.
                lane.stop(at_once=True)
        self._lanes[number] = lane = _Lane(self._cores)
        return lane.submit(function, *arguments)

    def lost(self, error: BaseException) -> ComputationError | None:
        """The error where processes cannot even be started; see `AbstractPool`."""
        if all(lane is None or lane.began for lane in self._lanes):
            return None
        return ComputationError(
            "worker processes end before they begin; a script that starts them needs "
            'if __name__ == "__main__": around what it does, and gmmjax must be importable from where it runs'
        )

    def stop(self, *, at_once: bool) -> None:
        """Ends all processes; see `AbstractPool`."""
        for lane in self._lanes:
            if lane is not None:
                lane.stop(at_once=at_once)
        self._lanes = [None] * self.capacity


class _Lane:
    """One process."""

    def __init__(self, cores: int):
        # No fork: the threads of XLA would be missing in the copy.
        self._executor = ProcessPoolExecutor(
            1, mp_context=get_context("spawn"), initializer=start_worker, initargs=(cores,)
        )
        self._process = self._executor.submit(os.getpid)
        self._latest: Future[Any] | None = None

    @property
    def began(self) -> bool:
        """True where the process was there, or is still being started."""
        return not self._process.done() or self._process.exception() is None

    @property
    def free(self) -> bool:
        """True where it has nothing to do."""
        return self._latest is None or self._latest.done()

    def submit(self, function: Any, *arguments: Any) -> "Future[Any]":
        self._latest = self._executor.submit(function, *arguments)
        return self._latest

    def stop(self, *, at_once: bool) -> None:
        if at_once and self._process.done() and self._process.exception() is None and not self.free:
            with contextlib.suppress(OSError):
                os.kill(self._process.result(), signal.SIGTERM)
        self._executor.shutdown(wait=not at_once, cancel_futures=True)


class ExecutorPool(AbstractPool):
    """Any `concurrent.futures.Executor`, such as `mpi4py.futures.MPIPoolExecutor`. Whoever made it ends it."""

    def __init__(self, executor: Executor, capacity: int):
        """Takes an executor whose workers can import gmmjax, and the calls that it is given at a time."""
        self.capacity = capacity
        self._executor = executor
        self._running: set[Future[Any]] = set()

    def submit(self, function: Any, *arguments: Any) -> "Future[Any]":
        """Hands a call over; see `AbstractPool`.

        Raises:
            ComputationError: the executor takes no calls any more.
        """
        try:
            future = self._executor.submit(_call, _this_process(), function, arguments)
        except RuntimeError as error:
            reason = one_line(error)
            raise ComputationError(
                f"the executor takes no more work ({reason}); what is done is kept: start again with a new one"
            ) from error
        self._running.add(future)
        future.add_done_callback(self._running.discard)
        return future

    def stop(self, *, at_once: bool) -> None:
        """Takes back what has not begun; see `AbstractPool`."""
        if at_once:
            for future in list(self._running):
                future.cancel()


class ClusterPool(ExecutorPool):
    """The workers of a Dask cluster. It sends a call again where a worker dies."""

    def __init__(self, address: str):
        """Connects to the scheduler at an address, such as tcp://10.0.0.1:8786.

        Raises:
            InputError: Dask is not installed, nobody answers at the address, or the cluster has no workers.
        """
        self._address = address
        # Its log has pages of traceback where a scheduler goes, of which `lost` tells in a line.
        self._log = logging.getLogger("distributed.client")
        self._level = self._log.level
        self._client = _connected(address)
        self._log.setLevel(logging.CRITICAL + 1)
        threads = sum(self._client.nthreads().values())
        if not threads:
            self._client.close()
            raise InputError(f"scheduler {address}: has no workers; start some with: dask worker {address}")
        # Twice as many as compute: none waits for the next message.
        super().__init__(self._client.get_executor(pure=False), 2 * threads)

    def lost(self, error: BaseException) -> ComputationError | None:
        """The error where the scheduler has gone; see `AbstractPool`."""
        if not isinstance(error, CancelledError | OSError) and self._client.status == "running":
            return None
        return ComputationError(
            f"the scheduler at {self._address} has gone ({one_line(error)}); what is done is kept: "
            "start the cluster and the same command again, which goes on from there"
        )

    def stop(self, *, at_once: bool) -> None:
        """Leaves the cluster; see `AbstractPool`."""
        super().stop(at_once=at_once)
        with contextlib.suppress(Exception):
            self._client.close(timeout=5)
        self._log.setLevel(self._level)


def died(error: BaseException) -> bool:
    """True where an error of a future means that the worker died, by the standard library or by Dask."""
    return isinstance(error, BrokenExecutor) or type(error).__name__ == "KilledWorker"


@dataclasses.dataclass(frozen=True, eq=False)
class Workers:
    """Choice of workers: processes of this machine, the workers of a Dask cluster, or any executor.

    Attributes:
        count: processes of this machine; None: one a core.
        scheduler: address of a Dask scheduler, such as tcp://10.0.0.1:8786, in their place.
        executor: any other `concurrent.futures.Executor`, in their place.
        capacity: calls that an executor is given before the first one is done: more than it has workers.

    Raises:
        InputError: no process at all, or two places.
    """

    count: int | None = None
    scheduler: str | None = None
    executor: Executor | None = None
    capacity: int | None = None

    def __post_init__(self) -> None:
        if self.count is not None and self.count < 1:
            raise InputError(f"workers={self.count} must be at least 1")
        if self.scheduler is not None and self.executor is not None:
            raise InputError("scheduler and executor are two places to compute; give one of them")

    def pool(self, calls: int | None, *, share_cores: bool = True) -> AbstractPool:
        """The pool for a number of calls: no more processes than those.

        Args:
            calls: number of them; None: it is not known.
            share_cores: whether fewer processes than cores have several each; else all have one.

        Raises:
            InputError: the scheduler cannot be reached, or has no workers.
        """
        cores = available_cores()
        if self.scheduler is not None:
            return ClusterPool(self.scheduler)
        if self.executor is not None:
            return ExecutorPool(self.executor, self.capacity or 2 * (self.count or cores))
        wanted = self.count or cores
        count = max(1, wanted if calls is None else min(wanted, calls))
        return LocalPool(count, max(1, cores // count) if share_cores else 1)


def _connected(address: str) -> "Client":
    try:
        from distributed import Client
    except ImportError as error:
        raise InputError("a scheduler needs Dask; install it with: pip install 'gmmjax[cluster]'") from error
    try:
        return Client(address, timeout=5, set_as_default=False)
    except (OSError, ValueError) as error:
        raise InputError(
            f"scheduler {address}: cannot be reached ({one_line(error)}); check address and network"
        ) from error


def _call(caller: tuple[str, int], function: Any, arguments: tuple[Any, ...]) -> Any:
    """Run a call in a worker that others started: on one core, as each thread of a cluster's worker has.

    A thread of the caller's own process keeps its cores: the limit is the process's, and would outlast the call.

    Args:
        caller: the process that handed the call over.
        function: to call.
        arguments: of the function.
    """
    if _this_process() != caller:
        use_cores(1)
    return function(*arguments)


def _this_process() -> tuple[str, int]:
    return platform.node(), os.getpid()
