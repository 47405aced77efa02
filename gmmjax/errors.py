"""What gmmjax raises and warns with: the message names the file or argument, and the remedy."""

from collections.abc import Sequence


class InputError(ValueError):
    """An input that cannot be used: a file, an array or a setting. The command line exits with status 2 on it."""


class ComputationError(RuntimeError):
    """A computation whose status says that its result must not be used, raised once on the host."""


class InputWarning(UserWarning):
    """An input that can be used but looks wrong, such as two clouds in different units."""


def check_choice(name: str, value: object, choices: Sequence[str]) -> None:
    """Raises an `InputError` that names the argument and its choices, unless the value is one of them."""
    if value not in choices:
        raise InputError(f"{name}={value!r} is unknown; choose from {', '.join(choices)}")
