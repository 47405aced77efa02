"""The joint mixture fitted on the host: several random starts, on a subsample, in the unit of the points."""

import functools
from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float, Int, PRNGKeyArray

from gmmjax._host import to_numpy
from gmmjax._programs import kept_jit
from gmmjax._typing import Array
from gmmjax.changes.fit.joint_mixture import JointMixture, component_posterior, density_ratio, point_posterior
from gmmjax.changes.fit.joint_mixture_model import SourcedPoints, fit_joint_mixture_from_seeds
from gmmjax.clouds import canonical_order, morton_order
from gmmjax.errors import ComputationError
from gmmjax.mixtures import Annihilated, FitSettings, FitStatus, GaussianMixture, Prior, Standardisation, map_on_cores
from gmmjax.transport import earth_movers_distance

# Points whose posterior is computed in one pass: one compiled shape for clouds of every size.
CHUNK = 8192


class JointFits(NamedTuple):
    """Joint mixtures of several restarts, in the frame that they were computed in.

    Attributes:
        joint: the mixtures, with a leading axis of r restarts.
        message_length: of each; comparable where the restarts saw the same points.
        density_ratio: of each, after to before.
        steps: EM steps of each.
        result: a `FitStatus` for each.
        frame: from the unit of the points into that of the mixtures.
    """

    joint: JointMixture
    message_length: Float[np.ndarray, " r"]
    density_ratio: Float[np.ndarray, " r"]
    steps: Int[np.ndarray, " r"]
    result: FitStatus
    frame: Standardisation


def fit_joint_restarts(
    points: SourcedPoints,
    *,
    key: PRNGKeyArray,
    max_components: int,
    slots: int,
    prior: Prior,
    restarts: int,
    max_points: int,
    settings: FitSettings,
    progress: Callable[[], None] | None = None,
) -> JointFits:
    """Fits the joint mixture from several random starts, each on its own random subsample.

    Args:
        points: both clouds, NumPy arrays in any unit.
        key: random key of the subsamples and the starts.
        max_components: components that annihilation starts from.
        slots: of the mixtures, at least as many: clouds with few points, which start from fewer components, share a
            program with larger ones.
        prior: tolerance and noise in the unit of the points.
        restarts: how many.
        max_points: of each subsample; where there are no more points, all are used.
        settings: how EM runs.
        progress: called after each restart, from any thread.

    Raises:
        ComputationError: no restart gave a mixture.
    """
    # The same samples whichever cloud is the earlier one, spread evenly over space.
    order = canonical_order(np.asarray(points.points.points))
    order = order[morton_order(np.asarray(points.points.points)[order])]
    points = jax.tree.map(lambda leaf: leaf[order], points)
    frame = Standardisation.of(points.points)
    framed = SourcedPoints(frame.enter(points.points), points.after)
    prior = frame.enter_prior(prior)
    generator = np.random.default_rng(np.asarray(jax.random.key_data(key)).tolist())
    samples = [_subsample(framed, max_points, generator).padded() for _ in range(restarts)]
    keys = jax.random.split(key, restarts)

    def fit_one(key: PRNGKeyArray, points: SourcedPoints) -> tuple[Annihilated[JointMixture], Array]:
        return _compiled_fit(points, key, prior, np.int32(max_components), slots=slots, settings=settings)

    fits, ratios = map_on_cores(fit_one, list(zip(keys, samples, strict=True)), "float64", progress)
    finite = np.asarray(fits.result != FitStatus.not_finite)
    if not finite.any():
        raise ComputationError(f"none of {restarts} restarts gave a joint mixture; raise noise_floor")
    fits, ratios = jax.tree.map(lambda leaf: leaf[finite], (fits, ratios))
    return JointFits(fits.mixture, fits.message_length, ratios, fits.steps, fits.result, frame)


@kept_jit
def _compiled_fit(
    points: SourcedPoints,
    key: PRNGKeyArray,
    prior: Prior,
    max_components: Int[Array, ""],
    *,
    slots: int,
    settings: FitSettings,
) -> tuple[Annihilated[JointMixture], Array]:
    fit = fit_joint_mixture_from_seeds(points, slots, prior, key, settings, max_components)
    return fit, density_ratio(fit.mixture)


