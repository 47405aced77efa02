"""Volumetric reconstructed maps: the surface in a truncated signed distance field of many frames (thesis 3.1.4)."""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any, Literal, get_args

import numpy as np
import numpy.typing as npt
from jaxtyping import Float64

from gmmjax.clouds import SensorViews, load_open3d
from gmmjax.errors import InputError, check_choice
from gmmjax.surveys.depth_pixels import interpolated, lone_pixels
from gmmjax.surveys.frame import Frame
from gmmjax.surveys.placed_frames import PlacedFrames, Sight, cropped
from gmmjax.surveys.trajectory import MAX_GAP, Trajectory

Surface = Literal["vertices", "points"]

# Distances are kept up to this number of voxels from the surface, and at least up to this length (metres): beyond a
# sensor's noise and an error of the poses, but less than half the thickness of most things, whose two sides would meet.
TRUNCATION_VOXELS, LEAST_TRUNCATION = 4.0, 0.04
# A voxel looks at the pixel that it falls into: each is cut into this number across and down, interpolated.
FINER = 2
# Voxels come in blocks of this number along each side; the second number has room at first.
BLOCK, FIRST_BLOCKS = 8, 10_000


@dataclass(frozen=True, eq=False)
class VolumetricMap:
    """The surface of what the frames saw.

    Attributes:
        points: on the surface, metres in the world.
        normals: of the surface at each, unit length, towards where it was seen from.
        times: of the frames used, seconds.
        poses: of the sensor at these times, sensor to world.
        views: where the sensor stood and what it could see.
        frames_used: how many frames the map is made of.
        frames_skipped: how many it could not be made of: without points, or not covered by the trajectory.
    """

    points: Float64[np.ndarray, "n 3"]
    normals: Float64[np.ndarray, "n 3"]
    times: Float64[np.ndarray, " v"]
    poses: Float64[np.ndarray, "v 4 4"]
    views: SensorViews
    frames_used: int
    frames_skipped: int


def volumetric_map(
    frames: Iterable[Frame],
    trajectory: Trajectory,
    *,
    voxel_size: float = 0.01,
    every: int = 1,
    bounds: npt.ArrayLike | None = None,
    max_range: float | None = None,
    max_gap: float = MAX_GAP,
    surface: Surface = "vertices",
    least_frames: int = 1,
) -> VolumetricMap:
    """The surface that every n-th frame saw, averaged in voxels (Curless and Levoy 1996), with Open3D on the CPU.

    Pixels that stand alone, as they fall between two surfaces at an edge, are left out. Each frame updates the signed
    distances within 4 voxels of what it saw (4 cm where the voxels are smaller). The frames are taken one after the
    other; what is held grows with the surface, not with their number.

    Where poses are off, refine them first: the map of `Trajectory.of_samples(fine.times, fine.poses)` with `fine =
    localised_map(frames, trajectory, refine=True)`.

    Args:
        frames: ordered, of a pinhole camera, in its coordinates.
        trajectory: of the camera, as from `Trajectory.of_sensor`.
        voxel_size: metres.
        every: use one frame of this number.
        bounds: lowest and highest corner [2, 3] of the box that the map is cropped to, metres in the world.
        max_range: of the camera, metres; points beyond are left out. None: just beyond the farthest point.
        max_gap: a frame between two poses further apart than this (seconds) is left out.
        surface: "vertices" of a triangle mesh, or "points" where the edges of the voxels meet the surface.
        least_frames: how many frames a surface must have been seen by. More than 1 leaves out more noise, but surfaces
            too that are there: the views seem to look through them then.

    Raises:
        InputError: Open3D cannot be loaded, a frame is in no order or of no pinhole camera, none is covered by the
            trajectory, or nothing was seen by enough of them in bounds and in range.
    """
    _check(surface, voxel_size, least_frames, bounds)
    open3d = load_open3d("a volumetric map")
    placed, sight = PlacedFrames(frames, trajectory, every=every, max_gap=max_gap), Sight(None, max_range)
    with open3d.utility.VerbosityContextManager(open3d.utility.VerbosityLevel.Error):
        volume = _Volume(open3d, voxel_size)
        volume.integrate_frames(placed, sight)
        points, normals = volume.surface(surface, least_frames)
    inside = cropped(points, bounds)
    if not inside.any():
        raise InputError(
            f"no surface in the bounds and in range was seen by {least_frames} of the {len(placed.times)} frames used; "
            "check both, use more frames, or give a lower least_frames"
        )
    poses = np.stack(placed.poses)
    return VolumetricMap(
        points=points[inside],
        normals=normals[inside],
        times=np.array(placed.times),
        poses=poses,
        views=sight.views(poses),
        frames_used=len(poses),
        frames_skipped=placed.skipped,
    )


