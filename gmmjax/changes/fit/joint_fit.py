"""The joint mixture fitted on the host: several random starts, on a subsample, in the unit of the points."""

import functools
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float, Int, PRNGKeyArray

from gmmjax._host import padded_chunks, to_numpy
from gmmjax._programs import lru_jit
from gmmjax._typing import Array
from gmmjax.changes.fit.restart_fits import mixture_arrays, mixture_of, of_restarts, status_array, status_of
from gmmjax.clouds import canonical_order, morton_order
from gmmjax.comparison import (
    JointMixture,
    LabelledPoints,
    component_posterior,
    density_ratio,
    fit_joint_mixture_from_seeds,
    of_cloud,
    point_posterior,
)
from gmmjax.errors import ComputationError
from gmmjax.mixtures import (
    POINTS_OF_PRODUCT,
    Annihilated,
    FitSettings,
    FitStatus,
    Prior,
    Standardisation,
    failed,
    map_on_cores,
)
from gmmjax.transport import earth_movers_distance

# Points whose posterior is computed in one pass: one compiled shape for clouds of every size, which the caches hold.
CHUNK = 2048


class FramedPoints(NamedTuple):
    """What the restarts are fitted to: both clouds in an order and a frame that do not depend on which is the earlier.

    Attributes:
        points: of both clouds, in the frame, in the order of a space-filling curve.
        frame: from the unit of the points into that of the mixtures.
    """

    points: LabelledPoints
    frame: Standardisation

    @classmethod
    def of(cls, points: LabelledPoints) -> "FramedPoints":
        """Both clouds in their frame.

        Args:
            points: NumPy arrays in any unit.
        """
        # The same samples whichever cloud is the earlier one, spread evenly over space.
        order = canonical_order(np.asarray(points.points.points))
        order = order[morton_order(np.asarray(points.points.points)[order])]
        points = jax.tree.map(lambda leaf: leaf[order], points)
        frame = Standardisation.of(points.points)
        return cls(LabelledPoints(frame.enter(points.points), points.after), frame)


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

    @classmethod
    def of_arrays(cls, arrays: Mapping[str, np.ndarray], frame: Standardisation) -> "JointFits":
        """The fits that have a mixture, of all that `fit_joint_restarts` computed.

        Args:
            arrays: of all restarts.
            frame: that they were computed in.

        Raises:
            ComputationError: no restart gave a mixture.
        """
        finite = ~np.asarray(failed(status_of(arrays["result"])))
        if not finite.any():
            raise ComputationError(f"none of {len(finite)} restarts gave a joint mixture; raise noise_floor")
        kept = {name: values[finite] for name, values in arrays.items()}
        scores = kept["message_length"], kept["density_ratio"], kept["steps"], status_of(kept["result"])
        return cls(of_restarts(_joint_mixture, kept), *scores, frame)


def fit_joint_restarts(
    framed: FramedPoints,
    *,
    key: PRNGKeyArray,
    max_components: int,
    slots: int,
    prior: Prior,
    restarts: range,
    max_points: int,
    settings: FitSettings,
    progress: Callable[[], None] | None = None,
) -> dict[str, np.ndarray]:
    """Fits the joint mixture from several random starts, each on its own random subsample.

    A restart is the same whichever others are computed with it.

    Args:
        framed: both clouds.
        key: random key of the subsamples and the starts.
        max_components: components that annihilation starts from.
        slots: of the mixtures, at least as many: clouds with few points, which start from fewer components, share a
            program with larger ones.
        prior: tolerance and noise in the unit of the points.
        restarts: the numbers of those that are computed.
        max_points: of each subsample; where there are no more points, all are used.
        settings: how EM runs.
        progress: called after each restart, from any thread.

    Returns:
        The arrays of `RestartFits`, also of restarts that gave no mixture; see `JointFits.of_arrays`.
    """
    prior = framed.frame.enter_prior(prior)
    seed = np.asarray(jax.random.key_data(key)).tolist()

    def fit_one(restart: int, key: PRNGKeyArray) -> tuple[Annihilated[JointMixture], Array]:
        points = subsample(framed.points, max_points, seed, restart).padded()
        return _compiled_fit(points, key, prior, np.int32(max_components), slots=slots, settings=settings)

    # Of the restart's number alone. With JAX's default generator these are the keys of a `split` into any number.
    keys = [jax.random.fold_in(key, restart) for restart in restarts]
    fits, ratios = map_on_cores(fit_one, list(zip(restarts, keys, strict=True)), "float64", progress)
    joint: JointMixture = fits.mixture
    return {
        **mixture_arrays(joint.mixture),
        "share_after": joint.share_after,
        "noise_weight": joint.noise_weight,
        "log_noise": joint.log_noise,
        "message_length": fits.message_length,
        "density_ratio": ratios,
        "steps": fits.steps,
        "result": status_array(fits.result),
    }


