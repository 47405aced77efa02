"""The stage that turns what was found in both clouds into changes: kinds, confidence, one list."""

import dataclasses
import functools
import logging
from collections.abc import Mapping
from typing import Any, NamedTuple, get_args

import numpy as np
from jaxtyping import Bool, Float64, Int

from gmmjax.changes.align.alignment import AlignedPair
from gmmjax.changes.change import Change, Kind, Reason
from gmmjax.changes.config import DetectionConfig
from gmmjax.changes.differences import Differences
from gmmjax.changes.evidence.examination import Examined
from gmmjax.changes.fit.joint_fit import JointFits
from gmmjax.changes.fit.joint_problem import JointProblem
from gmmjax.changes.objects.cloud_changes import CloudChanges, merged, merged_rejected
from gmmjax.changes.objects.surface_changes import SurfaceChangeSettings, surface_changes
from gmmjax.changes.objects.volumetric_changes import restart_weights, volumetric_changes
from gmmjax.changes.prepare.checking import NAMES, CheckedCloud
from gmmjax.changes.record import Changes
from gmmjax.changes.registration import Registration
from gmmjax.changes.signed_distance import PointFigures
from gmmjax.comparison import Kinds
from gmmjax.pair import Pair, each

logger = logging.getLogger(__name__)

# The kind of a change in the before and in the after cloud.
KINDS: Pair[Kind] = Pair("disappeared", "appeared")


class PairChanges(NamedTuple):
    """The changes of both clouds, before they are one list.

    Attributes:
        changes: of all points of either cloud.
        unobserved: per point whether the other survey did not observe its place.
        registration_error: standard deviation of the offset between unchanged surfaces; 0 where there are none.
    """

    changes: Pair[CloudChanges]
    unobserved: Pair[Bool[np.ndarray, " _"]]
    registration_error: float = 0.0

    def of_kinds(self, kinds: Kinds) -> "PairChanges":
        """Without the changes of the kind that is not looked for."""
        looked_for = Pair(kinds != "appeared", kinds != "disappeared")
        return self._replace(changes=each(lambda own, kept: own if kept else own.none(), self.changes, looked_for))

    def with_confidence(self, confidence: float) -> "PairChanges":
        """With all probabilities multiplied by the confidence in the registration."""
        if confidence == 1:
            return self
        return self._replace(changes=self.changes.map(lambda own: own.with_confidence(confidence)))

    def merged(self) -> tuple[tuple[Change, ...], Pair[Int[np.ndarray, " _"]]]:
        """The changes of both clouds in one list, and the labels that refer to it."""
        return merged(self.changes)

    def grown_to(self, items: tuple[Change, ...], labels: Pair[Int[np.ndarray, " _"]]) -> "PairChanges":
        """With the probability of its change for every point that has joined one, and was of none; it was observed.

        Args:
            items: the changes.
            labels: per point -1, or the index of its change.
        """
        of_changes = np.array([*(item.probability for item in items), 0.0])

        unobserved = each(lambda hidden, label: hidden & (label < 0), self.unobserved, labels)
        grown = each(lambda changes, label: _grown(changes, label, of_changes), self.changes, labels)
        return self._replace(changes=grown, unobserved=unobserved)

    def record(
        self,
        clouds: Pair[CheckedCloud],
        items: tuple[Change, ...],
        labels: Pair[Int[np.ndarray, " _"]],
        emd: float,
        config: DetectionConfig,
        diagnostics: Mapping[str, Any],
        registration: Registration | None = None,
    ) -> Changes:
        """The record, with a value for each row that the caller gave.

        Args:
            clouds: whose rows these are.
            items: the changes.
            labels: per point -1, or the index of its change.
            emd: earth mover's distance between the mixtures.
            config: the settings that were used.
            diagnostics: scales, timings and other plain values of this detection.
            registration: of the after cloud; None: none was made.
        """
        of_rows = each(lambda cloud, own: cloud.to_rows(own, -1), clouds, labels)
        probability = each(lambda cloud, own: cloud.to_rows(own.probability, 0.0), clouds, self.changes)
        unobserved = each(lambda cloud, own: cloud.to_rows(own, False), clouds, self.unobserved)
        changes = Changes(
            labels_before=of_rows.before,
            labels_after=of_rows.after,
            probability_before=probability.before,
            probability_after=probability.after,
            unobserved_before=unobserved.before,
            unobserved_after=unobserved.after,
            items=items,
            emd=emd,
            config=config,
            diagnostics=diagnostics,
            registration=registration or Registration.none(),
            rejected=merged_rejected(self.changes),
        )
        _log(changes)
        return changes

    def with_figures(self, changes: Changes, clouds: Pair[CheckedCloud], figures: Pair[PointFigures]) -> Changes:
        """The record with the distance of each row to the surface of the other cloud, and how significant it is.

        Args:
            changes: the record.
            clouds: whose rows these are.
            figures: of each point; they become NaN where the other survey did not observe the place.
        """
        rows = each(_figures_of_rows, clouds, figures, self.unobserved, NAMES)
        return dataclasses.replace(changes, **rows.before, **rows.after)


