"""What gmmjax raises and warns with: the message names the file or argument, and the remedy."""

from collections.abc import Sequence


class InputError(ValueError):
    """An input that cannot be used: a file, an array or a setting. The command line exits with status 2 on it."""


class ComputationError(RuntimeError):
    """A computation whose status says that its result must not be used, raised once on the host."""


class InputWarning(UserWarning):
    """An input that can be used but looks wrong, such as two clouds in different units."""


LARGEST_SEED = 2**63 - 1
"""Random keys are made of 64-bit integers."""


def check_seed(name: str, seed: int) -> None:
    """Raises an `InputError` that names the argument, unless a random key can be made of the seed."""
    if not 0 <= seed <= LARGEST_SEED:
        raise InputError(f"{name} {seed} must be at least 0 and below 2^63")


def check_choice(name: str, value: object, choices: Sequence[str]) -> None:
    """Raises an `InputError` that names the argument and its choices, unless the value is one of them."""
    if value not in choices:
        raise InputError(f"{name}={value!r} is unknown; choose from {', '.join(choices)}")
