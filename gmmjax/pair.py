"""What belongs to the earlier and to the later of two clouds, as one value."""

import dataclasses
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from typing import Any, Generic, TypeVar

from gmmjax._cores import available_cores

Held = TypeVar("Held", covariant=True)
Made = TypeVar("Made")


@dataclasses.dataclass(frozen=True, slots=True)
class Pair(Generic[Held]):
    """Something of the before cloud, and the same of the after cloud; iterates over the two.

    Attributes:
        before: of the before cloud.
        after: of the after cloud.
    """

    before: Held
    after: Held

    def __iter__(self) -> Iterator[Held]:
        yield self.before
        yield self.after

    def map(self, function: Callable[[Held], Made]) -> "Pair[Made]":
        """The function's value for either side."""
        return Pair(function(self.before), function(self.after))

    @property
    def swapped(self) -> "Pair[Held]":
        """The other cloud's for each side: what a cloud is compared with."""
        return Pair(self.after, self.before)


def each(function: Callable[..., Made], *pairs: Pair[Any]) -> Pair[Made]:
    """The function's value for each side, with that side of every pair as arguments."""
    return Pair(function(*(pair.before for pair in pairs)), function(*(pair.after for pair in pairs)))


def parallel_map(function: Callable[..., Made], *pairs: Pair[Any]) -> Pair[Made]:
    """`each` with both sides at the same time, where there are two cores: for functions that release Python's lock."""
    if available_cores() < 2:
        return each(function, *pairs)
    with ThreadPoolExecutor(2) as threads:
        return each(lambda *own: threads.submit(function, *own), *pairs).map(lambda side: side.result())
