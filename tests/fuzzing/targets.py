"""What is fuzzed: for each reader, valid files and how they are read."""

import contextlib
import dataclasses
import importlib.util
import json
import shutil
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path
from random import Random
from typing import Any
from unittest import mock

import numpy as np

from gmmjax import Changes, DetectionConfig
from gmmjax.changes import Box, Change
from gmmjax.cli.detect import read_settings
from gmmjax.clouds import (
    LasSource,
    PointCloud,
    SensorViews,
    e57,
    las,
    mesh,
    read_cloud,
    read_views,
    viewpoint_of,
    write_las,
    write_pcd,
    write_ply,
    write_views,
)
from gmmjax.clouds.decoder_process import DecoderProcess
from gmmjax.errors import InputError, InputWarning
from gmmjax.evaluation.labelled_pair import read_pair
from gmmjax.reporting.mixture_files import read_mixture
from gmmjax.reporting.result_folder import RESULT
from gmmjax.reporting.tuning_files import read_state, write_state
from gmmjax.surveys import (
    Frame,
    Intrinsics,
    open_bag,
    read_depth_frame,
    read_intrinsics,
    write_bag,
    write_depth_image,
    write_intrinsics,
)
from gmmjax.tuning import TuningState
from tests.changes.explained import explanation, rejected
from tests.clouds.las_files import GEOTIFF, WKT, evlr, extra_descriptor, las_bytes, vlr
from tests.fuzzing.mutations import mutated, mutated_archive, mutated_png

Mutate = Callable[[bytes, bytes, Random], bytes]
CAMERA = Intrinsics(8.0, 8.0, 3.5, 2.5, 8, 6)


class KeptProcess(DecoderProcess):
    """One process for all mutants, in place of one for each."""

    def __exit__(self, *_: object) -> None:
        """Lets it run."""


KEPT = KeptProcess()


@dataclasses.dataclass(frozen=True)
class Target:
    """A reader.

    Attributes:
        name: of the reader.
        write: writes valid files into a folder, and gives the names of those that are mutated.
        read: reads the file of a name in a folder.
        inside: mutates what checksums protect; every second mutant is made by it.
    """

    name: str
    write: Callable[[Path], list[str]]
    read: Callable[[Path], Any]
    inside: Mutate | None = None

    def mutant(self, files: list[tuple[str, bytes]], random: Random) -> tuple[str, bytes]:
        """The name of a file and its mutant."""
        name, data = random.choice(files)
        mutate = self.inside if self.inside is not None and random.random() < 0.5 else mutated
        return name, mutate(data, random.choice(files)[1], random)


def all_targets() -> dict[str, Target]:
    """By name; those whose library is not installed are left out."""
    targets = [*_clouds(), *_records(), *_surveys()]
    if importlib.util.find_spec("open3d") is not None:
        targets += [
            Target(f"mesh-{kind}", _mesh_writer(kind), _read_mesh) for kind in ("obj", "off", "stl", "gltf", "glb")
        ]
    return {target.name: target for target in targets}


def _clouds() -> Iterator[Target]:
    for name, text in _texts().items():
        yield Target(name.partition(".")[0], _bytes_writer(name, text), _read_cloud)
    yield Target("ply-binary", _write_ply, _read_cloud)
    yield Target("pcd-organised", _write_organised, _read_cloud)
    yield Target("npy", _npy_writer, _read_cloud)
    yield Target("npz", _npz_writer, _read_cloud, mutated_archive)
    yield Target("las", _las_writer("las"), _read_las)
    yield Target("laz", _las_writer("laz"), _read_las)
    yield Target("las-rewritten", _write_full_las, _rewrite_las)
    if importlib.util.find_spec("pye57"):
        yield Target("e57", _write_e57, _read_e57)


def _records() -> Iterator[Target]:
    yield Target("views-json", _views_writer("views.json"), read_views)
    yield Target("views-npz", _views_writer("views.npz"), read_views, mutated_archive)
    yield Target("config", _write_config, lambda path: DetectionConfig.from_dict(read_settings(path).to_dict()))
    yield Target("changes", _result_writer("changes.json"), _read_changes)
    yield Target("labels", _result_writer("labels.npz"), _read_changes, mutated_archive)
    yield Target("marker", _result_writer("changes.json"), lambda path: RESULT.is_held_by(path.parent))
    yield Target("mixture", _write_mixture, read_mixture)
    yield Target("pair", _write_pair, lambda path: read_pair(path.parent))
    yield Target("tuning-state", _write_state, lambda path: read_state(path, "these"), mutated_archive)


