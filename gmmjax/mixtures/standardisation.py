"""The scale in which a fit is computed: about the points' mean, in units of their spread."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from gmmjax._host import is_traced
from gmmjax._matrix_products import in_full_precision
from gmmjax._typing import Array, Scalar
from gmmjax.mixtures.annihilation import Fit
from gmmjax.mixtures.mixture import GaussianMixture
from gmmjax.mixtures.prior import Prior
from gmmjax.mixtures.weighted_points import WeightedPoints


class Standardisation(eqx.Module):
    """A shift and one scale for all axes, so that a rigid motion or another unit changes nothing in the fit.

    Works on NumPy arrays (in their own float64) and on traced arrays alike.

    Attributes:
        origin: the mean of the points.
        spread: root mean square over the axes of the standard deviation; 1 where all points are equal.
    """

    origin: Float[Array, " d"]
    spread: Scalar

    @classmethod
    @in_full_precision
    def of(cls, points: WeightedPoints) -> "Standardisation":
        """The frame of the points."""
        weights = points.mass / points.mass.sum()
        # Twice, because the first mean of survey coordinates has lost digits that the second regains.
        origin = points.points[0] + weights @ (points.points - points.points[:1])
        variance = (weights @ (points.points - origin[None]) ** 2).mean()
        # NumPy's variance is never 0: points that are all equal were turned away at the door.
        safe = jnp.where(variance > 0, variance, 1) if isinstance(variance, jax.Array) else variance
        return cls(origin, safe**0.5)

    def enter(self, points: WeightedPoints) -> WeightedPoints:
        """The points in this frame."""
        scatter = None if points.scatter is None else points.scatter / self.spread**2
        return WeightedPoints((points.points - self.origin[None]) / self.spread, points.mass, scatter)

    def enter_mixture(self, mixture: GaussianMixture) -> GaussianMixture:
        """A mixture in the unit of the points, in this frame."""
        return mixture.rescaled(1 / self.spread, -self.origin / self.spread)

    def enter_prior(self, prior: Prior) -> Prior:
        """A belief in the unit of the points, in this frame."""
        return prior.rescaled(1 / self.spread, -self.origin / self.spread)

    def leave(self, mixture: GaussianMixture) -> GaussianMixture:
        """A mixture of this frame in the unit of the points."""
        return mixture.rescaled(self.spread, self.origin)

    def leave_fit(self, fit: Fit, observations: Scalar) -> Fit:
        """A fit of this frame in the unit of the points: densities there are smaller by the scale's volume."""
        library = jnp if is_traced(self, fit) else np
        log_volume = observations * len(self.origin) * library.log(self.spread)
        return Fit(
            mixture=self.leave(fit.mixture),
            message_length=library.asarray(fit.message_length + log_volume),
            log_likelihood=library.asarray(fit.log_likelihood - log_volume),
            steps=fit.steps,
            result=fit.result,
            bits=fit.bits,
            noise_share=fit.noise_share,
        )
