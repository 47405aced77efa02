"""The evidence test of the joint method, for the segments of any detector."""

import dataclasses

import jax
import numpy as np
from jaxtyping import Float, Int

from gmmjax.changes import (
    AlignedPair,
    Candidates,
    DetectionConfig,
    Differences,
    JointFitSettings,
    LocalDifference,
    Survey,
    WorkingCloud,
    aligned,
    changed_probability,
    differences_between,
    examined,
    fit_joint_restarts,
    joint_problem,
    point_excess,
    surveys_of,
)
from gmmjax.clouds import SensorViews
from gmmjax.pair import Pair, each


@dataclasses.dataclass(frozen=True, eq=False)
class Evidence:
    """All that the joint method judges its own candidates by, for the segments of any detector.

    Attributes:
        pair: both clouds, registered and at the working resolution.
        surveys: the same with their views, where these do not contradict them.
        measured: the differences of the clouds from each other.
        excess: for each restart the posterior of the joint mixture that a working point is of what only its cloud has.
    """

    pair: AlignedPair
    surveys: Pair[Survey]
    measured: Differences
    excess: Pair[Float[np.ndarray, "r _"]]

    @classmethod
    def of(
        cls,
        points: Pair[Float[np.ndarray, "_ 3"]],
        views: Pair[SensorViews | None],
        config: DetectionConfig = DetectionConfig(),
    ) -> "Evidence | None":
        """The evidence that two clouds give; None for clouds that fill volumes, which hide nothing.

        Args:
            points: of both clouds.
            views: where they were seen from, if that is known.
            config: of the registration and the mixtures.

        Raises:
            InputError: nothing can be compared, or views that see none of their cloud.
            ComputationError: no restart gave a mixture.
        """
        pair = aligned(points, config.registration, config.voxel_size, seed=config.seed)
        if pair.working.volumetric:
            return None
        measured = differences_between(pair.surfaces, pair.working.spacing)
        return cls(pair, surveys_of(pair, views), measured, _excess(pair, config))

    def kept(self, labels: Pair[Int[np.ndarray, " _"]]) -> Pair[Int[np.ndarray, " _"]]:
        """The labels of the segments, and of the parts of segments, that are changes by this evidence; else -1.

        Args:
            labels: per point of either cloud -1 or the number of a change.
        """
        clouds = self.pair.working.clouds

        def candidates(cloud: WorkingCloud, own: LocalDifference, excess: np.ndarray, labels: np.ndarray) -> Candidates:
            probability = changed_probability(own, excess, self.measured.limits)
            return Candidates(cloud.points, own, probability, _voxel_labels(cloud, labels))

        segments = each(candidates, clouds, self.measured.local, self.excess, labels)
        found = examined(segments, self.surveys, self.measured.limits)
        return each(
            lambda own, cloud, judged: np.where(judged.labels[cloud.member] >= 0, own, -1), labels, clouds, found
        )


def _excess(pair: AlignedPair, config: DetectionConfig) -> Pair[Float[np.ndarray, "r _"]]:
    settings = JointFitSettings()
    problem = joint_problem(pair.working, pair.registration, config, settings)
    fits = fit_joint_restarts(
        problem.points,
        key=jax.random.key(config.seed),
        max_components=problem.max_components,
        slots=problem.slots,
        prior=problem.prior,
        restarts=config.number_of_restarts(on_surfaces=True),
        max_points=problem.max_points,
        settings=settings.em,
    )
    return each(lambda surface, after: point_excess(fits, surface.points, after), pair.surfaces, Pair(False, True))


def _voxel_labels(cloud: WorkingCloud, labels: Int[np.ndarray, " n"]) -> Int[np.ndarray, " m"]:
    """The label of each voxel: that of one of its points, of a changed one where it has any."""
    voxels = np.full(len(cloud.points), -1)
    np.maximum.at(voxels, cloud.member, labels)
    return voxels
