"""Volumetric reconstructed maps: the surface in a truncated signed distance field of many frames (thesis 3.1.4)."""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from jaxtyping import Bool, Float64

from gmmjax.clouds import load_open3d
from gmmjax.errors import InputError
from gmmjax.surveys.frame import Frame
from gmmjax.surveys.placed_frames import FrameMap, PlacedFrames, Sight, cropped
from gmmjax.surveys.trajectory import MAX_GAP, Trajectory

# Distances are kept up to this number of voxels from the surface, and at least up to this length (metres): beyond a
# sensor's noise and an error of the poses, but less than half the thickness of most things, whose two sides would meet.
TRUNCATION_VOXELS, MIN_TRUNCATION = 4.0, 0.04
# A voxel looks at the pixel that it falls into: each is cut into this number across and down, interpolated.
FINER = 2
# Voxels come in blocks of this number along each side; the second number has room at first.
BLOCK, FIRST_BLOCKS = 8, 10_000
# Pixels whose depths differ by more than this share are of two surfaces, with nothing between them.
JUMP = 0.03
# A pixel stands alone when fewer of the eight around it are of the same surface; a line of pixels has two.
MIN_ALIKE = 2


@dataclass(frozen=True, eq=False)
class VolumetricMap(FrameMap):
    """The surface of what the frames saw.

    Attributes:
        normals: of the surface at each point, unit length, towards where it was seen from.
    """

    normals: Float64[np.ndarray, "n 3"]


def volumetric_map(
    frames: Iterable[Frame],
    trajectory: Trajectory,
    *,
    voxel_size: float = 0.01,
    bounds: npt.ArrayLike | None = None,
    max_range: float | None = None,
    max_gap: float = MAX_GAP,
) -> VolumetricMap:
    """The surface that the frames saw, averaged in voxels (Curless and Levoy 1996), with Open3D on the CPU.

    Pixels that stand alone, as they fall between two surfaces at an edge, are left out. Each frame updates the signed
    distances within 4 voxels of what it saw (4 cm where the voxels are smaller). The frames are taken one after the
    other; what is held grows with the surface, not with their number. The points are the vertices of a triangle mesh.

    Where poses are off, refine them first: the map of `Trajectory.of_samples(fine.times, fine.poses)` with `fine =
    localised_map(frames, trajectory, refine=True)`.

    Args:
        frames: ordered, of a pinhole camera, in its coordinates.
        trajectory: of the camera, as from `Trajectory.of_sensor`.
        voxel_size: metres.
        bounds: lowest and highest corner [2, 3] of the box that the map is cropped to, metres in the world.
        max_range: of the camera, metres; points beyond are left out. None: just beyond the farthest point.
        max_gap: a frame between two poses further apart than this (seconds) is left out.

    Raises:
        InputError: Open3D cannot be loaded, a frame is in no order or of no pinhole camera, none is covered by the
            trajectory, or nothing was seen in bounds and in range.
    """
    if not 0 < voxel_size < np.inf:
        raise InputError(f"voxel_size={voxel_size} must be positive, in metres; 0.01 (1 cm) is usual")
    cropped(np.zeros((0, 3)), bounds)
    open3d = load_open3d("a volumetric map")
    placed, sight = PlacedFrames(frames, trajectory, max_gap=max_gap), Sight(max_range)
    with open3d.utility.VerbosityContextManager(open3d.utility.VerbosityLevel.Error):
        volume = _Volume(open3d, voxel_size)
        volume.integrate_frames(placed, sight)
        points, normals = volume.surface()
    inside = cropped(points, bounds)
    if not inside.any():
        raise InputError(
            f"no surface in the bounds and in range was seen by any of the {len(placed.times)} frames used; check both"
        )
    times, poses = np.array(placed.times), np.stack(placed.poses)
    return VolumetricMap(points[inside], times, poses, sight.views(poses), placed.skipped, normals[inside])


