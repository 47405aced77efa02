"""A process of its own for libraries that a damaged file may crash: their end is then not ours."""

import json
import os
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any

from gmmjax.errors import InputError, one_line

PROGRAM = Path(__file__).with_name("decoder_main.py")
# Memory that decoding takes beside its result: what threads reserve for their stacks and allocations, bytes.
WORKING_MEMORY = 1 << 30
MEMORY_OF_THREAD = 1 << 27
# Seconds for starting on a slow or busy machine; decoding has its own in proportion to the file.
START = 60.0


class DecodingError(Exception):
    """What the library raised: the name of its exception, its message, and the module that was missing."""

    def __init__(self, kind: str, message: str, name: str | None) -> None:
        super().__init__(message)
        self.kind, self.name = kind, name


@dataclass(frozen=True)
class Request:
    """What is to be decoded.

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
    details: dict[str, Any]


class DecoderProcess:
    """The process, for one file or several; started with the first, and again after a crash. Use as a context."""

    def __init__(self) -> None:
        self._process: subprocess.Popen[bytes] | None = None

    def __enter__(self) -> "DecoderProcess":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._end()

    def decode(self, request: Request) -> Iterator[bytearray]:
        """The data of a file, in the pieces in which the decoder gives them.

        Raises:
            InputError: the library crashed, or took too long or too much memory; it names the file.
            DecodingError: the library raised something.
        """
        process = self._running(request)
        clock = _Clock(process, START + request.seconds)
        finished = False
        try:
            self._ask(process, request)
            while (frame := clock.frame()) is not None:
                kind, data = frame
                finished = kind != b"D"
                if finished:
                    break
                yield data
            else:
                status = process.wait()
                raise _ended(request, status, clock.limit if clock.late else None)
        finally:
            # Half an answer must not be taken for the next one.
            if not finished:
                self._end()
        if kind == b"E":
            error = json.loads(data)
            if error["kind"] == "MemoryError":
                raise _too_large(request)
            raise DecodingError(error["kind"], one_line(Exception(error["message"])), error["name"])

    def _running(self, request: Request) -> subprocess.Popen[bytes]:
        if self._process is None or self._process.poll() is not None:
            if not sys.executable:
                raise InputError(f"{request.file}: Python does not know its own program; read the file in plain Python")
            self._end()
            try:
                self._process = subprocess.Popen(
                    [sys.executable, "-P", str(PROGRAM)],
                    stdin=subprocess.PIPE,
                    stdout=subprocess.PIPE,
                    stderr=subprocess.DEVNULL,
                )
            except OSError as error:
                raise InputError(
                    f"{request.file}: no process can be started to read it ({error.strerror}); free some memory"
                ) from error
        return self._process

    def _ask(self, process: subprocess.Popen[bytes], request: Request) -> None:
        assert process.stdin is not None
        threads = MEMORY_OF_THREAD * (os.cpu_count() or 1)
        content = request.details | {
            "decoder": request.decoder,
            "path": os.path.abspath(request.file),
            "memory": WORKING_MEMORY + threads + request.memory,
            "sys_path": sys.path,
        }
        try:
            process.stdin.write(json.dumps(content).encode() + b"\n")
            process.stdin.flush()
        except OSError:
            # It has ended: reading its answer says how.
            pass

    def _end(self) -> None:
        process, self._process = self._process, None
        if process is None:
            return
        process.kill()
        for stream in (process.stdin, process.stdout):
            assert stream is not None
            try:
                stream.close()
            # What was not written yet cannot be any more.
            except OSError:
                pass
        process.wait()


class _Clock:
    """Ends the process where it takes too long: what counts is the time for which its answer is waited for.

    Attributes:
        limit: seconds that all frames together may take.
        late: whether they took longer.
    """

    def __init__(self, process: subprocess.Popen[bytes], limit: float) -> None:
        self._process, self._left = process, limit
        self.limit, self.late = limit, False

    def frame(self) -> tuple[bytes, bytearray] | None:
        """The next frame, as `_frame`."""
        timer = threading.Timer(self._left, self._stop)
        start = time.monotonic()
        timer.start()
        try:
            answer = _frame(self._process)
        finally:
            timer.cancel()
        self._left -= time.monotonic() - start
        if self._left < 0:
            self._stop()
        return None if self.late else answer

    def _stop(self) -> None:
        self.late = True
        self._process.kill()


def _frame(process: subprocess.Popen[bytes]) -> tuple[bytes, bytearray] | None:
    """The kind and the data of the next frame, or None where the process has ended."""
    assert process.stdout is not None
    head = process.stdout.read(9)
    if len(head) < 9:
        return None
    data = bytearray(int.from_bytes(head[1:], "little"))
    if process.stdout.readinto(data) < len(data):  # type: ignore[attr-defined]
        return None
    return head[:1], data


def _ended(request: Request, status: int, limit: float | None) -> InputError:
    if limit is not None:
        return InputError(
            f"{request.file}: {request.library} did not finish within {limit:.0f} s; the file is damaged, "
            "copy or export it again"
        )
    how = f"signal {-status}" if status < 0 else f"exit status {status}"
    return InputError(
        f"{request.file}: {request.library} crashed on it ({how}); the file is damaged, copy or export it again"
    )


def _too_large(request: Request) -> InputError:
    return InputError(
        f"{request.file}: {request.library} needs more memory for it than a file of its size takes; the file is "
        "damaged, or the memory is full: copy it again, or free some memory"
    )
