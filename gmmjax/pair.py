"""What belongs to the earlier and to the later of two clouds, as one value."""

from collections.abc import Callable
from typing import Any, Generic, NamedTuple, TypeVar

Held = TypeVar("Held", covariant=True)
Made = TypeVar("Made")


class Pair(NamedTuple, Generic[Held]):
    """Something of the before cloud, and the same of the after cloud.

    Attributes:
        before: of the before cloud.
        after: of the after cloud.
    """

    before: Held
    after: Held

    def map(self, function: Callable[[Held], Made]) -> "Pair[Made]":
        """The function's value for either side."""
        return Pair(function(self.before), function(self.after))

    @property
    def swapped(self) -> "Pair[Held]":
        """The other cloud's for each side: what a cloud is compared with."""
        return Pair(self.after, self.before)


def each(function: Callable[..., Made], *pairs: tuple[Any, Any]) -> Pair[Made]:
    """The function's value for each side, with that side of every pair as arguments."""
    return Pair(function(*(pair[0] for pair in pairs)), function(*(pair[1] for pair in pairs)))