def _check(surface: str, voxel_size: float, least_frames: int, bounds: npt.ArrayLike | None) -> None:
    """What can be wrong before a frame is read."""
    check_choice("surface", surface, get_args(Surface))
    if not 0 < voxel_size < np.inf:
        raise InputError(f"voxel_size={voxel_size} must be positive, in metres; 0.01 (1 cm) is usual")
    if least_frames < 1:
        raise InputError(f"least_frames={least_frames} must be at least 1")
    cropped(np.zeros((0, 3)), bounds)


class _Volume:
    """Open3D's grid of voxel blocks, with a signed distance and a weight in each voxel."""

    def __init__(self, open3d: Any, voxel_size: float) -> None:
        self._open3d = open3d
        number = open3d.core.float32
        self._grid = open3d.t.geometry.VoxelBlockGrid(
            ("tsdf", "weight"), (number, number), ((1), (1)), voxel_size, BLOCK, FIRST_BLOCKS
        )
        self._empty = True
        self._truncation = max(TRUNCATION_VOXELS, LEAST_TRUNCATION / voxel_size)

    def integrate_frames(self, placed: PlacedFrames, sight: Sight) -> None:
        """Adds the frames, without the pixels that are out of sight and those that stand alone."""
        for frame, pose in placed:
            depth = frame.depth_image()
            depth.flat[frame.cloud.rows[~sight.of(frame)]] = np.nan
            depth[lone_pixels(depth)] = np.nan
            self.integrate(depth, frame.intrinsics().matrix(), pose)

    def integrate(
        self, depth: Float64[np.ndarray, "h w"], camera: Float64[np.ndarray, "3 3"], pose: Float64[np.ndarray, "4 4"]
    ) -> None:
        """Adds one depth image (metres, NaN where there is no return)."""
        if np.isnan(depth).all():
            return
        numbers = np.nan_to_num(interpolated(depth, FINER), nan=0.0).astype(np.float32)
        tensor = self._open3d.core.Tensor
        image = self._open3d.t.geometry.Image(tensor(numbers))
        # Open3D rounds pixels down: its pixel 0 goes from 0 to 1, ours from -0.5 to 0.5.
        corner = camera + np.array([[0, 0, 0.5], [0, 0, 0.5], [0, 0, 0]])
        intrinsics = tensor(np.diag([FINER, FINER, 1.0]) @ corner)
        extrinsics = tensor(np.linalg.inv(pose))
        scale, farthest = 1.0, 2 * float(numbers.max())
        blocks = self._grid.compute_unique_block_coordinates(
            image, intrinsics, extrinsics, scale, farthest, self._truncation
        )
        self._grid.integrate(blocks, image, intrinsics, extrinsics, scale, farthest, self._truncation)
        self._empty = False

    def surface(
        self, surface: Surface, least_frames: int
    ) -> tuple[Float64[np.ndarray, "n 3"], Float64[np.ndarray, "n 3"]]:
        """Points and normals where the signed distance changes its sign, between voxels of enough weight."""
        if self._empty:
            return np.zeros((0, 3)), np.zeros((0, 3))
        # A frame adds 1 to the weight, and the weight must be above the threshold.
        threshold = least_frames - 0.5
        try:
            if surface == "vertices":
                attributes = self._grid.extract_triangle_mesh(threshold).vertex
            else:
                attributes = self._grid.extract_point_cloud(threshold).point
        # Where no voxel has enough weight.
        except RuntimeError:
            return np.zeros((0, 3)), np.zeros((0, 3))
        positions, normals = (attributes[name].numpy().astype(np.float64) for name in ("positions", "normals"))
        # Open3D's order is that in which its threads came.
        order = np.lexsort(positions.T)
        return positions[order], normals[order]