def _surveys() -> Iterator[Target]:
    yield Target("intrinsics", _write_intrinsics, read_intrinsics)
    yield Target("depth-png", _write_depth, _read_depth, mutated_png)
    yield Target("depth-npy", _write_depth_array, _read_depth)
    if importlib.util.find_spec("rosbags") is not None:
        yield Target("bag-1", _bag_writer("run.bag"), _read_bag)
        yield Target("bag-mcap", _bag_writer("run.mcap"), _read_bag)
        yield Target("bag-db3", _bag_writer("run.db3"), _read_bag)
        yield Target("bag-folder", _write_bag_folder, lambda path: _read_bag(path.parent))


def _points(count: int = 40) -> np.ndarray:
    return np.random.default_rng(0).normal(size=(count, 3)).round(3)


def _texts() -> dict[str, bytes]:
    rows = [" ".join(map(str, row)) for row in _points(12).tolist()]
    plain = "\n".join(rows)
    colored = "\n".join(f"{row} {10 * index} 20 30" for index, row in enumerate(rows))
    ply = (
        "ply\nformat ascii 1.0\ncomment made by hand\nelement vertex 12\nproperty float x\nproperty float y\n"
        "property double z\nproperty uchar red\nproperty uchar green\nproperty uchar blue\nelement face 1\n"
        f"property list uchar int vertex_indices\nend_header\n{colored}\n3 0 1 2\n"
    )
    pcd = (
        "# .PCD v0.7\nVERSION 0.7\nFIELDS x y z label\nSIZE 4 4 4 2\nTYPE F F F I\nCOUNT 1 1 1 1\nWIDTH 12\nHEIGHT 1\n"
        "VIEWPOINT 0 0 0 1 0 0 0\nPOINTS 12\nDATA "
    )
    binary = np.zeros(12, [("xyz", "<f4", 3), ("label", "<i2")])
    binary["xyz"] = _points(12)
    columns = b"".join(np.ascontiguousarray(column, "<f4").tobytes() for column in _points(12).T) + bytes(24)
    # Literal runs alone, which any LZF data may be.
    runs = [columns[start : start + 32] for start in range(0, len(columns), 32)]
    packed = b"".join(bytes([len(run) - 1]) + run for run in runs)
    sizes = np.array([len(packed), len(columns)], "<u4").tobytes()
    labelled = "\n".join(f"{row} {index}" for index, row in enumerate(rows))
    return {
        "ply-ascii.ply": ply.encode(),
        "pcd-ascii.pcd": f"{pcd}ascii\n{labelled}\n".encode(),
        "pcd-binary.pcd": f"{pcd}binary\n".encode() + binary.tobytes(),
        "pcd-compressed.pcd": f"{pcd}binary_compressed\n".encode() + sizes + packed,
        "xyz.xyz": f"# comment\n{plain}\n".encode(),
        "csv.csv": b"x,y,z,intensity\n" + "\n".join(f"{row} 7".replace(" ", ",") for row in rows).encode(),
        "asc.asc": b"//X;Y;Z;Intensity\n" + "\n".join(f"{row} 7;".replace(" ", ";") for row in rows).encode(),
        "pts.pts": f"12\n{colored}\n".encode(),
    }


def _bytes_writer(name: str, content: bytes) -> Callable[[Path], list[str]]:
    def write(folder: Path) -> list[str]:
        (folder / name).write_bytes(content)
        return [name]

    return write


def _write_ply(folder: Path) -> list[str]:
    points = _points(20)
    write_ply(folder / "little.ply", points, colors=np.zeros((20, 3), np.uint8), fields={"label": np.arange(20)})
    header = (
        b"ply\nformat binary_big_endian 1.0\nelement camera 2\nproperty short pan\nelement vertex 20\n"
        b"property double x\nproperty double y\nproperty double z\nelement face 2\n"
        b"property list uchar int vertex_indices\nend_header\n"
    )
    faces = (b"\x03" + np.arange(3, dtype=">i4").tobytes()) * 2
    (folder / "big.ply").write_bytes(header + bytes(4) + points.astype(">f8").tobytes() + faces)
    return ["little.ply", "big.ply"]


