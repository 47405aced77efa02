"""What gmmjax raises and warns with: the message names the file or argument, and the remedy."""

import os
import reprlib
import sys
import textwrap
import warnings
from collections.abc import Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager
from contextvars import ContextVar
from pathlib import Path
from types import FrameType

# Characters of a message: more than any that we compose, less than what a file may hold in place of a name.
LONGEST = 1500


class InputError(ValueError):
    """An input that cannot be used: a file, an array or a setting. The command line exits with status 2 on it.

    The message is one line that a terminal can show, whatever was in the file: what cannot be printed is escaped, and
    the middle of a long one is left out.
    """

    def __init__(self, message: str) -> None:
        super().__init__(_shortened(printable(_shortened(message))))


def _shortened(message: str) -> str:
    return message if len(message) <= LONGEST else f"{message[: LONGEST - 300]} ... {message[-290:]}"


def printable(text: str) -> str:
    """A text that a terminal can show on one line: characters that control it are escaped."""
    if text.isprintable():
        return text
    return "".join(
        character if character.isprintable() else character.encode("unicode_escape").decode("ascii")
        for character in text
    )


class ComputationError(RuntimeError):
    """A computation whose status says that its result must not be used, raised once on the host."""


class InputWarning(UserWarning):
    """An input that can be used but looks wrong, such as two clouds in different units."""


_collected: ContextVar[list[str] | None] = ContextVar("collected warnings", default=None)
_recorded: ContextVar[list[str] | None] = ContextVar("recorded warnings", default=None)


def collected_warnings() -> AbstractContextManager[list[str]]:
    """Collects what `warn` is told in this block and this thread, in place of warning of it.

    Yields:
        The messages, which grow while the block runs.
    """
    return _listening(_collected)


def recorded_warnings() -> AbstractContextManager[list[str]]:
    """Records what `warn` is told in this block and this thread; the warnings are given as well.

    Yields:
        The messages, which grow while the block runs.
    """
    return _listening(_recorded)


@contextmanager
def _listening(listener: ContextVar[list[str] | None]) -> Iterator[list[str]]:
    messages: list[str] = []
    token = listener.set(messages)
    try:
        yield messages
    finally:
        listener.reset(token)


def warn(message: str) -> None:
    """Gives an `InputWarning` that points to the user's line: the one that called gmmjax."""
    recorded = _recorded.get()
    if recorded is not None:
        recorded.append(message)
    collected = _collected.get()
    if collected is not None:
        collected.append(message)
        return
    warnings.warn(message, InputWarning, stacklevel=_levels_to_the_caller(sys._getframe()))


def _levels_to_the_caller(frame: FrameType | None) -> int:
    """The `stacklevel`, in this frame, of the one that called the package first.

    Python 3.12 has `skip_file_prefixes`, which stops at the first frame outside, such as a context manager of the
    standard library between two functions of the package.
    """
    package = f"{Path(__file__).parent}{os.sep}"
    level = outermost = 1
    while frame is not None:
        if frame.f_code.co_filename.startswith(package):
            outermost = level
        frame, level = frame.f_back, level + 1
    return outermost + 1


LARGEST_INTEGER = 2**63 - 1
"""That a 64-bit integer can be: whole numbers in files and settings, and the seeds that random keys are made of."""


def check_seed(name: str, seed: int) -> None:
    """Raises an `InputError` that names the argument, unless a random key can be made of the seed."""
    if not 0 <= seed <= LARGEST_INTEGER:
        raise InputError(f"{name} {seed} must be at least 0 and below 2^63")


def check_choice(name: str, value: object, choices: Sequence[str]) -> None:
    """Raises an `InputError` that names the argument and its choices, unless the value is one of them."""
    if value not in choices:
        raise InputError(f"{name}={shown(value)} is unknown; choose from {', '.join(choices)}")


def shown(value: object) -> str:
    """A value for a message, however long it is or deeply nested."""
    try:
        return " ".join(_Shortened().repr(value).split())
    # Python refuses to write whole numbers of more than 4300 digits.
    except ValueError:
        return "a number of thousands of digits" if isinstance(value, int) else f"<{type(value).__name__}>"


def one_line(error: BaseException) -> str:
    """What an exception of another library says, in one line of at most 200 characters, cut between words."""
    text = " ".join(str(error).split()) or type(error).__name__
    return textwrap.shorten(text, 200, placeholder=" ...") if len(text) > 200 and " " in text[:200] else text[:200]


class _Shortened(reprlib.Repr):
    """Six numbers and two levels in full."""

    def __init__(self) -> None:
        super().__init__()
        self.maxlevel, self.maxstring, self.maxother = 3, 60, 60