def point_excess(fits: JointFits, points: Float[np.ndarray, "n 3"], after: bool) -> Float[np.ndarray, "r n"]:
    """`point_posterior` for each restart.

    Args:
        fits: the joint mixtures.
        points: points of one cloud, in its unit.
        after: whether that is the after cloud.
    """
    (excess,) = _in_chunks(functools.partial(_chunk_points, after=after), fits, points)
    return excess


def component_excess(
    fits: JointFits, points: Float[np.ndarray, "n 3"], after: bool
) -> tuple[Float[np.ndarray, "r n"], Int[np.ndarray, "r n"]]:
    """For each restart the posterior that a point is of a component that changed, and that component's slot.

    See `component_posterior`; the slot is that of the component which explains most of the change.

    Args:
        fits: the joint mixtures.
        points: points of one cloud, in its unit.
        after: whether that is the after cloud.
    """
    return _in_chunks(functools.partial(_chunk_components, after=after), fits, points)


def mixtures_distance(fits: JointFits) -> float:
    """Earth mover's distance between the two clouds' mixtures, in the unit of the points, mean over the restarts.

    The components are shared; each cloud has its own weights, normalised.
    """
    with jax.enable_x64(True):
        distances = np.asarray(_distances(jax.tree.map(jnp.asarray, fits.joint)))
    return float(distances.mean()) * float(fits.frame.spread)


@kept_jit
def _distances(joint: JointMixture) -> Float[Array, " r"]:
    def one_restart(joint: JointMixture) -> Array:
        # All slots, dead ones too: one program for fits of any size.
        before, after = (_reweighted(joint.mixture, share) for share in (1 - joint.share_after, joint.share_after))
        return earth_movers_distance(before, after).cost

    return jax.lax.map(one_restart, joint)


def _reweighted(mixture: GaussianMixture, share: Float[Array, " k"]) -> GaussianMixture:
    weights = mixture.weights * share
    return GaussianMixture(weights / jnp.sum(weights), mixture.means, mixture.covariances, mixture.live)


def _in_chunks(function: Callable[..., tuple[Array, ...]], fits: JointFits, points: np.ndarray) -> Any:
    framed = (points - fits.frame.origin) / fits.frame.spread
    padded = np.pad(framed, ((0, -len(points) % CHUNK), (0, 0)))
    with jax.enable_x64(True):
        joint, ratio = jax.tree.map(jnp.asarray, (fits.joint, fits.density_ratio))
        parts = [to_numpy(function(joint, ratio, chunk)) for chunk in np.split(padded, len(padded) // CHUNK)]
    return tuple(np.concatenate(part, axis=1)[:, : len(points)] for part in zip(*parts, strict=True))


@kept_jit
def _chunk_points(
    joint: JointMixture, ratio: Float[Array, " r"], chunk: Float[Array, "c 3"], *, after: bool
) -> tuple[Float[Array, "r c"]]:
    def one_restart(restart: tuple[JointMixture, Array]) -> Array:
        one, ratio = restart
        return point_posterior(one, ratio, chunk, after)

    return (jax.lax.map(one_restart, (joint, ratio)),)


@kept_jit
def _chunk_components(
    joint: JointMixture, ratio: Float[Array, " r"], chunk: Float[Array, "c 3"], *, after: bool
) -> tuple[Float[Array, "r c"], Int[Array, "r c"]]:
    def one_restart(restart: tuple[JointMixture, Array]) -> tuple[Array, Array]:
        one, ratio = restart
        changed = component_posterior(one, ratio, chunk, after)
        return jnp.sum(changed, axis=0), jnp.argmax(changed, axis=0).astype(jnp.int32)

    return jax.lax.map(one_restart, (joint, ratio))


def _subsample(points: SourcedPoints, size: int, generator: np.random.Generator) -> SourcedPoints:
    """A random subsample, evenly over both clouds: one of each stretch along the order of the points."""
    if len(points.after) <= size:
        return points
    priority = generator.random(len(points.after))
    chosen = []
    for source in (0, 1):
        own = np.flatnonzero(points.after == source)
        stretch = np.arange(len(own)) * (size * len(own) // len(points.after)) // len(own)
        order = np.lexsort((priority[own], stretch))
        first = np.flatnonzero(np.diff(stretch, prepend=-1))
        chosen.append(own[order[first]])
    rows = np.sort(np.concatenate(chosen))
    return jax.tree.map(lambda leaf: leaf[rows], points)