class _Volume:
    """Open3D's grid of voxel blocks, with a signed distance and a weight in each voxel."""

    def __init__(self, open3d: Any, voxel_size: float) -> None:
        self._open3d = open3d
        number = open3d.core.float32
        self._grid = open3d.t.geometry.VoxelBlockGrid(
            ("tsdf", "weight"), (number, number), ((1), (1)), voxel_size, BLOCK, FIRST_BLOCKS
        )
        self._empty = True
        self._truncation = max(TRUNCATION_VOXELS, MIN_TRUNCATION / voxel_size)

    def integrate_frames(self, placed: PlacedFrames, sight: Sight) -> None:
        """Add the frames, without the pixels that are out of sight and those that stand alone."""
        for frame, pose in placed:
            depth = frame.depth_image()
            depth.flat[frame.cloud.rows[~sight.of(frame)]] = np.nan
            depth[lone_pixels(depth)] = np.nan
            self.integrate(depth, frame.intrinsics().matrix(), pose)

    def integrate(
        self, depth: Float64[np.ndarray, "h w"], camera: Float64[np.ndarray, "3 3"], pose: Float64[np.ndarray, "4 4"]
    ) -> None:
        """Add one depth image (metres, NaN where there is no return)."""
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

    def surface(self) -> tuple[Float64[np.ndarray, "n 3"], Float64[np.ndarray, "n 3"]]:
        """Points and normals where the signed distance changes its sign."""
        if self._empty:
            return np.zeros((0, 3)), np.zeros((0, 3))
        # A frame adds 1 to the weight, and the weight must be above the threshold.
        try:
            attributes = self._grid.extract_triangle_mesh(0.5).vertex
        # Where no voxel has enough weight.
        except RuntimeError:
            return np.zeros((0, 3)), np.zeros((0, 3))
        positions, normals = (attributes[name].numpy().astype(np.float64) for name in ("positions", "normals"))
        # Open3D's order is that in which its threads came.
        order = np.lexsort(positions.T)
        return positions[order], normals[order]


def lone_pixels(depth: Float64[np.ndarray, "h w"]) -> Bool[np.ndarray, "h w"]:
    """The pixels with a return that are of no surface, such as those that fall between two at an edge.

    Args:
        depth: metres, NaN where there is no return.
    """
    height, width = depth.shape
    padded = np.pad(depth, 1, constant_values=np.nan)
    alike = np.zeros(depth.shape, int)
    for row, column in [(row, column) for row in range(3) for column in range(3) if (row, column) != (1, 1)]:
        beside = padded[row : row + height, column : column + width]
        alike += np.abs(beside - depth) <= JUMP * depth
    return np.isfinite(depth) & (alike < MIN_ALIKE)


def interpolated(depth: Float64[np.ndarray, "h w"], factor: int) -> Float64[np.ndarray, "fine_h fine_w"]:
    """The image with each pixel cut into smaller ones, interpolated where the four pixels around see one surface.

    Inverse depths are interpolated, in which a plane is linear. At jumps of the depth, and beside pixels without a
    return, the smaller pixels have the depth of their own one.

    Args:
        depth: metres, NaN where there is no return.
        factor: into how many each pixel is cut across and down.
    """
    rows, down = _between(depth.shape[0], factor)
    columns, across = _between(depth.shape[1], factor)
    corners = np.stack([depth[np.ix_(rows + i, columns + j)] for i in (0, 1) for j in (0, 1)])
    weights = np.stack([np.outer(y, x) for y in (1 - down, down) for x in (1 - across, across)])
    between = 1 / (weights / corners).sum(axis=0)
    nearest, farthest = corners.min(axis=0), corners.max(axis=0)
    # Comparisons with NaN are false.
    smooth = farthest - nearest <= JUMP * nearest
    return np.where(smooth, between, depth.repeat(factor, axis=0).repeat(factor, axis=1))


def _between(size: int, factor: int) -> tuple[np.ndarray, np.ndarray]:
    """For each smaller pixel the pixel before its centre, and its share of the way to the next; at the rim beyond."""
    centres = (np.arange(size * factor) + 0.5) / factor - 0.5
    before = np.clip(np.floor(centres).astype(int), 0, max(size - 2, 0))
    return before, centres - before