def _joint_mixture(arrays: Mapping[str, np.ndarray]) -> JointMixture:
    return JointMixture(mixture_of(arrays), arrays["share_after"], arrays["noise_weight"], arrays["log_noise"])


@lru_jit
def _compiled_fit(
    points: LabelledPoints,
    key: PRNGKeyArray,
    prior: Prior,
    max_components: Int[Array, ""],
    *,
    slots: int,
    settings: FitSettings,
) -> tuple[Annihilated[JointMixture], Array]:
    fit = fit_joint_mixture_from_seeds(points, slots, prior, key, settings, max_components)
    return fit, density_ratio(fit.mixture)


def point_excess(
    fits: JointFits, points: Float[np.ndarray, "n 3"], after: bool, restart: int
) -> Float[np.ndarray, " n"]:
    """`point_posterior` of one restart.

    Args:
        fits: the joint mixtures.
        points: points of one cloud, in its unit.
        after: whether that is the after cloud.
        restart: which one.
    """
    (excess,) = _in_chunks(functools.partial(_chunk_points, after=after), fits, points, restart)
    return excess


def component_excess(
    fits: JointFits, points: Float[np.ndarray, "n 3"], after: bool, restart: int
) -> tuple[Float[np.ndarray, " n"], Int[np.ndarray, " n"]]:
    """By one restart the posterior that a point is of a component that changed, and that component's slot.

    See `component_posterior`; the slot is that of the component which explains most of the change.

    Args:
        fits: the joint mixtures.
        points: points of one cloud, in its unit.
        after: whether that is the after cloud.
        restart: which one.
    """
    return _in_chunks(functools.partial(_chunk_components, after=after), fits, points, restart)


def mixtures_distance(fits: JointFits) -> float:
    """Earth mover's distance between the two clouds' mixtures, in the unit of the points, mean over the restarts.

    The components are shared; each cloud has its own weights, normalised.
    """
    with jax.enable_x64(True):
        distances = [float(_distance(_restart(fits.joint, own))) for own in range(len(fits.steps))]
    return float(np.mean(distances)) * float(fits.frame.spread)


@lru_jit
def _distance(joint: JointMixture) -> Float[Array, ""]:
    # All slots, dead ones too: one program for fits of any size.
    return earth_movers_distance(of_cloud(joint, after=False), of_cloud(joint, after=True)).cost


def _restart(joint: JointMixture, restart: int) -> JointMixture:
    """The joint mixture of one restart, on the host: moved to the device each array would be a program of its own."""
    own: JointMixture = jax.tree.map(lambda leaf: np.asarray(leaf[restart]), joint)
    return own


def _in_chunks(function: Callable[..., tuple[Array, ...]], fits: JointFits, points: np.ndarray, restart: int) -> Any:
    framed = (points - fits.frame.origin) / fits.frame.spread
    with jax.enable_x64(True):
        joint, ratio = _restart(fits.joint, restart), fits.density_ratio[restart]
        parts = [to_numpy(function(joint, ratio, chunk)) for chunk in padded_chunks(framed, CHUNK)]
    return tuple(np.concatenate(part)[: len(points)] for part in zip(*parts, strict=True))


@lru_jit
def _chunk_points(
    joint: JointMixture, ratio: Float[Array, ""], chunk: Float[Array, "c 3"], *, after: bool
) -> tuple[Float[Array, " c"]]:
    return (_in_products(lambda points: point_posterior(joint, ratio, points, after), chunk),)


@lru_jit
def _chunk_components(
    joint: JointMixture, ratio: Float[Array, ""], chunk: Float[Array, "c 3"], *, after: bool
) -> tuple[Float[Array, " c"], Int[Array, " c"]]:
    def of_points(points: Array) -> tuple[Array, Array]:
        changed = component_posterior(joint, ratio, points, after)
        return jnp.sum(changed, axis=0), jnp.argmax(changed, axis=0).astype(jnp.int32)

    changed: tuple[Array, Array] = _in_products(of_points, chunk)
    return changed


def _in_products(function: Callable[[Array], Any], chunk: Float[Array, "c 3"]) -> Any:
    """The function's values for all points, for so many at a time that XLA has one thread for their matrix products.

    Shared out over threads, the last bits of a product would depend on the number of cores.
    """
    values = jax.lax.map(function, chunk.reshape(-1, POINTS_OF_PRODUCT, chunk.shape[1]))
    return jax.tree.map(jnp.ravel, values)


def subsample(points: LabelledPoints, size: int, seed: list[int], restart: int) -> LabelledPoints:
    """The random subsample of a restart, evenly over both clouds: one of each stretch along the order of the points.

    Args:
        points: of both clouds, along a space-filling curve.
        size: of the subsample, about; all of no more points.
        seed: of all restarts.
        restart: its number.
    """
    if len(points.after) <= size:
        return points
    generator = np.random.default_rng(seed)
    # One sequence for all restarts, one number of it a point: to where this restart's begin.
    generator.bit_generator.advance(restart * len(points.after))  # type: ignore[attr-defined]
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
