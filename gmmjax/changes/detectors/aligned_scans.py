"""Two scans in one frame, and all that is derived of them before anything is fitted."""

import dataclasses
import functools
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Float64, Int

from gmmjax.changes.align.alignment import AlignedPair
from gmmjax.changes.detectors.detector import Scan
from gmmjax.changes.differences import Differences, DifferenceSettings, differences_between
from gmmjax.changes.evidence.examination import observed_places
from gmmjax.changes.evidence.local_examination import LocalScene
from gmmjax.changes.evidence.scan_visibility import FreeSpaceSettings, ScanVisibility
from gmmjax.changes.evidence.view_checks import ViewCheckSettings, usable_views
from gmmjax.changes.fit.joint_fit import FramedPoints
from gmmjax.changes.fit.joint_problem import JointProblem
from gmmjax.changes.fit.restart_values import RestartValues
from gmmjax.changes.prepare.checking import NAMES, CheckedCloud
from gmmjax.changes.prepare.local_resolution import LocalResolutionSettings, locally_reduced
from gmmjax.changes.prepare.resolution import WorkingCloud
from gmmjax.changes.prepare.units import stated_systems
from gmmjax.changes.record import Changes
from gmmjax.changes.signed_distance import OuterSide, PointFigures, SignedDistanceSettings, signed_distances
from gmmjax.clouds import is_geocentric_system
from gmmjax.geometry import LocalSurface, is_geocentric, z_is_height
from gmmjax.pair import Pair, each, parallel_map


class Measured(NamedTuple):
    """Measurements of the working points that were made beforehand, tile by tile.

    Attributes:
        differences: of the scans from each other.
        figures: the signed distance at each working point.
    """

    differences: Differences
    figures: Pair[PointFigures]


@dataclasses.dataclass(frozen=True, eq=False)
class AlignedScans:
    """Two scans in one frame. What depends on nothing else is computed when it is first asked for, and once.

    Attributes:
        scans: as they were given.
        checked: their clouds.
        pair: registered, at the resolution that they are compared at.
        coarse: the points at the resolution that they were registered at, where that is coarser; None: it is the same.
        surveys: with the views that can be used.
        problem: the joint mixture that they ask for.
        settings: how distances between the clouds are measured.
        distances: how the signed distance at each point is.
        measured: what was measured beforehand; None: it is measured when it is first asked for.
    """

    scans: Pair[Scan]
    checked: Pair[CheckedCloud]
    pair: AlignedPair
    coarse: Pair[Float[np.ndarray, "_ 3"]] | None
    surveys: Pair[ScanVisibility]
    problem: JointProblem
    settings: DifferenceSettings
    distances: SignedDistanceSettings = SignedDistanceSettings()
    measured: Measured | None = None

    @property
    def volumetric(self) -> bool:
        """True where the clouds fill volumes."""
        return self.pair.working.volumetric

    @functools.cached_property
    def framed(self) -> FramedPoints:
        """The points that the joint mixture is fitted to."""
        return FramedPoints.of(self.problem.points)

    @functools.cached_property
    def differences(self) -> Differences:
        """The differences of the working points of both scans from each other."""
        if self.measured is not None:
            return self.measured.differences
        surfaces, working = self.pair.surfaces, self.pair.working
        if self.coarse is None:
            return differences_between(surfaces, working.spacing, self.settings)
        spacing = surfaces.map(lambda surface: surface.spacing(np.arange(len(surface))))
        return differences_between(surfaces, working.spacing, self.settings, spacing)

    def scene(self, excess: Callable[[Float[np.ndarray, "n 3"], bool], RestartValues]) -> LocalScene:
        """The scans at their own resolution; only where they were registered at a coarser one.

        Args:
            excess: the posterior of the joint mixture that points are of what only their cloud has.
        """
        assert self.coarse is not None
        return LocalScene(self.pair.working.clouds, self.coarse, self.surveys, self.differences, excess)

    @functools.cached_property
    def observed(self) -> Pair[np.ndarray | None]:
        """The other survey's observation of the place of each working point; None: its views are not known."""
        points = self.pair.surfaces.map(lambda surface: surface.points)
        return observed_places(points, self.surveys, self.differences)

    @functools.cached_property
    def figures(self) -> Pair[PointFigures]:
        """The signed distance at each point of scans, and how significant it is: those of its working point."""
        if self.measured is None:
            towards = self.surveys.map(lambda survey: survey.towards)
            working = signed_distances(self.pair.points, self.pair.surfaces, self.differences, towards, self.distances)
        else:
            working = self.measured.figures
        return each(_figures_of_points, working, self.pair.working.clouds)

    @property
    def sensors(self) -> Pair[Float64[np.ndarray, "_ 3"] | None]:
        """Positions of the sensors of both surveys; None: not known."""
        return self.surveys.map(lambda survey: None if survey.views is None else survey.views.poses[:, :3, 3])

    @functools.cached_property
    def outer_side(self) -> OuterSide:
        """The clue from which side the surfaces of both scans were seen."""
        if any(views is not None for views in self.sensors):
            return "sensor"
        surfaces = self.pair.surfaces
        stated = stated_systems(self.scans.map(lambda scan: scan.cloud))
        geocentric = any(is_geocentric_system(crs) for crs in stated if crs is not None)
        if geocentric or any(is_geocentric(surface.points) for surface in surfaces):
            return "unknown"
        return "up" if any(stated) or all(z_is_height(surface.points) for surface in surfaces) else "unknown"

    @functools.cached_property
    def members(self) -> Pair[Int[np.ndarray, " _"]]:
        """The row of the working point of each point of either scan, -1 for what was left out."""
        return each(lambda cloud, working: cloud.to_rows(working.member, -1), self.checked, self.pair.working.clouds)

    def without_views(self) -> "AlignedScans":
        """Copy both scans without the poses of their sensors."""
        return dataclasses.replace(self, surveys=self.surveys.map(ScanVisibility.without_views))

    def labels_of(self, changes: Changes) -> Pair[Int[np.ndarray, " _"]]:
        """The labels of a record for the points that were compared."""
        labels = Pair(changes.labels_before, changes.labels_after)
        return each(lambda own, cloud: own[cloud.rows], labels, self.checked)


