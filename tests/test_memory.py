"""Memory that was freed goes back to the system, where the C library can."""

import platform
import subprocess
import sys

import pytest

from gmmjax._memory import release_freed_memory

# Blocks small enough to come from the heap, of which the last one stays and keeps all below it from being given back.
PROGRAM = """
from gmmjax._memory import release_freed_memory

def resident():
    with open("/proc/self/statm") as file:
        return int(file.read().split()[1])

blocks = [bytes(bytearray(b"x" * 50_000)) for _ in range(4_000)]
full = resident()
del blocks[:-1]
kept = resident()
release_freed_memory()
print(full, kept, resident())
"""


@pytest.mark.skipif(platform.libc_ver()[0] != "glibc", reason="other C libraries have no call for it")
def test_freed_memory_is_given_back():
    printed = subprocess.run([sys.executable, "-c", PROGRAM], check=True, capture_output=True, text=True).stdout
    full, kept, left = map(int, printed.split())
    assert kept > 0.8 * full
    assert left < kept - 0.5 * (4_000 * 50_000 / 4096)


@pytest.mark.parametrize("system", ["win32", "darwin", sys.platform])
def test_it_may_be_called_on_every_system(monkeypatch, system):
    monkeypatch.setattr(sys, "platform", system)
    release_freed_memory()
