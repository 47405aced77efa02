"""The program of a `DecoderProcess`: reads files with libraries that a damaged file may crash.

It is run as a script and imports nothing of gmmjax, so that it starts at once. Each line of its input is a request in
JSON; it answers with frames: a byte for the kind, the length in eight bytes, and the bytes. Kinds are D, data; E,
an error in JSON; and ".", the end of the answer.
"""

import contextlib
import json
import os
import sys
from collections.abc import Callable, Iterator
from typing import Any, BinaryIO

# Decompressed bytes in a frame, at most: what the two processes hold beside the result.
FRAME = 1 << 26


def main() -> None:
    """Answers requests until the input ends."""
    # What the libraries print must not get among the frames.
    answers = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)
    for line in sys.stdin.buffer:
        request = json.loads(line)
        sys.path[:] = request["sys_path"]
        try:
            for data in DECODERS[request["decoder"]](request):
                _send(answers, b"D", data)
            _send(answers, b".", b"")
        except MemoryError:
            _send_error(answers, "MemoryError", "out of memory", None)
        except (KeyboardInterrupt, BrokenPipeError):
            return
        # A panic of Rust is no Exception.
        except BaseException as error:
            missing = error.name if isinstance(error, ModuleNotFoundError) else None
            _send_error(answers, type(error).__name__, str(error), missing)


def decode_laz(request: dict[str, Any]) -> Iterator[bytes | bytearray]:
    """The point records of a LAZ file, decompressed, some at a time."""
    import lazrs

    _limit_memory(request["memory"])
    record, vlr = request["record_length"], bytes.fromhex(request["vlr"])
    with open(request["path"], "rb") as file:
        file.seek(request["offset"])
        chunks = lazrs.read_chunk_table(file, lazrs.LazVlr(vlr))
        _check_chunks(chunks, request["count"], request["chunk_bytes"])
        file.seek(request["offset"])
        decompressor = lazrs.ParLasZipDecompressor(file, vlr)
        left = request["count"]
        while left:
            records = bytearray(min(left, max(FRAME // record, 1)) * record)
            decompressor.decompress_many(records)
            left -= len(records) // record
            yield records


def decode_mesh(request: dict[str, Any]) -> Iterator[bytes | bytearray]:
    """The vertices of a mesh and their colours, float64 [N, 3] each."""
    import numpy as np
    import open3d

    _limit_memory(request["memory"])
    open3d.utility.set_verbosity_level(open3d.utility.VerbosityLevel.Error)
    mesh = open3d.io.read_triangle_mesh(request["path"])
    for values in (mesh.vertices, mesh.vertex_colors):
        yield np.ascontiguousarray(values, np.float64).tobytes()


DECODERS: dict[str, Callable[[dict[str, Any]], Iterator[bytes | bytearray]]] = {"laz": decode_laz, "mesh": decode_mesh}


def _check_chunks(chunks: list[tuple[int, int]], count: int, chunk_bytes: int) -> None:
    """Whether the entries of the chunk table, points and bytes of each chunk, add up to what is there."""
    points, size = (sum(int(entry[index]) for entry in chunks) for index in (0, 1))
    if points < count or size != chunk_bytes:
        raise ValueError(
            f"its chunk table has {points} points in {size} bytes, there are {count} points in {chunk_bytes} bytes"
        )


def _limit_memory(more: int) -> None:
    """Limits the process to this number of bytes beyond its libraries', where the system can limit it."""
    with contextlib.suppress(ImportError, OSError, ValueError):
        import resource

        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        with open("/proc/self/statm", encoding="ascii") as statm:
            size = int(statm.read().split()[0]) * resource.getpagesize()
        resource.setrlimit(resource.RLIMIT_AS, (size + more, resource.getrlimit(resource.RLIMIT_AS)[1]))


def _send(answers: BinaryIO, kind: bytes, data: bytes | bytearray) -> None:
    answers.write(kind + len(data).to_bytes(8, "little"))
    answers.write(data)
    answers.flush()


def _send_error(answers: BinaryIO, kind: str, message: str, name: str | None) -> None:
    _send(answers, b"E", json.dumps({"kind": kind, "message": message[:500], "name": name}).encode())


if __name__ == "__main__":
    main()