def refined(pair: AlignedPair, settings: LocalResolutionSettings) -> AlignedPair | None:
    """The pair in voxels as small as both scans allow at each place; None where they allow none smaller anywhere.

    Args:
        pair: in voxels of one size.
        settings: how small they are.
    """
    size = pair.working.voxel_size
    assert size is not None
    clouds = locally_reduced(pair.points, size, settings)
    if all(cloud.sizes is None or (cloud.sizes >= size).all() for cloud in clouds):
        return None
    surfaces = parallel_map(lambda cloud: LocalSurface.of(cloud.points, tree=cloud.tree), clouds)
    return pair._replace(working=dataclasses.replace(pair.working, clouds=clouds), surfaces=surfaces)


def surveys_of(
    pair: AlignedPair, scans: Pair[Scan], free_space: FreeSpaceSettings, checks: ViewCheckSettings
) -> Pair[ScanVisibility]:
    """Both clouds with their views in the before frame, where these do not contradict them.

    Args:
        pair: both clouds, registered.
        scans: with their views in their own frames.
        free_space: what the points of a survey occlude.
        checks: from when on views contradict their cloud.
    """
    views = scans.map(lambda scan: scan.views)
    if views.after is not None and pair.registration.applied:
        views = Pair(views.before, views.after.moved(pair.registration.transform))

    surveys = each(lambda surface, own: ScanVisibility(surface, own, free_space), pair.surfaces, views)
    # Nobody has given the views that were recognised: there is nothing to be corrected.
    usable = each(
        lambda name, own, points, scan: usable_views(f"views_{name}", own, checks, points, quiet=scan.recognised),
        NAMES,
        surveys,
        pair.points,
        scans,
    )
    return _seen_from_known_places(usable)


def _figures_of_points(working: PointFigures, cloud: WorkingCloud) -> PointFigures:
    """The figures of each point: those of its working point."""
    return PointFigures(*(values.astype(np.float32)[cloud.member] for values in working))


def _seen_from_known_places(surveys: Pair[ScanVisibility]) -> Pair[ScanVisibility]:
    """The surveys, one without views seen from where the other one was: the same surface faces the same way."""
    places = surveys.map(lambda own: None if own.views is None else own.towards)
    return each(lambda own, others: dataclasses.replace(own, seen_from=others), surveys, places.swapped)
