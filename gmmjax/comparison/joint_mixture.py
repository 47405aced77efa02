r"""One mixture for both clouds: each component has its own share of "after".

$$p(x, s) = \sum_k w_k N(x; \mu_k, \Sigma_k + \tau^2 I) \theta_k^s (1 - \theta_k)^{1-s} + w_0 u(x) / 2$$

with s = 0 before and 1 after, the registration tolerance $\tau$, and a uniform density u for stray points. Separate
fits split the same wall in two ways; the one mixture splits it once, and what differs between the clouds is in the
shares.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Float

from gmmjax._matrix_products import in_full_precision
from gmmjax._typing import Array, Scalar
from gmmjax.mixtures import GaussianMixture, coefficients, noise_coefficients, quadratic_features


class JointMixture(eqx.Module):
    """A mixture for both clouds.

    Attributes:
        mixture: the Gaussians, widened by noise and tolerance. Their weights and `noise_weight` sum to 1.
        share_after: the share of each component's observations that are of the after cloud; 0.5 in dead slots.
        noise_weight: weight of the uniform component.
        log_noise: logarithm of that component's density, of a point and its source.
    """

    mixture: GaussianMixture
    share_after: Float[Array, " k"]
    noise_weight: Float[Array, ""]
    log_noise: Float[Array, ""]

    def coefficients(self) -> Float[Array, "rows features"]:
        """The log joints as linear functions of the quadratic features and the source; the last row is the noise."""
        rows = coefficients(self.mixture)
        log_before, log_after = jnp.log1p(-self.share_after), jnp.log(self.share_after)
        rows = jnp.concatenate([rows.at[:, 0].add(log_before), (log_after - log_before)[:, None]], axis=1)
        return jnp.concatenate([rows, noise_coefficients(self.noise_weight, self.log_noise, rows.shape[1])])


def density_ratio(joint: JointMixture) -> Float[Array, ""]:
    """Observations of the after cloud for one of the before cloud, where both saw the same.

    The weighted median of the components' odds: what changed is the smaller part and does not move it.
    """
    shares = joint.share_after
    odds = shares / (1 - shares)
    weights = joint.mixture.weights * jnp.minimum(shares, 1 - shares)
    order = jnp.argsort(odds)
    cumulative = jnp.cumsum(weights[order])
    return odds[order][jnp.searchsorted(cumulative, cumulative[-1] / 2)]


@in_full_precision
def intensities(joint: JointMixture, points: Float[Array, "n d"]) -> tuple[Float[Array, " n"], Float[Array, " n"]]:
    """The expected density of observations of the before and of the after cloud at each point, noise included.

    The points must be near the origin in a scale of order 1, where the quadratic features keep their digits.
    """
    log_joint = coefficients(joint.mixture) @ quadratic_features(points)
    both = jnp.exp(log_joint)
    noise = joint.noise_weight * jnp.exp(joint.log_noise)
    return (1 - joint.share_after) @ both + noise, joint.share_after @ both + noise


def responsibilities(joint: JointMixture, points: Float[Array, "n d"], after: bool) -> Float[Array, "rows n"]:
    """Probability that each point of one cloud is of each component; the last row is the noise."""
    return jax.nn.softmax(log_joint(joint, points, after), axis=0)


@in_full_precision
def log_joint(joint: JointMixture, points: Float[Array, "n d"], after: bool) -> Float[Array, "rows n"]:
    """Logarithm of each component's joint density of a point and its cloud; the last row is the noise's."""
    source = jnp.full((1, len(points)), float(after), points.dtype)
    return joint.coefficients() @ jnp.concatenate([quadratic_features(points), source])


def changed_share(joint: JointMixture, ratio: Scalar, after: bool) -> Float[Array, " k"]:
    r"""The share of each component's observations in one cloud that the other does not have.

    $\max(0, 1 - \rho (1 - \theta_k) / \theta_k)$ in the after cloud, $\max(0, 1 - \theta_k / (\rho (1 - \theta_k)))$
    in the before cloud; 0 in dead slots.
    """
    odds = joint.share_after / (1 - joint.share_after) / ratio
    return jnp.where(joint.mixture.live, jnp.maximum(0, 1 - (1 / odds if after else odds)), 0)


def point_posterior(joint: JointMixture, ratio: Scalar, points: Float[Array, "n d"], after: bool) -> Float[Array, " n"]:
    r"""The posterior that a point is extra: $\max(0, 1 - \rho f_0 / f_1)$ in the after cloud.

    The intensities $f_0$ and $f_1$ of the two clouds are compared in a place, whatever Gaussians make them up: two that
    share a wall unevenly cancel out.

    Args:
        joint: the joint mixture.
        ratio: its `density_ratio` $\rho$.
        points: of one cloud, in the scale of the mixture.
        after: whether that is the after cloud; in the before cloud it is $\max(0, 1 - f_1 / (\rho f_0))$.
    """
    intensity_before, intensity_after = intensities(joint, points)
    scaled = intensity_before * ratio
    return jnp.clip(1 - (scaled / intensity_after if after else intensity_after / scaled), 0, 1)


def component_posterior(
    joint: JointMixture, ratio: Scalar, points: Float[Array, "n d"], after: bool
) -> Float[Array, "k n"]:
    """The posterior that a point is of a component, and extra there; their sum is that it is of one which changed.

    A Gaussian that is gone and one that came in the same place are told apart by their shapes, where `point_posterior`
    sees that the density is still the same. Arguments as there.
    """
    return changed_share(joint, ratio, after)[:, None] * responsibilities(joint, points, after)[:-1]
