"""Changes by partial transport: the Gaussians' points that it leaves unmatched."""

import dataclasses

from jaxtyping import Array as JaxArray

from gmmjax._programs import kept_jit
from gmmjax._typing import Scalar
from gmmjax.changes.config import Kinds
from gmmjax.changes.detectors.separate import AbstractSeparateDetector, Compared, over_pairs
from gmmjax.changes.detectors.unmatched_mass import unmatched_shares
from gmmjax.mixtures import GaussianMixture
from gmmjax.pair import Pair
from gmmjax.transport import GroundCost, TransportStatus, bures_wasserstein_distance, distance_of_means, exact_transport


@dataclasses.dataclass(frozen=True)
class TransportDetector(AbstractSeparateDetector):
    """Every pair of restarts by partial transport of point counts.

    Attributes:
        ground_cost: between the components of two mixtures, by which points are matched.
    """

    ground_cost: GroundCost = bures_wasserstein_distance

    def compare(self, mixtures: Pair[GaussianMixture], points: Pair[float]) -> Compared:
        """Partial transport for all pairs of restarts; see `AbstractSeparateDetector.compare`."""
        compared: Compared = _transport_pairs(
            mixtures.before,
            mixtures.after,
            points.before,
            points.after,
            self.config.penalty,
            threshold=self.config.threshold,
            kinds=self.config.kinds,
            ground_cost=self.ground_cost,
        )
        return compared


@kept_jit
def _transport_pairs(
    before: GaussianMixture,
    after: GaussianMixture,
    points_before: Scalar,
    points_after: Scalar,
    penalty: Scalar | None,
    *,
    threshold: float,
    kinds: Kinds,
    ground_cost: GroundCost,
) -> Compared:
    def compare(before: GaussianMixture, after: GaussianMixture) -> tuple[JaxArray, JaxArray, JaxArray, JaxArray]:
        unmatched = unmatched_shares(before, after, points_before, points_after, penalty, ground_cost)
        distance = exact_transport(before.weights, after.weights, distance_of_means(before, after))
        valid = unmatched.valid & (distance.result == TransportStatus.optimal)
        disappeared = (unmatched.share_before > threshold) & (kinds != "appeared")
        appeared = (unmatched.share_after > threshold) & (kinds != "disappeared")
        return disappeared, appeared, distance.cost, valid

    return over_pairs(compare)(before, after)
