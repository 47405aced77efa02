import numpy as np
import pytest

from gmmjax import DetectionConfig
from gmmjax.changes import ResolutionSettings, Scan
from gmmjax.changes.detectors.joint import JointDetector
from gmmjax.changes.evidence.scan_visibility import FreeSpaceSettings, ScanVisibility
from gmmjax.changes.evidence.view_checks import ViewCheckSettings, check_views, usable_views
from gmmjax.changes.progress import Clock, silent
from gmmjax.clouds import SensorViews, read_cloud, read_views, voxel_grid
from gmmjax.errors import InputError, InputWarning
from gmmjax.pair import Pair
from gmmjax.scenes.ray_casting import Solid, cast
from tests.changes.rooms import around, box, scanned

VIEWS = around(8)
STAND = np.array([0.0, 0.1, 1.0])


@pytest.fixture(scope="module")
def cloud():
    furniture = [box((0.3, 0.2, 0), (0.4, 0.3, 0.4)), box((-0.5, -0.3, 0), (0.3, 0.3, 0.6))]
    return scanned(VIEWS, furniture, noise=0.005, voxel=0.015)


def with_poses(poses, max_range=4.0):
    return SensorViews(poses, VIEWS.field_of_view, max_range)


def contradiction(name, views, points):
    return check_views(name, ScanVisibility.of(points, views))


def test_right_views_pass(cloud):
    assert contradiction("views_before", VIEWS, cloud) is None
    assert contradiction("views_before", with_poses(VIEWS.poses[::2]), cloud) is None
    single = with_poses(VIEWS.poses[:1])
    assert contradiction("views_before", single, scanned(single, noise=0.005)) is None


@pytest.mark.slow
def test_right_views_of_real_frames_pass(scan_pairs):
    for folder in scan_pairs:
        points = read_cloud(folder / "before.ply").points
        if (points[:, 2] > 0).all():
            assert contradiction("views_before", SensorViews.at_origin(points), points) is None


def test_a_turning_scanner_passes(cloud):
    points = scanned(around(12, height=0.75, radius=0.01, target=(0, 0, 0.7)), noise=0.003, voxel=0.02)
    pose = np.eye(4)
    pose[:3, 3] = [0, 0, 0.75]
    assert contradiction("views_after", SensorViews(pose[None], (360.0, 179.0), 5.0), points) is None


def shifted(x, y, z):
    poses = VIEWS.poses.copy()
    poses[:, :3, 3] += [x, y, z]
    return poses


@pytest.mark.parametrize(
    "poses", [shifted(50, 0, 0), VIEWS.poses @ np.diag([-1.0, 1, -1, 1]), shifted(1000, 1000, 1300)]
)
def test_views_that_see_nothing(cloud, poses):
    with pytest.raises(InputError, match="views_after: none of the 8 view"):
        contradiction("views_after", with_poses(poses, max_range=0.9), cloud)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("poses", "max_range", "reason"),
    [
        (VIEWS.poses, 1.2, "further than max_range=1.2"),
        (shifted(0, 0, 2.7), 4.0, "further than max_range=4"),
        (np.linalg.inv(VIEWS.poses), 5.0, "behind or beside"),
        (VIEWS.poses[:1], 4.0, "behind or beside"),
        (shifted(0.9, 0, 0), 4.0, "behind or beside"),
    ],
)
def test_contradictions(cloud, poses, max_range, reason):
    message = contradiction("views_before", with_poses(poses, max_range), cloud)
    assert message is not None
    assert message.startswith("views_before: ")
    assert "not used as evidence" in message
    assert reason in message


@pytest.mark.slow
def test_points_that_the_views_cannot_have_seen(cloud):
    """From outside the room everything is in the field of view, and most of it behind a wall."""
    views = SensorViews(shifted(2.2, 0, -0.3), (140.0, 140.0), 6.0)
    assert "hidden by others" in contradiction("views_after", views, cloud)


