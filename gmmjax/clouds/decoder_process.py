"""A process of its own for libraries that a damaged file may crash: their end is then not ours."""

import contextlib
import json
import os
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from gmmjax.errors import InputError, one_line

PROGRAM = Path(__file__).with_name("decoder_main.py")
# Memory that decoding takes beside its result: what threads reserve for their stacks and allocations, bytes.
WORKING_MEMORY = 1 << 30
MEMORY_OF_THREAD = 1 << 27
# Seconds for starting on a slow or busy machine; decoding has its own in proportion to the file.
START = 60.0


class DecodingError(Exception):
    """Exception of the library: its name, its message, and the module that was missing."""

    def __init__(self, kind: str, message: str, name: str | None) -> None:
        super().__init__(message)
        self.kind, self.name = kind, name


@dataclass(frozen=True)
class Request:
    """Request to decode a file.

    Attributes:
        decoder: of `decoder_main.DECODERS`.
        file: to read.
        library: that reads it, for messages.
        memory: bytes that the result takes in the process, at most.
        seconds: that decoding takes, at most, on a slow machine.
        details: for the decoder, as JSON.
    """

    decoder: str
    file: Path
    library: str
    memory: int
    seconds: float
    details: dict[str, Any] = field(default_factory=dict)

    def line(self) -> bytes:
        """The request as `decoder_main` reads it."""
        memory = WORKING_MEMORY + MEMORY_OF_THREAD * (os.cpu_count() or 1) + self.memory
        own = {"decoder": self.decoder, "path": os.path.abspath(self.file), "memory": memory, "sys_path": sys.path}
        return json.dumps(self.details | own).encode() + b"\n"


class DecoderProcess:
    """The process, for one file or several; started with the first, and again after a crash. Use as a context."""

    def __init__(self) -> None:
        self._process: subprocess.Popen[bytes] | None = None

    def __enter__(self) -> "DecoderProcess":
        return self

    def __exit__(self, *_: object) -> None:
        self._end()

    def decode(self, request: Request) -> Iterator[bytearray]:
        """Yield the data of a file, in the pieces in which the decoder gives them.

        Raises:
            InputError: the library crashed, or took too long or too much memory; it names the file.
            DecodingError: the library raised something.
        """
        process = self._running(request)
        limit = left = START + request.seconds
        kind, data = b"D", bytearray()
        try:
            # Where it has ended, reading its answer says how.
            with contextlib.suppress(OSError):
                assert process.stdin is not None
                process.stdin.write(request.line())
                process.stdin.flush()
            while kind == b"D":
                kind, data, left = _frame(process, left)
                if kind == b"D":
                    yield data
            if not kind:
                raise _ended(request, process.wait(), limit if left <= 0 else None)
        finally:
            # Half an answer must not be taken for the next one.
            if kind not in (b"E", b"."):
                self._end()
        if kind == b"E":
            raise _raised(request, **json.loads(data))

    def _running(self, request: Request) -> "subprocess.Popen[bytes]":
        if self._process is None or self._process.poll() is not None:
            if not sys.executable:
                raise InputError(f"{request.file}: Python does not know its own program; read the file in plain Python")
            self._end()
            pipe, program = subprocess.PIPE, [sys.executable, "-P", str(PROGRAM)]
            try:
                self._process = subprocess.Popen(program, stdin=pipe, stdout=pipe, stderr=subprocess.DEVNULL)
            except OSError as error:
                raise InputError(
                    f"{request.file}: no process can be started to read it ({error.strerror}); free some memory"
                ) from error
        return self._process

    def _end(self) -> None:
        process, self._process = self._process, None
        if process is None:
            return
        process.kill()
        for stream in (process.stdin, process.stdout):
            assert stream is not None
            # What was not written yet cannot be any more.
            with contextlib.suppress(OSError):
                stream.close()
        process.wait()


def _frame(process: "subprocess.Popen[bytes]", seconds: float) -> tuple[bytes, bytearray, float]:
    """The kind and the data of the next frame, and the seconds that are left; no kind where the process has ended.

    It is ended where its answer is waited for longer; what the caller does between two frames does not count.
    """
    timer, start = threading.Timer(seconds, process.kill), time.monotonic()
    timer.start()
    try:
        assert process.stdout is not None
        head = process.stdout.read(9)
        data = bytearray(int.from_bytes(head[1:], "little"))
        whole = len(head) == 9 and process.stdout.readinto(data) == len(data)  # type: ignore[attr-defined]
    finally:
        timer.cancel()
    left = seconds - (time.monotonic() - start)
    if left <= 0:
        process.kill()
    return head[:1] if whole and left > 0 else b"", data, left


def _ended(request: Request, status: int, limit: float | None) -> InputError:
    how = f"crashed on it ({f'signal {-status}' if status < 0 else f'exit status {status}'})"
    if limit is not None:
        how = f"did not finish within {limit:.0f} s"
    return InputError(f"{request.file}: {request.library} {how}; the file is damaged, copy or export it again")


def _raised(request: Request, kind: str, message: str, name: str | None) -> Exception:
    if kind == "MemoryError":
        return InputError(
            f"{request.file}: {request.library} needs more memory for it than a file of its size takes; the file is "
            "damaged, or the memory is full: copy it again, or free some memory"
        )
    return DecodingError(kind, one_line(Exception(message)), name)
