"""Two scans in one frame, and all that is derived of them before anything is fitted."""

import dataclasses
import functools

import numpy as np
from jaxtyping import Int

from gmmjax.changes.align.alignment import AlignedPair
from gmmjax.changes.change import Changes
from gmmjax.changes.detectors.detector import Scan
from gmmjax.changes.differences import Differences, DifferenceSettings, differences_between
from gmmjax.changes.evidence.examination import observed_places
from gmmjax.changes.evidence.free_space import FreeSpaceSettings, Survey
from gmmjax.changes.evidence.verdict_file import Verdicts
from gmmjax.changes.evidence.view_checks import ViewCheckSettings, usable_views
from gmmjax.changes.fit.joint_fit import FramedPoints
from gmmjax.changes.fit.joint_problem import JointProblem
from gmmjax.changes.prepare.checking import NAMES, CheckedCloud
from gmmjax.changes.prepare.resolution import WorkingCloud
from gmmjax.changes.signed_distance import PointFigures, SignedDistanceSettings, signed_distances
from gmmjax.clouds import SensorViews
from gmmjax.geometry import LocalSurface
from gmmjax.pair import Pair, each


@dataclasses.dataclass(frozen=True, eq=False)
class AlignedScans:
    """Two scans in one frame. What depends on nothing else is computed when it is first asked for, and once.

    Attributes:
        scans: as they were given.
        checked: their clouds.
        pair: registered.
        surveys: with the views that can be used.
        problem: the joint mixture that they ask for.
        verdicts: what decides whether a candidate is a change.
        settings: how distances between the clouds are measured.
        distances: how the signed distance at each point is.
    """

    scans: Pair[Scan]
    checked: Pair[CheckedCloud]
    pair: AlignedPair
    surveys: Pair[Survey]
    problem: JointProblem
    verdicts: Verdicts
    settings: DifferenceSettings
    distances: SignedDistanceSettings = SignedDistanceSettings()

    @property
    def volumetric(self) -> bool:
        """Whether the clouds fill volumes."""
        return self.pair.working.volumetric

    @functools.cached_property
    def framed(self) -> FramedPoints:
        """What the joint mixture is fitted to."""
        return FramedPoints.of(self.problem.points)

    @functools.cached_property
    def differences(self) -> Differences:
        """Of the working points of scans from each other."""
        return differences_between(self.pair.surfaces, self.pair.working.spacing, self.settings)

    @functools.cached_property
    def observed(self) -> Pair[np.ndarray | None]:
        """What the other survey observed at the place of each working point; None: its views are not known."""
        points = self.pair.surfaces.map(lambda surface: surface.points)
        return observed_places(points, self.surveys, self.differences)

    @functools.cached_property
    def figures(self) -> Pair[PointFigures]:
        """The signed distance at each point of scans, and how significant it is: those of its working point."""
        views = self.surveys.map(lambda survey: survey.views)
        working = signed_distances(self.pair.points, self.pair.surfaces, self.differences, views, self.distances)

        def of_points(own: PointFigures, cloud: WorkingCloud) -> PointFigures:
            return PointFigures(*(values.astype(np.float32)[cloud.member] for values in own))

        return each(of_points, working, self.pair.working.clouds)

    @functools.cached_property
    def members(self) -> Pair[Int[np.ndarray, " _"]]:
        """Of each point of either scan the row of its working point, -1 for what was left out."""
        return each(lambda cloud, working: cloud.to_rows(working.member, -1), self.checked, self.pair.working.clouds)

    def labels_of(self, changes: Changes) -> Pair[Int[np.ndarray, " _"]]:
        """The labels of a record for the points that were compared."""
        labels = Pair(changes.labels_before, changes.labels_after)
        return each(lambda own, cloud: own[cloud.rows], labels, self.checked)


def surveys_of(
    pair: AlignedPair, scans: Pair[Scan], free_space: FreeSpaceSettings, checks: ViewCheckSettings
) -> Pair[Survey]:
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

    def survey(name: str, surface: LocalSurface, views: SensorViews | None) -> Survey:
        return usable_views(f"views_{name}", Survey(surface, views, free_space), checks)

    return each(survey, NAMES, pair.surfaces, views)
