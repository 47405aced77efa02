"""A number for each point and restart, computed when it is asked for: memory does not grow with the restarts."""

import dataclasses
from collections.abc import Callable, Iterator
from typing import TypeAlias

import numpy as np
from jaxtyping import Int, Num

Rows: TypeAlias = Int[np.ndarray, " m"] | slice
ALL = slice(None)


@dataclasses.dataclass(frozen=True, eq=False)
class RestartValues:
    """A number for each point of a cloud by each restart.

    Attributes:
        restarts: how many.
        of: gives the numbers of some points, by the number of the restart and the rows of the points.
    """

    restarts: int
    of: Callable[[int, Rows], Num[np.ndarray, " m"]]

    def each(self, rows: Rows = ALL) -> Iterator[Num[np.ndarray, " m"]]:
        """The numbers of one restart after the other.

        Args:
            rows: of the points.
        """
        return (self.of(restart, rows) for restart in range(self.restarts))

    def together(self, rows: Rows = ALL) -> Num[np.ndarray, "m r"]:
        """The numbers of all restarts: of few points.

        Args:
            rows: of the points.
        """
        return np.stack(list(self.each(rows)), axis=1)
