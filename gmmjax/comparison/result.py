"""Result of a comparison of two clouds, and the average of several."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float, Int

from gmmjax._host import float64_on_host, is_traced
from gmmjax._programs import lru_jit
from gmmjax._typing import Array
from gmmjax.errors import InputError, warn
from gmmjax.mixtures import FitStatus, GaussianMixture, failed
from gmmjax.transport import TransportStatus

# The statuses by their numbers, in words.
FIT_STATUSES: tuple[str, ...] = tuple(FitStatus._index_to_message)
TRANSPORT_STATUSES: tuple[str, ...] = tuple(TransportStatus._index_to_message)


class Comparison(eqx.Module):
    """Changes between two clouds by one restart.

    Where a fit or a transport problem failed (`failed`), all numbers are NaN, as are their derivatives, and nothing
    disappeared or appeared. Derivatives are also NaN where a fit did not come to rest: `fit_before`, `fit_after`.

    Attributes:
        probability_before: of each point of the before cloud that it disappeared, 0 to 1; 0 for padding. It is the sum
            over the components of the responsibility for the point times how much of the component changed.
        probability_after: of each point of the after cloud that it appeared.
        changed_before: how much of each component of the before cloud disappeared, 0 to 1.
        changed_after: how much of each component of the after cloud appeared.
        disappeared: the components of the before cloud of which more than half disappeared.
        appeared: the components of the after cloud of which more than half appeared.
        emd: earth mover's distance between the mixtures, in the unit of the points (2.22).
        emd_unchanged: the same without the components that disappeared or appeared; NaN where there are no other ones.
        plan: of `emd`: the weight moved from each component before to each component after; its derivatives are NaN.
        mixture_before: of the before cloud, in the unit of the points.
        mixture_after: of the after cloud.
        log_likelihood: of the observations of both clouds, nats.
        fit_before: how the fit of the before cloud ended; of "joint", that of both.
        fit_after: the same of the after cloud.
        transport: how the transport problems ended.
    """

    probability_before: Float[Array, "*batch n0"]
    probability_after: Float[Array, "*batch n1"]
    changed_before: Float[Array, "*batch k0"]
    changed_after: Float[Array, "*batch k1"]
    disappeared: Bool[Array, "*batch k0"]
    appeared: Bool[Array, "*batch k1"]
    emd: Float[Array, "*batch"]
    emd_unchanged: Float[Array, "*batch"]
    plan: Float[Array, "*batch k0 k1"]
    mixture_before: GaussianMixture
    mixture_after: GaussianMixture
    log_likelihood: Float[Array, "*batch"]
    fit_before: FitStatus
    fit_after: FitStatus
    transport: TransportStatus

    @property
    def failed(self) -> Bool[Array, "*batch"]:
        """True without a result; one value for each of a batch."""
        unsolved = self.transport != TransportStatus.optimal
        return failed(self.fit_before) | failed(self.fit_after) | unsolved

    @property
    def at_rest(self) -> Bool[Array, "*batch"]:
        """True if both fits converged; else a polished comparison has values, and NaN as derivatives."""
        return (self.fit_before == FitStatus.converged) & (self.fit_after == FitStatus.converged)

    def why_failed(self) -> str:
        """The reason of the first comparison that failed, in words; on the host only, and empty where none did."""
        for status, names, bad in (
            (self.fit_before, FIT_STATUSES, failed(self.fit_before)),
            (self.fit_after, FIT_STATUSES, failed(self.fit_after)),
            (self.transport, TRANSPORT_STATUSES, self.transport != TransportStatus.optimal),
        ):
            lanes = np.flatnonzero(np.asarray(bad))
            if len(lanes):
                (numbers,) = jax.tree.leaves(status)
                return names[int(np.ravel(numbers)[lanes[0]])]
        return ""


class AveragedComparison(eqx.Module):
    """The mean of several comparisons of one pair of clouds, such as of random restarts.

    Comparisons that failed are left out. Where all failed the means are NaN; where one is left, the standard errors.

    Attributes:
        probability_before: of each point of the before cloud that it disappeared.
        probability_after: of each point of the after cloud that it appeared.
        error_before: standard error of the mean for each point of the before cloud.
        error_after: the same of the after cloud.
        emd: earth mover's distance, in the unit of the points.
        emd_unchanged: without the components that changed, mean over the comparisons where it is defined.
        used: how many comparisons these are the means of.
        fits_before: how many of all ended with each `FitStatus`, in their order.
        fits_after: the same of the after cloud.
        transports: how many of all ended with each `TransportStatus`.
    """

    probability_before: Float[Array, "*batch n0"]
    probability_after: Float[Array, "*batch n1"]
    error_before: Float[Array, "*batch n0"]
    error_after: Float[Array, "*batch n1"]
    emd: Float[Array, "*batch"]
    emd_unchanged: Float[Array, "*batch"]
    used: Int[Array, "*batch"]
    fits_before: Int[Array, "*batch fit_statuses"]
    fits_after: Int[Array, "*batch fit_statuses"]
    transports: Int[Array, "*batch transport_statuses"]


def averaged(comparison: Comparison) -> AveragedComparison:
    """The mean over a leading axis of comparisons of one pair, such as restarts, with standard errors.

    A pure function: for many pairs, `jax.vmap(averaged)`. On the host it warns of comparisons that were left out.

    Args:
        comparison: with a leading axis of r comparisons in every leaf.

    Raises:
        InputError: no leading axis.

    Warns:
        InputWarning: some comparisons failed; it says how many, and why the first one did.
    """
    if jnp.ndim(comparison.emd) != 1:
        raise InputError(
            f"comparison has {jnp.ndim(comparison.emd)} leading axes; give one, of restarts (jax.vmap takes off others)"
        )
    means: AveragedComparison = mean_of_restarts(comparison)
    if not is_traced(comparison) and (lost := int(np.sum(comparison.failed))):
        warn(f"{lost} of {len(comparison.emd)} comparisons failed and are left out: {comparison.why_failed()}")
    return means


# One program: as forty operations they would take a second to compile.
@float64_on_host
@lru_jit
def mean_of_restarts(comparison: Comparison) -> AveragedComparison:
    """`averaged` for whoever warns in words of its own."""
    used = ~jnp.asarray(comparison.failed)
    of_before, of_after = comparison.probability_before, comparison.probability_after
    defined = used & jnp.isfinite(comparison.emd_unchanged)
    return AveragedComparison(
        _mean(of_before, used),
        _mean(of_after, used),
        _standard_error(of_before, used),
        _standard_error(of_after, used),
        _mean(comparison.emd, used),
        _mean(comparison.emd_unchanged, defined),
        jnp.sum(used),
        _counts(comparison.fit_before, FIT_STATUSES),
        _counts(comparison.fit_after, FIT_STATUSES),
        _counts(comparison.transport, TRANSPORT_STATUSES),
    )


def _mean(values: Float[Array, "r ..."], used: Bool[Array, " r"]) -> Float[Array, "..."]:
    """NaN where none is used; those that are not used have no derivatives."""
    mask = used.reshape(-1, *(1 for _ in jnp.shape(values)[1:]))
    count = jnp.sum(used, dtype=jnp.asarray(values).dtype)
    total = jnp.sum(jnp.where(mask, values, 0), axis=0)
    return jnp.where(count > 0, total / jnp.maximum(count, 1), jnp.nan)


def _standard_error(values: Float[Array, "r n"], used: Bool[Array, " r"]) -> Float[Array, " n"]:
    mean, count = _mean(values, used), jnp.sum(used, dtype=jnp.asarray(values).dtype)
    squares = jnp.sum(jnp.where(used[:, None], (values - mean[None]) ** 2, 0), axis=0)
    variance = squares / jnp.maximum(count - 1, 1) / jnp.maximum(count, 1)
    # The root of 0 has an infinite derivative.
    error = jnp.where(variance > 0, jnp.sqrt(jnp.where(variance > 0, variance, 1)), 0)
    return jnp.where(count > 1, error, jnp.nan)


def _counts(status: FitStatus | TransportStatus, names: tuple[str, ...]) -> Int[Array, " s"]:
    (numbers,) = jax.tree.leaves(status)
    statuses = jnp.arange(len(names), dtype=jnp.int32)
    return jnp.sum(jnp.asarray(numbers)[:, None] == statuses[None], axis=0)