def _frame(time: float = 1_600_000_000.0) -> Frame:
    depth = np.random.default_rng(0).uniform(1, 3, (CAMERA.height, CAMERA.width, 1))
    return Frame.of_image(CAMERA.rays().reshape(CAMERA.height, CAMERA.width, 3) * depth, time, "camera")


def _write_organised(folder: Path) -> list[str]:
    write_pcd(folder / "frame.pcd", _frame().image(), viewpoint=viewpoint_of(np.eye(4)))
    return ["frame.pcd"]


def _npy_writer(folder: Path) -> list[str]:
    np.save(folder / "a.npy", _points())
    np.save(folder / "ordered.npy", _points(12).reshape(3, 4, 3).astype(np.float32))
    return ["a.npy", "ordered.npy"]


def _npz_writer(folder: Path) -> list[str]:
    colors = np.zeros((40, 3), np.uint8)
    np.savez_compressed(folder / "a.npz", points=_points(), colors=colors, label=np.arange(40), pose=np.eye(4))
    return ["a.npz"]


def _las_writer(ending: str) -> Callable[[Path], list[str]]:
    def write(folder: Path) -> list[str]:
        import laspy

        names = []
        for point_format, version in ((3, "1.2"), (0, "1.2"), (7, "1.4")):
            data = laspy.LasData(laspy.LasHeader(point_format=point_format, version=version))
            data.x, data.y, data.z = _points(60).T
            data.intensity = np.arange(60)
            names.append(f"format-{point_format}.{ending}")
            data.write(str(folder / names[-1]))
        return names

    return write


def _write_full_las(folder: Path) -> list[str]:
    extra = extra_descriptor(b"amplitude", 9) + extra_descriptor(b"label", 6)
    keys = (vlr(b"LASF_Projection", 34735, GEOTIFF),)
    for minor, point_format in ((2, 3), (4, 7)):
        behind = (evlr(b"LASF_Projection", 2112, WKT.encode()),) if minor == 4 else ()
        content = las_bytes(minor, point_format, extra=extra, extra_size=8, vlrs=keys, evlrs=behind)
        (folder / f"full-{minor}.las").write_bytes(content)
    return ["full-2.las", "full-4.las"]


def _write_e57(folder: Path) -> list[str]:
    import pye57

    columns = dict(zip(("cartesianX", "cartesianY", "cartesianZ"), _points(60).T, strict=True))
    file = pye57.E57(str(folder / "a.e57"), mode="w")
    file.write_scan_raw({**columns, "intensity": np.arange(60, dtype="f")})
    file.close()
    return ["a.e57"]


def _mesh_writer(kind: str) -> Callable[[Path], list[str]]:
    triangle = np.array([[0, 0, 0.5], [1, 0, -0.25], [0, 1, 3]], "<f4")
    buffer = triangle.tobytes() + np.arange(3, dtype="<u2").tobytes() + bytes(2)
    scene = {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}],
        "buffers": [{"byteLength": len(buffer)}],
        "bufferViews": [{"buffer": 0, "byteLength": 36}, {"buffer": 0, "byteOffset": 36, "byteLength": 6}],
        "accessors": [
            {
                "bufferView": 0,
                "componentType": 5126,
                "count": 3,
                "type": "VEC3",
                "min": [0, 0, -0.25],
                "max": [1, 1, 3],
            },
            {"bufferView": 1, "componentType": 5123, "count": 3, "type": "SCALAR"},
        ],
    }
    text = json.dumps(scene).encode()
    text += b" " * (-len(text) % 4)
    glb = len(text).to_bytes(4, "little") + b"JSON" + text + len(buffer).to_bytes(4, "little") + b"BIN\0" + buffer
    facet = bytes(12) + triangle.tobytes() + bytes(2)
    contents = {
        "obj": {"a.obj": b"o hand\nv 0 0 0.5 1 0 0\nv 1 0 -0.25 0 1 0\nv 0 1 3 0 0 1\nvn 0 0 1\nf 1//1 2//1 3//1\n"},
        "off": {
            "a.off": b"OFF\n3 1 0\n0 0 0.5\n1 0 -0.25\n0 1 3\n3 0 1 2\n",
            "c.off": b"COFF\n3 1 0\n0 0 0.5 255 0 0 255\n1 0 -0.25 0 9 0 255\n0 1 3 0 0 9 255\n3 0 1 2\n",
        },
        "stl": {
            "a.stl": b"solid hand\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0.5\nvertex 1 0 -0.25\nvertex 0 1 3\n"
            b"endloop\nendfacet\nendsolid hand\n",
            "b.stl": bytes(80) + (2).to_bytes(4, "little") + facet * 2,
        },
        "gltf": {"a.gltf": text.replace(b'"buffers": [{', b'"buffers": [{"uri": "a.bin", ')},
        "glb": {"a.glb": b"glTF" + (2).to_bytes(4, "little") + (12 + len(glb)).to_bytes(4, "little") + glb},
    }

    def write(folder: Path) -> list[str]:
        (folder / "a.bin").write_bytes(buffer)
        for name, content in contents[kind].items():
            (folder / name).write_bytes(content)
        return list(contents[kind])

    return write