def _grown(changes: CloudChanges, label: Int[np.ndarray, " n"], of_changes: Float64[np.ndarray, " c"]) -> CloudChanges:
    joined = (label >= 0) & (changes.labels < 0)
    return changes._replace(probability=np.where(joined, of_changes[label], changes.probability))


def _figures_of_rows(
    cloud: CheckedCloud, own: PointFigures, hidden: Bool[np.ndarray, " n"], side: str
) -> dict[str, Any]:
    """The figures of one cloud by their names in the record, NaN where nothing was observed."""
    return {
        f"{name}_{side}": cloud.to_rows(np.where(hidden, np.float32(np.nan), values), np.nan)
        for name, values in own._asdict().items()
    }


def _log(changes: Changes) -> None:
    """Log what was found, and what became of the candidates that are no changes."""
    reasons = {reason: sum(one.reason == reason for one in changes.rejected) for reason in get_args(Reason)}
    rejected = ", ".join(f"{count} {reason}" for reason, count in reasons.items())
    logger.info("%d changes, %d rejected candidates (%s)", len(changes), len(changes.rejected), rejected)
    for label, change in enumerate(changes):
        logger.debug("change %d: %r", label, change)
    for candidate in changes.rejected:
        logger.debug("rejected: %r", candidate)


def changes_on_surfaces(
    pair: AlignedPair,
    differences: Differences,
    evident: Pair[Examined],
    settings: SurfaceChangeSettings = SurfaceChangeSettings(),
) -> PairChanges:
    """The changes of scans: the significant ones of the candidates that the evidence left.

    Args:
        pair: both clouds, registered.
        differences: of the working points from the other cloud.
        evident: the candidates of the working points that the evidence left.
        settings: which candidates are significant, and how probable they are.
    """
    members = pair.working.clouds.map(lambda cloud: cloud.member)
    limits = differences.limits
    of_cloud = functools.partial(surface_changes, limits=limits, settings=settings)
    return PairChanges(
        each(of_cloud, pair.points, members, differences.local, evident, KINDS),
        each(lambda own, member: own.unobserved[member], evident, members),
        limits.registration_error,
    )


def changes_in_volumes(
    points: Pair[Float64[np.ndarray, "_ 3"]],
    problem: JointProblem,
    fits: JointFits,
    threshold: float,
) -> PairChanges:
    """The changes of clouds that fill volumes: the components that one cloud has and the other has not.

    Args:
        points: all points of both clouds, registered.
        problem: that was fitted.
        fits: the joint mixtures.
        threshold: probability from which on a point is changed.
    """
    weights = volume_weights(problem, fits)
    changes = each(lambda own, kind: volumetric_changes(own, fits, weights, kind, threshold), points, KINDS)
    return PairChanges(changes, points.map(lambda own: np.zeros(len(own), bool)))


def volume_weights(problem: JointProblem, fits: JointFits) -> Float64[np.ndarray, " r"]:
    """The weights of the restarts of clouds that fill volumes; see `restart_weights`.

    Args:
        problem: that was fitted.
        fits: the joint mixtures.
    """
    return restart_weights(fits.message_length, comparable=len(problem.points.after) <= problem.max_points)
