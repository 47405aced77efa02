"""The earth mover's distance between two mixtures of which some components are left out (thesis 2.2.3, 2.2.4)."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array as JaxArray
from jaxtyping import Bool, Float

from gmmjax._typing import Array, Scalar
from gmmjax.comparison.choices import Solver
from gmmjax.mixtures import GaussianMixture
from gmmjax.transport import GroundCost, TransportResult, default_epsilon, exact_transport, sinkhorn


class PrunedDistance(eqx.Module):
    """The distance as a function of the components that are kept, whose weights are renormalised.

    Attributes:
        weights_before: of the before mixture; 0 in dead slots.
        weights_after: of the after mixture.
        cost: ground costs.
        epsilon: entropy of Sinkhorn's solver, the same whatever is kept; None for the exact one.
    """

    weights_before: Float[Array, " k0"]
    weights_after: Float[Array, " k1"]
    cost: Float[Array, "k0 k1"]
    epsilon: Float[Array, ""] | None

    @classmethod
    def between(
        cls,
        before: GaussianMixture,
        after: GaussianMixture,
        ground_cost: GroundCost,
        solver: Solver = "exact",
        epsilon: Scalar | None = None,
    ) -> "PrunedDistance":
        """The distance between two mixtures; arguments as of `earth_movers_distance`."""
        cost = ground_cost(before, after)
        weights = [jnp.where(mixture.live, mixture.weights, 0) for mixture in (before, after)]
        if solver == "exact":
            return cls(weights[0], weights[1], cost, None)
        live = (weights[0] > 0)[:, None] & (weights[1] > 0)[None]
        strength = default_epsilon(cost, live) if epsilon is None else jnp.asarray(epsilon, cost.dtype)
        return cls(weights[0], weights[1], cost, strength)

    def __call__(
        self,
        kept_before: Bool[Array, " k0"],
        kept_after: Bool[Array, " k1"],
        start: Float[Array, " k1"] | None = None,
    ) -> TransportResult:
        """The distance between the components that are kept.

        Args:
            kept_before: of the before mixture.
            kept_after: of the after mixture.
            start: potentials of the after mixture that the exact solver starts from.
        """
        masses = _normalised(self.weights_before, kept_before), _normalised(self.weights_after, kept_after)
        if self.epsilon is not None:
            return sinkhorn(*masses, self.cost, epsilon=self.epsilon)
        return exact_transport(*masses, self.cost, start=start)


def _normalised(weights: Float[Array, " k"], kept: Bool[Array, " k"]) -> JaxArray:
    left = jnp.where(kept, weights, 0)
    total = jnp.sum(left)
    return left / jnp.where(total > 0, total, 1)