def _read_cloud(path: Path) -> PointCloud:
    return _checked(read_cloud(path))


def _read_las(path: Path) -> PointCloud:
    with mock.patch.object(las, "DecoderProcess", lambda: KEPT):
        return _checked(read_cloud(path))


def _rewrite_las(path: Path) -> PointCloud:
    cloud = _read_las(path)
    assert cloud.file is not None
    labels = {"label": np.zeros(len(cloud), np.int32)}
    with warnings.catch_warnings(action="ignore", category=InputWarning):
        write_las(path.with_suffix(".out"), LasSource.of(cloud.file), cloud, labels, {"label": "of a change"})
    return cloud


def _read_e57(path: Path) -> PointCloud:
    with mock.patch.object(e57, "DecoderProcess", lambda: KEPT):
        return _checked(read_cloud(path))


def _read_mesh(path: Path) -> PointCloud:
    with mock.patch.object(mesh, "DecoderProcess", lambda: KEPT):
        return _checked(read_cloud(path))


def _checked(cloud: PointCloud) -> PointCloud:
    assert cloud.points.dtype == np.float64 and np.isfinite(cloud.points).all()
    assert all(len(values) == len(cloud) for values in cloud.fields.values())
    return cloud


def _views_writer(name: str) -> Callable[[Path], list[str]]:
    def write(folder: Path) -> list[str]:
        write_views(folder / name, SensorViews(np.tile(np.eye(4), (2, 1, 1)), (62.0, 48.0), 4.0))
        return [name]

    return write


def _write_config(folder: Path) -> list[str]:
    (folder / "config.toml").write_text(
        'method = "joint"\nkinds = "both"\nrestarts = 4\nseed = 3\ncrop = [0, 0, 0, 1.5, 1, 1]\nregistration = "auto"\n'
        "tolerance = 0.01\nevidence = true\nmax_points = 1000\nconcentration = -4.5\nnoise_share = 0.01\n"
        "threshold = 0.5\ncovariance_scale = 0.1\ndegrees_of_freedom = 8\n"
    )
    return ["config.toml"]


def _result_writer(name: str) -> Callable[[Path], list[str]]:
    def write(folder: Path) -> list[str]:
        box, motion = Box(np.arange(3.0), np.ones(3), np.eye(3)), np.eye(4)
        appeared = Change("moved", 0.75, 6.5, 9, np.arange(3.0), np.eye(3), box, partner=1, transform=motion)
        gone = Change("moved", 0.5, 3.5, 4, np.arange(3.0), np.eye(3), box, partner=0, transform=motion)
        appeared = dataclasses.replace(appeared, explanation=explanation())
        labels = np.r_[np.full(6, -1), np.zeros(9, int), np.ones(5, int)]
        unseen = np.arange(20) < 4
        config = DetectionConfig(seed=3, tolerance=0.01)
        shares = np.linspace(0, 1, 20)
        changes = Changes(
            labels, labels, shares, shares, unseen, unseen, (appeared, gone), 0.25, config, {"voxel_size": None}
        )
        dataclasses.replace(changes, rejected=(rejected(),)).save(folder)
        return [name]

    return write


def _read_changes(path: Path) -> Changes:
    changes = Changes.load(path.parent)
    json.dumps(changes.to_dict(), allow_nan=False)
    return changes


