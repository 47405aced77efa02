"""Changes by Algorithm 1: the Gaussians whose removal brings the mixtures closest together (thesis 2.2.4)."""

import dataclasses

from jaxtyping import Array as JaxArray

from gmmjax._programs import kept_jit
from gmmjax.changes.config import Kinds
from gmmjax.changes.detectors.greedy_removal import remove_changed
from gmmjax.changes.detectors.separate import AbstractSeparateDetector, Compared, over_pairs
from gmmjax.mixtures import GaussianMixture
from gmmjax.pair import Pair
from gmmjax.transport import GroundCost, distance_of_means


@dataclasses.dataclass(frozen=True)
class GreedyDetector(AbstractSeparateDetector):
    """The thesis's detector: every pair of restarts by Algorithm 1.

    Attributes:
        ground_cost: between the components of two mixtures.
    """

    ground_cost: GroundCost = distance_of_means

    def compare(self, mixtures: Pair[GaussianMixture], points: Pair[float]) -> Compared:
        """Algorithm 1 for all pairs of restarts; see `AbstractSeparateDetector.compare`."""
        compared: Compared = _greedy_pairs(
            mixtures.before, mixtures.after, kinds=self.config.kinds, ground_cost=self.ground_cost
        )
        return compared


@kept_jit
def _greedy_pairs(
    before: GaussianMixture, after: GaussianMixture, *, kinds: Kinds, ground_cost: GroundCost
) -> Compared:
    def compare(before: GaussianMixture, after: GaussianMixture) -> tuple[JaxArray, JaxArray, JaxArray, JaxArray]:
        removals = remove_changed(before, after, kinds, ground_cost)
        return removals.disappeared, removals.appeared, removals.emd_before, removals.valid

    return over_pairs(compare)(before, after)
