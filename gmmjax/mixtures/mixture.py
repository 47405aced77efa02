"""The Gaussian mixture (thesis 2.2.1) on a fixed number of slots, of which some may be dead."""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Bool, Float, Int, PRNGKeyArray

from gmmjax._host import float64_on_host
from gmmjax._matrix_products import in_full_precision
from gmmjax._typing import Array, Scalar
from gmmjax.mixtures.covariance_type import CovarianceType, parameters_per_component, shared_parameters


class GaussianMixture(eqx.Module):
    r"""A mixture of Gaussians, equation (2.1): $p(x) = \sum_k w_k N(x; \mu_k, \Sigma_k)$.

    The k slots are fixed so that programs compile once. A dead slot, one that was annihilated or never used, has
    weight 0, mean 0 and the identity as covariance: finite everywhere, and without influence on any result.

    With NumPy leaves, as host functions return it, its methods compute in float64 whatever JAX's setting, and return
    NumPy arrays; with JAX's leaves, or traced points, they compute in the dtype of their arguments.

    Attributes:
        weights: mixing weights, summing to 1 over the live slots; 0 in dead ones.
        means: means, in the unit of the points.
        covariances: covariances, in the square of that unit.
        live: which slots hold a component.
    """

    weights: Float[Array, " k"]
    means: Float[Array, "k d"]
    covariances: Float[Array, "k d d"]
    live: Bool[Array, " k"]

    @classmethod
    def masked(
        cls,
        weights: Float[Array, " k"],
        means: Float[Array, "k d"],
        covariances: Float[Array, "k d d"],
        live: Bool[Array, " k"],
    ) -> "GaussianMixture":
        """The mixture of the live slots alone: dead slots get their constants; weights are taken as they are."""
        covariances = jnp.asarray(covariances)
        identity = jnp.eye(covariances.shape[-1], dtype=covariances.dtype)
        return cls(
            weights=jnp.where(live, weights, 0),
            means=jnp.where(live[:, None], means, 0),
            covariances=jnp.where(live[:, None, None], covariances, identity[None]),
            live=live,
        )

    @property
    def dimension(self) -> int:
        """The dimension d of the space."""
        return int(self.means.shape[-1])

    @property
    def count(self) -> Int[Array, "..."]:
        """Number of live components, the K of the papers; one value for each mixture of a batch."""
        return jnp.sum(self.live, axis=-1)

    def number_of_parameters(self, covariance_type: CovarianceType = "full") -> Int[Array, "..."]:
        """J, the free parameters of the live components and K - 1 free weights: 10 K - 1 for full ones in 3-D."""
        per_component = parameters_per_component(self.dimension, covariance_type)
        return self.count * (per_component + 1) - 1 + shared_parameters(self.dimension, covariance_type)

    @float64_on_host
    @in_full_precision
    def log_joint(self, points: Float[Array, "n d"]) -> Float[Array, "n k"]:
        r"""$\log w_k N(x_n; \mu_k, \Sigma_k)$ for every point and slot; minus infinity in dead slots.

        Points and means are taken relative to one origin before anything is squared, so that survey coordinates (1e6 m)
        keep their digits.

        Args:
            points: coordinates, in the unit of the mixture.
        """
        origin = self.weights @ self.means
        whitening = whitenings(jnp.asarray(self.covariances))
        centred_means = jnp.einsum("ked,kd->ke", whitening, jnp.asarray(self.means - origin[None]))
        standardised = jnp.einsum("ked,nd->nke", whitening, jnp.asarray(points - origin[None])) - centred_means[None]
        log_determinants = -2 * jnp.sum(jnp.log(jnp.diagonal(whitening, axis1=-2, axis2=-1)), axis=-1)
        normalisation = log_determinants + self.dimension * jnp.log(2 * jnp.pi).astype(whitening.dtype)
        log_weights = jnp.where(self.live, jnp.log(jnp.where(self.live, self.weights, 1)), -jnp.inf)
        return (log_weights - normalisation / 2)[None, :] - jnp.sum(standardised**2, axis=-1) / 2

    @float64_on_host
    def log_density(self, points: Float[Array, "n d"]) -> Float[Array, " n"]:
        """Logarithm of the density (2.1) at each point, in nats per unit volume."""
        return jax.nn.logsumexp(self.log_joint(points), axis=1)

    @float64_on_host
    def responsibilities(self, points: Float[Array, "n d"]) -> Float[Array, "n k"]:
        """Probability that each point was drawn from each component, equation (2.6); 0 in dead slots, rows sum to 1."""
        return jax.nn.softmax(self.log_joint(points), axis=1)

    @float64_on_host
    def labels(self, points: Float[Array, "n d"]) -> Int[Array, " n"]:
        """The slot of the most probable component of each point."""
        return jnp.argmax(self.log_joint(points), axis=1)

    @float64_on_host
    @in_full_precision
    def sample(self, key: PRNGKeyArray, n: int) -> Float[Array, "n d"]:
        """Draws n independent points from the mixture."""
        key_components, key_points = jax.random.split(key)
        components = jax.random.categorical(key_components, jnp.log(self.weights), shape=(n,))
        means, factors = jnp.asarray(self.means), jnp.linalg.cholesky(jnp.asarray(self.covariances))
        standard = jax.random.normal(key_points, (n, self.dimension), means.dtype)
        return means[components] + jnp.einsum("nij,nj->ni", factors[components], standard)

    def rescaled(self, scale: Scalar, shift: Float[Array, " d"]) -> "GaussianMixture":
        """The mixture of the points `scale * x + shift`, where this one is that of x; dead slots stay as they are."""
        # In operators alone, so that NumPy leaves stay NumPy's float64 where JAX has only float32.
        live = self.live.astype(self.means.dtype)[:, None]
        return GaussianMixture(
            weights=self.weights,
            means=live * (scale * self.means + shift[None]),
            # Not 1 + (scale**2 - 1) * live, which loses a small scale beside the 1.
            covariances=(scale**2 * live + (1 - live))[..., None] * self.covariances,
            live=self.live,
        )

    @float64_on_host
    def compacted(self, slots: int) -> "GaussianMixture":
        """The mixture in fewer slots, live components first; `slots` must be at least their number."""
        order = jnp.argsort(~jnp.asarray(self.live), stable=True)[:slots]
        return jax.tree.map(lambda leaf: jnp.asarray(leaf)[order], self)

    def live_part(self) -> "GaussianMixture":
        """The mixture without its dead slots. On the host only: the shape depends on the values."""
        return jax.tree.map(lambda leaf: leaf[self.live], self)


def whitenings(covariances: Float[Array, "k d d"]) -> Float[Array, "k d d"]:
    r"""The inverses $W_k$ of the covariances' Cholesky factors, $W_k^T W_k = \Sigma_k^{-1}$."""
    identity = jnp.broadcast_to(jnp.eye(covariances.shape[-1], dtype=covariances.dtype), covariances.shape)
    return jax.scipy.linalg.solve_triangular(jnp.linalg.cholesky(covariances), identity, lower=True)