def test_views_that_contradict_are_left_out_with_a_warning(cloud):
    settings = FreeSpaceSettings(outlier_distance=3.0)
    survey = ScanVisibility.of(cloud, with_poses(VIEWS.poses[:1]), settings)
    with pytest.warns(InputWarning, match="views_before: .* behind or beside"):
        left = usable_views("views_before", survey)
    assert left.views is None and left.surface is survey.surface and left.settings is settings
    assert usable_views("views_before", survey, ViewCheckSettings(max_outside=1.0, max_occluded=1.0)) is survey
    assert usable_views("views_before", left) is left
    # What nobody has given is no mistake of anybody.
    assert usable_views("views_before", survey, quiet=True).views is None


def block(centre, size):
    return Solid(np.array(centre, float), np.array(size, float))


def turning(step, lowest, highest):
    """Azimuths and elevations, radians, and directions of the rays of a turning scanner; the step in degrees."""
    grids = np.meshgrid(np.arange(0, 360, step), np.arange(lowest, highest, step))
    azimuth, elevation = (np.radians(grid.ravel()) for grid in grids)
    across = np.cos(elevation)
    return azimuth, elevation, np.stack([across * np.cos(azimuth), across * np.sin(azimuth), np.sin(elevation)], axis=1)


@pytest.fixture(scope="module")
def scan():
    """A turning scanner's scan of a furnished flat, and of its own stand: a screen 15 cm from its axis.

    What is behind the screen was seen as well, as the mirror turns beside that axis.
    """
    walls = [block((0, side * 2.1, 1), (6.2, 0.2, 2.4)) for side in (-1, 1)]
    walls += [block((side * 3.1, 0, 1), (0.2, 4.2, 2.4)) for side in (-1, 1)]
    room = [block((0, 0, -0.1), (6.4, 4.4, 0.2)), *walls, block((1.2, 1.2, 1), (0.1, 1.6, 2.4))]
    furniture = [
        ((-1.2, -0.9, 0.6), (0.5, 0.4, 1.2)),
        ((1.0, -0.8, 0.7), (0.4, 0.6, 1.4)),
        ((-0.9, 1, 0.6), (0.7, 0.4, 1.2)),
    ]
    solids = room + [block(*one) for one in furniture]
    azimuth, elevation, rays = turning(1.5, -60, 40)
    generator = np.random.default_rng(0)
    ranges, _ = cast(solids, STAND, rays)
    ranges += 0.004 * generator.normal(size=len(ranges))
    met = ranges < 8
    screen = (azimuth < 2.2) & (np.abs(elevation) < 0.7)
    return STAND + np.concatenate([rays[met] * ranges[met, None], 0.15 * rays[screen]])


def scanner(x=0.0, y=0.0, reach=9.0):
    """A turning scanner at the middle of the room, or beside it."""
    pose = np.eye(4)
    pose[:3, :3] = [[1, 0, 0], [0, 0, 1], [0, -1, 0]]
    pose[:3, 3] = STAND + np.array([x, y, 0])
    return SensorViews(pose[None], (360.0, 170.0), reach)


def test_a_scanner_that_sees_its_own_stand_passes(scan):
    assert contradiction("views_before", scanner(), scan) is None
    strict = ViewCheckSettings(max_hidden=0.0, covered_bins=1)
    assert "hidden by others" in check_views("views_before", ScanVisibility.of(scan, scanner()), strict)


@pytest.fixture(scope="module")
def scan_through_racks():
    """A scan of a store, most of whose walls are seen through the gaps between the goods in two racks."""
    walls = [block((0, side * 6.1, 1.5), (12.4, 0.2, 3)) for side in (-1, 1)]
    walls += [block((side * 6.1, 0, 1.5), (0.2, 12.4, 3)) for side in (-1, 1)]
    goods = [
        block((across, side * 2.5, 0.2 + 0.5 * level), (0.4, 0.8, 0.3))
        for side in (-1, 1)
        for across in np.arange(-4.4, 4.5, 0.8)
        for level in range(6)
    ]
    solids = [block((0, 0, -0.1), (12.4, 12.4, 0.2)), *walls, *goods]
    _, _, rays = turning(0.4, -50, 30)
    ranges, _ = cast(solids, STAND, rays)
    met = ranges < 12
    return STAND + rays[met] * ranges[met, None]