def _write_mixture(folder: Path) -> list[str]:
    content = {
        "schema_version": 1,
        "components": 2,
        "weights": [0.25, 0.75],
        "means": [[0, 0, 0], [1.5, 2, 3]],
        "covariances": [np.eye(3).tolist(), np.diag([1, 2, 3.5]).tolist()],
        "status": "converged",
    }
    (folder / "mixture.json").write_text(json.dumps(content, indent=2))
    return ["mixture.json"]


def _write_pair(folder: Path) -> list[str]:
    for side in ("before", "after"):
        write_ply(folder / f"{side}.ply", _points())
        np.save(folder / f"truth_{side}.npy", np.full(40, -1))
        np.save(folder / f"unseen_{side}.npy", np.zeros(40, bool))
        np.save(folder / f"not_counted_{side}.npy", np.arange(3))
    return ["after.ply", "truth_after.npy", "unseen_after.npy", "not_counted_after.npy"]


def _write_state(folder: Path) -> list[str]:
    ones = np.ones((2, 1))
    state = TuningState(ones, (ones, ones), np.ones(2, bool), np.ones((4, 2, 1)), np.ones((4, 2, 3)), np.ones(3))
    write_state(folder / "state.npz", state, "these")
    return ["state.npz"]


def _write_intrinsics(folder: Path) -> list[str]:
    write_intrinsics(folder / "a.json", CAMERA)
    matrix = {"width": 8, "height": 6, "intrinsic_matrix": CAMERA.matrix().T.reshape(-1).tolist()}
    (folder / "open3d.json").write_text(json.dumps({"intrinsic": matrix}))
    (folder / "ros.yaml").write_text(
        "image_width: 8\nimage_height: 6\ncamera_name: front\ncamera_matrix:\n  rows: 3\n  cols: 3\n"
        "  data: [8.0, 0.0, 3.5, 0.0, 8.0, 2.5, 0.0, 0.0, 1.0]\ndistortion_model: plumb_bob\n"
        "distortion_coefficients:\n  rows: 1\n  cols: 5\n  data: [0.1, 0, 0, 0, 0]\n"
    )
    (folder / "message.yaml").write_text(
        "header:\n  stamp:\n    secs: 1\nheight: 6\nwidth: 8\nD:\n- 0.0\n- 0.0\nK:\n"
        + "".join(f"- {number}\n" for number in CAMERA.matrix().reshape(-1))
        + "roi:\n  height: 0\n  width: 0\n"
    )
    return ["a.json", "open3d.json", "ros.yaml", "message.yaml"]


def _write_depth(folder: Path) -> list[str]:
    write_depth_image(folder / "depth.png", _frame())
    return ["depth.png"]


def _write_depth_array(folder: Path) -> list[str]:
    np.save(folder / "depth.npy", _frame().depth_image())
    return ["depth.npy"]


def _read_depth(path: Path) -> Frame:
    frame = read_depth_frame(path, CAMERA)
    _checked(frame.cloud)
    return frame


def _bag_writer(name: str) -> Callable[[Path], list[str]]:
    def write(folder: Path) -> list[str]:
        _write_bag(folder / name)
        return [name]

    return write


def _write_bag(path: Path) -> None:
    from tests.surveys.recordings import START, frame, trajectory

    write_bag(path, [frame(START + 0.2 * number, seed=number) for number in range(3)], trajectory(length=0.5))


def _write_bag_folder(folder: Path) -> list[str]:
    _write_bag(folder / "run")
    names = [path.name for path in (folder / "run").iterdir()]
    for name in names:
        shutil.move(folder / "run" / name, folder / name)
    (folder / "run").rmdir()
    return ["metadata.yaml", "metadata.yaml", next(name for name in names if name.endswith(".mcap"))]


def _read_bag(path: Path) -> int:
    """Reads all that commands read of a bag; the messages after the first frame that cannot be read are left."""
    with open_bag(path) as bag:
        topics = bag.topics()
        clouds = bag.cloud_topic()
        found = 0
        for frame in bag.frames(clouds):
            _checked(frame.cloud)
            found += 1
        first = next(bag.frames(clouds), None)
        if first is not None:
            bag.frame_at(clouds, first.time)
        for topic in topics:
            if topic.type == "nav_msgs/msg/Odometry":
                bag.trajectory(topic.name)
        tree = bag.transforms()
        for child in tree.frames:
            # A frame need not move, nor hang on the tree.
            with contextlib.suppress(InputError):
                tree.trajectory(tree.root_of(child), child, 0.5)
    return found
