"""Memory that was freed, given back to the system."""

import ctypes
import sys


def release_freed_memory() -> None:
    """Gives the system the memory that was freed, where the C library has a call for it; elsewhere nothing.

    The GNU C library keeps what it was given back between two arrays that are in use: after scans of millions of points
    that is gigabytes. See `malloc_trim(3)`.
    """
    if not sys.platform.startswith("linux"):
        return
    trim = getattr(ctypes.CDLL(None), "malloc_trim", None)
    if trim is not None:
        trim(ctypes.c_size_t(0))
