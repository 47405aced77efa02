"""The log on standard error, for `--verbose`."""

import logging
import sys
from collections.abc import Iterator
from contextlib import contextmanager

from gmmjax.errors import printable


class _Formatter(logging.Formatter):
    """One line for each record: seconds since the start of the program, the message, of a detail where it is from."""

    def format(self, record: logging.LogRecord) -> str:
        where = f"{record.name}: " if record.levelno < logging.INFO else ""
        return printable(f"{record.relativeCreated / 1000:7.2f} s  {where}{record.getMessage()}")


@contextmanager
def shown_log(verbosity: int) -> Iterator[None]:
    """Shows what the package logs while the block runs.

    Args:
        verbosity: 0: nothing; 1: stages, sizes and what was derived; 2 and more: details, too.
    """
    if verbosity <= 0:
        yield
        return
    logger = logging.getLogger("gmmjax")
    handler, level = logging.StreamHandler(sys.stderr), logger.level
    handler.setFormatter(_Formatter())
    logger.addHandler(handler)
    logger.setLevel(logging.INFO if verbosity == 1 else logging.DEBUG)
    try:
        yield
    finally:
        logger.removeHandler(handler)
        logger.setLevel(level)
