"""The coarse pass: both scans thinned to what fits into memory, registered, and the frame of their blocks."""

import dataclasses
import itertools

import numpy as np
from jaxtyping import Float64

from gmmjax.changes import (
    NAMES,
    AlignedScans,
    Clock,
    DetectionConfig,
    JointDetector,
    LocalResolutionSettings,
    Scan,
    VoxelLattice,
    check_same_place,
    stated_systems,
    warn_of_stray_points,
    with_recognised_views,
)
from gmmjax.clouds import (
    AXIS_BITS,
    ChunkedCloud,
    CroppedCloud,
    PointCloud,
    SensorViews,
    ThinnedCloud,
    scan_bounds,
    thinned_cloud,
)
from gmmjax.errors import InputError
from gmmjax.geometry import transformed
from gmmjax.pair import Pair, each
from gmmjax.tiling.detection_settings import TiledDetectionSettings
from gmmjax.tiling.placed_clouds import Lattice, PlacedClouds, read_both
from gmmjax.tiling.point_clouds import source_of

# Edge of the largest voxels where scans are so sparse that all their points are taken here, in spacings. Small: what is
# sparser than most of a scan is compared in voxels of single points.
LARGEST_VOXEL = 2.0


@dataclasses.dataclass(frozen=True, eq=False)
class CoarsePass:
    """Both scans, thinned and registered.

    Attributes:
        detector: by which they are compared.
        clouds: what of both is compared: inside the crop box, without stray points.
        stray: how many points of either are left out.
        thinned: as they were given.
        prepared: registered.
    """

    detector: JointDetector
    clouds: Pair[ChunkedCloud]
    stray: Pair[int]
    thinned: Pair[ThinnedCloud]
    prepared: AlignedScans

    @property
    def transform(self) -> Float64[np.ndarray, "4 4"] | None:
        """Rigid transform of the after cloud into the frame of the before cloud; None: it is in it."""
        registration = self.prepared.pair.registration
        return registration.transform if registration.applied else None

    def finest_level(self, lattice: Lattice) -> int:
        """The finest level whose cells are no smaller than the voxels of the thinned scans: as many fit into memory."""
        return int(np.clip(np.log2(lattice.edge / max(own.size for own in self.thinned)), 0, AXIS_BITS))


def coarse_pass(
    clouds: Pair[ChunkedCloud],
    views: Pair[SensorViews | None],
    config: DetectionConfig,
    clock: Clock,
    settings: TiledDetectionSettings,
) -> CoarsePass:
    """Both scans, thinned and registered.

    Args:
        clouds: of both surveys.
        views: where their sensors stood; None: not known.
        config: of the detection.
        clock: of its progress.
        settings: how many points are kept in memory.

    Raises:
        InputError: a scan without points, scans of two places, scans that fill volumes, or those that the detector
            refuses.
    """
    clock.start("reading", "Reading the scans", 0.0)
    inside = _cropped(clouds, config)
    thinned = read_both(lambda chunks: thinned_cloud(chunks, settings.thinned), inside.map(lambda own: own.chunks()))
    for side, own in zip(NAMES, thinned, strict=True):
        if not own.total:
            raise InputError(f"{side}: has no points{' inside the crop box' * (config.crop is not None)}")
    total = thinned.map(lambda own: own.total)
    both = each(lambda own, first: _without_stray_points(own, first, settings.thinned), inside, thinned)
    inside, thinned = both.map(lambda own: own[0]), both.map(lambda own: own[1])
    stray = each(lambda all_points, own: all_points - own.total, total, thinned)
    for side, count, own, cloud in zip(NAMES, stray, thinned, clouds, strict=True):
        source = source_of(cloud)
        warn_of_stray_points(f"{side} ({source})" if source else side, count, np.array(own.bounds))
    systems = stated_systems(clouds)
    check_same_place(thinned.map(lambda own: own.points), systems)
    # In means of voxels alone there is no density to recognise stations by.
    detector = JointDetector(config, stations=None, resolution=None)
    scans = each(lambda own, known, crs: Scan(_stating(own.points, crs), known), thinned, views, systems)
    if config.recognise_stations:
        scans = each(
            lambda scan, own: with_recognised_views(scan, own.points, settings.stations, own.counts), scans, thinned
        )
    prepared = detector.prepared(scans, clock)
    if prepared.volumetric:
        raise InputError(
            "before, after: the clouds fill volumes, as artificial mixtures do, and are no scans of surfaces; compare "
            "fewer of their points, without tiles"
        )
    return CoarsePass(detector, inside, stray, thinned, prepared)


def _stating(points: Float64[np.ndarray, "n 3"], crs: str | None) -> PointCloud:
    """The cloud in the reference system that its file states: there it is hardly moved."""
    return dataclasses.replace(PointCloud.from_rows(points), crs=crs)


def _cropped(clouds: Pair[ChunkedCloud], config: DetectionConfig) -> Pair[ChunkedCloud]:
    if config.crop is None:
        return clouds
    lower, upper = np.array(config.crop[:3]), np.array(config.crop[3:])
    return clouds.map(lambda own: CroppedCloud(own, lower, upper))


def _without_stray_points(cloud: ChunkedCloud, thinned: ThinnedCloud, most: int) -> tuple[ChunkedCloud, ThinnedCloud]:
    """The cloud without stray points, which is read again where it has any, and thinned to `most` voxels."""
    while (bounds := scan_bounds(thinned.points)) is not None:
        # The points of a voxel are within its size of their mean.
        inside = CroppedCloud(cloud, bounds[0] - thinned.size, bounds[1] + thinned.size)
        fewer = thinned_cloud(inside.chunks(), most)
        if fewer.total == thinned.total:
            break
        cloud, thinned = inside, fewer
    return cloud, thinned


def placed_clouds(coarse: CoarsePass, resolution: LocalResolutionSettings) -> tuple[PlacedClouds, VoxelLattice]:
    """Both clouds in one frame, and the grids of their voxels, relative to its lattice's offset.

    The lattice of the blocks is of whole cubes whose voxels are halved or not, as far as its cells are larger.

    Args:
        coarse: both scans, registered.
        resolution: how small the voxels are.
    """
    working = coarse.prepared.pair.working
    voxel_size = working.voxel_size or LARGEST_VOXEL * working.spacing
    corners = _corners(coarse)
    lower = corners.min(axis=0) - voxel_size
    extent = float((corners.max(axis=0) - lower).max()) + voxel_size
    cube = resolution.voxels_per_edge * voxel_size
    edge = float(cube * 2.0 ** max(0, np.ceil(np.log2(extent / cube))))
    voxels = VoxelLattice.of(np.zeros(3), edge, voxel_size, resolution.halvings)
    return PlacedClouds(coarse.clouds, Lattice(lower, edge), coarse.transform), voxels


def _corners(coarse: CoarsePass) -> Float64[np.ndarray, "16 3"]:
    """The corners of the boxes of both clouds, in the frame of the before cloud."""
    boxes = coarse.thinned.map(lambda own: np.array(list(itertools.product(*np.array(own.bounds).T))))
    after = boxes.after if coarse.transform is None else transformed(boxes.after, coarse.transform)
    return np.concatenate([boxes.before, after])