@pytest.mark.slow
def test_what_is_seen_through_gaps_is_not_hidden(scan_through_racks):
    """It seems to be in voxels that are nearly as large as the gaps, and where one bin in front is enough."""
    voxels = ScanVisibility.of(voxel_grid(scan_through_racks, 0.16).points, scanner())
    assert check_views("views_before", voxels, points=scan_through_racks) is None
    assert "hidden by others" in check_views("views_before", voxels)
    edges = ViewCheckSettings(covered_bins=1)
    assert "hidden by others" in check_views("views_before", voxels, edges, scan_through_racks)


@pytest.mark.slow
def test_detection_looks_through_the_gaps_of_scans_in_voxels(scan_through_racks):
    generator = np.random.default_rng(0)
    scan = Scan(scan_through_racks + generator.normal(0, 0.003, scan_through_racks.shape), scanner(reach=12.0))
    detector = JointDetector(DetectionConfig(), common_resolution=ResolutionSettings(voxels=10_000))
    prepared = detector.prepared(Pair(scan, scan), Clock(silent))
    assert all(survey.views is not None for survey in prepared.surveys)


@pytest.mark.parametrize("place", [(0.0, 4.2), (0.0, -4.2)])
def test_a_scanner_behind_racks_is_not_taken_for_one_between_them(scan_through_racks, place):
    voxels = ScanVisibility.of(voxel_grid(scan_through_racks, 0.16).points, scanner(*place, reach=15.0))
    assert "hidden by others" in check_views("views_before", voxels, points=scan_through_racks)


@pytest.mark.parametrize("place", [(3.0, 0.0), (-3.0, 0.0), (0.0, 2.0), (1.5, 0.0), (-1.5, 0.0)])
def test_a_scanner_elsewhere_does_not(scan, place):
    assert "hidden by others" in contradiction("views_before", scanner(*place), scan)


def test_a_view_of_nothing_but_outliers(scan):
    """It covers nothing, and the other view is still told to be of another place."""
    strays = np.array([[0.0, 40.0, 1.0], [0.0, 41.5, 2.0], [0.5, 44.0, 0.5]])
    through_a_wall, away = np.eye(4), np.eye(4)
    through_a_wall[:3, :3], through_a_wall[:3, 3] = [[0, 0, -1], [1, 0, 0], [0, -1, 0]], [4.5, 0.1, 1]
    away[:3, :3], away[:3, 3] = [[1, 0, 0], [0, 0, 1], [0, -1, 0]], [0, 35, 1]
    points = np.concatenate([scan, strays])
    views = SensorViews(np.stack([through_a_wall, away]), (80.0, 80.0), 90.0)
    survey = ScanVisibility.of(points, views)
    assert survey.outliers[-3:].all()
    seen = views.in_field_of_view(views.in_camera(points, 1))
    assert seen[-3:].all() and not seen[:-3].any()
    assert "hidden by others" in check_views("views_before", survey, ViewCheckSettings(max_outside=1.0))


def test_the_views_of_real_scans(scan_pairs):
    """The right ones are accepted, and those that are off by half the width of the cloud are not."""
    for folder in scan_pairs:
        for side in ("before", "after"):
            if not (folder / f"views_{side}.json").is_file():
                continue
            views, points = read_views(folder / f"views_{side}.json"), read_cloud(folder / f"{side}.ply").points
            points = points[:: 1 + len(points) // 60_000]
            assert contradiction("views", views, points) is None, folder.name
            half = np.ptp(np.percentile(points, [2, 98], axis=0), axis=0) / 2
            for axis in (0, 1):
                poses = views.poses.copy()
                poses[:, axis, 3] += half[axis]
                wrong = SensorViews(poses, views.field_of_view, 3 * views.max_range)
                assert contradiction("views", wrong, points) is not None, folder.name
        if folder.name == "apartment":
            before, after = (read_cloud(folder / f"{side}.ply").points for side in ("before", "after"))
            assert "hidden by others" in contradiction("views", read_views(folder / "views_after.json"), before)
            assert "hidden by others" in contradiction("views", read_views(folder / "views_before.json"), after)
