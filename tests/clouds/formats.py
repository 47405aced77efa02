"""Files of all formats with some points in survey coordinates, some of them without a position."""

import numpy as np
import pytest

from gmmjax.clouds import write_pcd, write_ply
from tests.clouds.las_files import las_bytes

COUNT = 57
# Survey coordinates: a third of a millimetre is lost in float32, and none in float64.
OFFSET = np.array([500_000.0, 5_400_000.0, 100.0])


def write_las_file(path, points):
    path.write_bytes(las_bytes(4, 7, count=len(points)))


def write_laz_file(path, points):
    laspy = pytest.importorskip("laspy")
    las = laspy.LasData(laspy.LasHeader(point_format=3, version="1.2"))
    las.header.offsets, las.header.scales = OFFSET, np.full(3, 1e-4)
    las.xyz = points
    las.red, las.intensity = np.arange(len(points)) * 900, np.arange(len(points))
    las.write(path)


def write_e57_file(path, points):
    pye57 = pytest.importorskip("pye57")
    file = pye57.E57(str(path), mode="w")
    for part in (points[:20], points[20:]):
        data = {
            axis: part[:, index] - OFFSET[index]
            for index, axis in enumerate(("cartesianX", "cartesianY", "cartesianZ"))
        }
        data["rowIndex"] = np.arange(len(part)).astype("H")
        data["cartesianInvalidState"] = (np.arange(len(part)) % 9 == 4).astype("b")
        file.write_scan_raw(data, rotation=np.array([0.6, 0.0, 0.0, 0.8]), translation=OFFSET)
    file.close()


def with_gaps(points):
    gaps = points.copy()
    gaps[::7, 1] = np.nan
    return gaps


def write_binary_ply(path, points):
    write_ply(path, points, colors=np.full((len(points), 3), 9, np.uint8), fields={"a": np.arange(len(points))})
    # NaN is not written: put into the bytes of the second coordinate of some rows.
    data = bytearray(path.read_bytes())
    row, body = 24 + 3 + 4, data.index(b"end_header\n") + len(b"end_header\n")
    for index in range(0, len(points), 7):
        data[body + row * index + 8 : body + row * index + 16] = np.float64(np.nan).tobytes()
    path.write_bytes(data)


def write_ordered_pcd(path, points):
    gaps = points.copy()
    gaps[::7] = np.nan
    write_pcd(path, gaps.reshape(3, -1, 3), fields={"a": np.arange(len(points)).reshape(3, -1)})


WRITERS = {
    "a.las": write_las_file,
    "a.laz": write_laz_file,
    "a.e57": write_e57_file,
    "a.ply": write_binary_ply,
    "a.pcd": write_ordered_pcd,
    "b.pcd": lambda path, points: write_pcd(path, points.astype(np.float32)),
    "a.npy": lambda path, points: np.save(path, with_gaps(points)),
    "b.npy": lambda path, points: np.save(path, np.asfortranarray(np.hstack([with_gaps(points), points]))),
    "c.npy": lambda path, points: np.save(path, points.astype(">f4").reshape(3, -1, 3)),
    "a.npz": lambda path, points: np.savez(path, points=with_gaps(points), extra=np.arange(len(points))),
    "a.xyz": lambda path, points: np.savetxt(path, with_gaps(points)),
}


def write_all(folder):
    """Writes a file of each format into a folder."""
    points = np.random.default_rng(0).uniform(-10, 10, (COUNT, 3)).round(4) + OFFSET
    for name, write in WRITERS.items():
        write(folder / name, points)
