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
FRAME = 1 << 25
E57_COORDINATES = (
    {"cartesianX", "cartesianY", "cartesianZ"},
    {"sphericalRange", "sphericalAzimuth", "sphericalElevation"},
)


def main() -> None:
    """Answer requests until the input ends."""
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
        except (KeyboardInterrupt, BrokenPipeError):
            return
        # A panic of Rust is no Exception.
        except BaseException as error:
            kind = "MemoryError" if isinstance(error, MemoryError) else type(error).__name__
            missing = error.name if isinstance(error, ModuleNotFoundError) else None
            details = {"kind": kind, "message": str(error)[:500], "name": missing}
            _send(answers, b"E", json.dumps(details).encode())


def decode_laz(request: dict[str, Any]) -> Iterator[bytes | bytearray]:
    """Decompress the points of a LAZ file, some at a time; by LASzip itself where lazrs is too old for it."""
    import lazrs

    _limit_memory(request["memory"])
    record, left, vlr = request["record_length"], request["count"], bytes.fromhex(request["vlr"])
    with open(request["path"], "rb") as file:
        file.seek(request["offset"])
        # Where chunks differ, the size of one stands for the most points that any may have.
        held = sum(points for points, _ in lazrs.read_chunk_table(file, lazrs.LazVlr(vlr)))
        if held < left:
            raise ValueError(f"its chunks hold {held} points, {left} are declared")
        file.seek(request["offset"])
        decompress = lazrs.ParLasZipDecompressor(file, vlr).decompress_many
        while left:
            records = bytearray(min(left, max(FRAME // record, 1)) * record)
            try:
                decompress(records)
            except lazrs.LazrsError as error:
                if "version" not in str(error):
                    raise
                decompress = _laszip_decompressor(file)
                decompress(records)
            left -= len(records) // record
            yield records


def _laszip_decompressor(file: BinaryIO) -> Callable[[bytearray], None]:
    import laszip

    file.seek(0)
    decompress: Callable[[bytearray], None] = laszip.LasUnZipper(file).decompress_into
    return decompress


def decode_mesh(request: dict[str, Any]) -> Iterator[bytes | bytearray]:
    """Yield the vertices of a mesh and their colours, float64 [N, 3] each."""
    import numpy as np
    import open3d

    _limit_memory(request["memory"])
    open3d.utility.set_verbosity_level(open3d.utility.VerbosityLevel.Error)
    mesh = open3d.io.read_triangle_mesh(request["path"])
    for values in (mesh.vertices, mesh.vertex_colors):
        yield np.ascontiguousarray(values, np.float64).tobytes()


def decode_e57(request: dict[str, Any]) -> Iterator[bytes | bytearray]:
    """Yield what an E57 file says of its scans, in JSON; then their points, float64 [N, fields], in blocks.

    Only scans with Cartesian or spherical coordinates are decoded; each ends with an empty block.
    """
    from pye57 import libe57

    _limit_memory(request["memory"])
    image = libe57.ImageFile(request["path"], "r")
    root = image.root()
    scans = [root["data3D"][index] for index in range(len(root["data3D"]))] if root.isDefined("data3D") else []
    described = [_scan_details(scan) for scan in scans]
    system = str(root["coordinateMetadata"].value()) if root.isDefined("coordinateMetadata") else ""
    yield json.dumps({"scans": described, "coordinate_metadata": system}).encode()
    for scan, details in zip(scans, described, strict=True):
        if details["count"] and any(axes <= set(details["fields"]) for axes in E57_COORDINATES):
            yield from _scan_blocks(image, scan["points"], details["fields"])
        yield b""
    image.close()


def _scan_details(scan: Any) -> dict[str, Any]:
    """Names of the numeric fields, number of points, and the pose: rotation w, x, y, z, translation."""
    from pye57 import libe57
    from pye57.utils import get_fields

    if not scan.isDefined("points"):
        return {"fields": [], "count": 0, "pose": None}
    points = scan["points"]
    prototype = libe57.StructureNode(points.prototype())
    numeric = (libe57.FloatNode, libe57.IntegerNode, libe57.ScaledIntegerNode)
    fields = [name for name in get_fields(prototype) if isinstance(prototype[name], numeric)]
    pose = None
    if scan.isDefined("pose"):
        stated = [f"pose/rotation/{axis}" for axis in "wxyz"] + [f"pose/translation/{axis}" for axis in "xyz"]
        pose = [float(scan[own].value()) if scan.isDefined(own) else float(own.endswith("w")) for own in stated]
    return {"fields": fields, "count": points.childCount(), "pose": pose}


def _scan_blocks(image: Any, points: Any, fields: list[str]) -> Iterator[bytes]:
    import numpy as np
    from pye57 import libe57

    capacity = max(min(points.childCount(), FRAME // (8 * len(fields))), 1)
    columns = [np.empty(capacity) for _ in fields]
    buffers = libe57.VectorSourceDestBuffer()
    for name, column in zip(fields, columns, strict=True):
        # Whole numbers become floats, and scaled ones are scaled.
        buffers.append(libe57.SourceDestBuffer(image, name, column, capacity, True, True))
    reader = points.reader(buffers)
    while count := reader.read():
        yield np.stack([column[:count] for column in columns], axis=1).tobytes()
    reader.close()


DECODERS: dict[str, Callable[[dict[str, Any]], Iterator[bytes | bytearray]]] = {
    "laz": decode_laz,
    "mesh": decode_mesh,
    "e57": decode_e57,
}


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


if __name__ == "__main__":
    main()
