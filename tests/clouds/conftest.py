"""Files made by hand."""

import itertools
from collections.abc import Callable
from pathlib import Path

import pytest

WriteFile = Callable[[str, bytes], Path]


@pytest.fixture(scope="session")
def write_file(tmp_path_factory: pytest.TempPathFactory) -> WriteFile:
    """Writes bytes under a name in a folder of its own; of session scope, so that hypothesis may call it."""
    folder = tmp_path_factory.mktemp("files")
    numbers = itertools.count()

    def write(name: str, content: bytes) -> Path:
        path = folder / f"{next(numbers)}-{name}"
        path.write_bytes(content)
        return path

    return write


@pytest.fixture(scope="session")
def lzf_compress() -> Callable[[bytes], bytes]:
    return _lzf_compress


def _lzf_compress(data: bytes) -> bytes:
    """A greedy LZF compressor: the latest place of each three bytes, references as long as the format allows."""
    places: dict[bytes, int] = {}
    out, literals, position = bytearray(), bytearray(), 0

    def flush() -> None:
        for start in range(0, len(literals), 32):
            run = literals[start : start + 32]
            out.extend([len(run) - 1, *run])
        literals.clear()

    while position < len(data):
        key = data[position : position + 3]
        start = places.get(key, -1)
        places[key] = position
        if len(key) < 3 or start < 0 or position - start > 8192:
            literals.append(data[position])
            position += 1
            continue
        length = 3
        while length < 264 and position + length < len(data) and data[start + length] == data[position + length]:
            length += 1
        flush()
        distance, rest = position - start - 1, length - 2
        out.append(min(rest, 7) << 5 | distance >> 8)
        if rest >= 7:
            out.append(rest - 7)
        out.append(distance & 255)
        position += length
    flush()
    return bytes(out)
