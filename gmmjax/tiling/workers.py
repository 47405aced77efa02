"""Where tiles are computed: processes of this machine, the workers of a Dask cluster, or any executor."""

import dataclasses
from concurrent.futures import Executor

from gmmjax._cores import available_cores
from gmmjax.batch import AbstractPool, ClusterPool, ExecutorPool, LocalPool, check_workers
from gmmjax.errors import InputError


@dataclasses.dataclass(frozen=True, eq=False)
class Workers:
    """Where tiles are computed. All workers must see the working folder by the same path.

    Attributes:
        count: processes of this machine, of one core each; None: one a core.
        scheduler: address of a Dask scheduler, such as tcp://10.0.0.1:8786, in their place.
        executor: any other `concurrent.futures.Executor`, in their place.
        capacity: tiles that an executor is given before the first one is done: more than it has workers.
    """

    count: int | None = None
    scheduler: str | None = None
    executor: Executor | None = None
    capacity: int | None = None

    def __post_init__(self) -> None:
        check_workers(self.count)
        if self.scheduler is not None and self.executor is not None:
            raise InputError("scheduler and executor are two places to compute; give one of them")

    def pool(self, tiles: int) -> AbstractPool:
        """The pool for a number of tiles: no more processes than those.

        Args:
            tiles: number of them.

        Raises:
            InputError: the scheduler cannot be reached, or has no workers.
        """
        count = self.count or available_cores()
        if self.scheduler is not None:
            return ClusterPool(self.scheduler)
        if self.executor is not None:
            return ExecutorPool(self.executor, self.capacity or 2 * count)
        # One core each: results then do not depend on how many workers share the machine.
        return LocalPool(max(1, min(count, tiles)), 1)
