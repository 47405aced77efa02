"""The thesis's way: a mixture for each cloud, compared by optimal transport."""

import dataclasses
from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import numpy as np
from jaxtyping import Array as JaxArray
from jaxtyping import ArrayLike, Bool, Float

from gmmjax._programs import kept_jit
from gmmjax._typing import Array, Scalar
from gmmjax.changes.change import Changes, Kind
from gmmjax.changes.progress import Clock, Progress
from gmmjax.changes.config import DetectionConfig, Kinds
from gmmjax.changes.objects.consensus import CloudConsensus, cloud_consensus, merged, votes_of_pairs
from gmmjax.changes.detectors.count_significance import CountSettings, count_significance
from gmmjax.changes.detectors.greedy_removal import remove_changed
from gmmjax.changes.prepare.separate_clouds import PreparedCloud, PreparedPair, prepare_pair
from gmmjax.changes.detectors.unmatched_mass import unmatched_shares
from gmmjax.clouds import PointCloud
from gmmjax.errors import ComputationError
from gmmjax.mixtures import Fit, FitSettings, FitStatus, GaussianMixture, Prior
from gmmjax.mixtures.map_fits import default_noise_floor, fits_of
from gmmjax.transport import TransportStatus, exact_transport
from gmmjax.transport.ground_cost import euclidean

# The mixtures are compared in as few slots as they fit in: programs compile for these numbers only, and for K_max.
SLOTS = (8, 16)

# Real scans want more Gaussians than they are given; a message length this much above the best one (nats an
# observation) does not come back, and going down to one Gaussian would only cost time.
PATIENCE = 0.25


def separate_changes(
    before: ArrayLike | PointCloud, after: ArrayLike | PointCloud, config: DetectionConfig, report: Progress
) -> Changes:
    """Changes by Algorithm 1 ("greedy") or partial transport ("transport") between separate fits of the two clouds.

    Each cloud is fitted from several random starts; every pair of restarts is compared; points and Gaussians get the
    mean of the votes as probability. Arguments, errors and warnings as in `detect_changes`.
    """
    clock = Clock()
    report("Filtering the points", 0.0)
    pair = prepare_pair(before, after, config)
    clock.lap("preparation")
    report("Fitting the mixtures", 0.15)
    fits = _fit_both(pair, config, report)
    clock.lap("fits")
    report("Comparing the mixtures", 0.8)
    mixtures = _compacted(fits, pair.max_components)
    votes = _compare(mixtures, pair, config)
    clock.lap("comparison")
    report("Labelling the points", 0.9)
    clouds = pair.before, pair.after
    consensus_before = _consensus(clouds, mixtures[0], fits[0], votes.before, "disappeared", config)
    consensus_after = _consensus(clouds[::-1], mixtures[1], fits[1], votes.after, "appeared", config)
    items, labels_before, labels_after = merged(consensus_before, consensus_after)
    clock.lap("labels")
    report("Done", 1.0)
    return Changes(
        labels_before=pair.before.to_rows(labels_before, -1),
        labels_after=pair.after.to_rows(labels_after, -1),
        probability_before=pair.before.to_rows(consensus_before.probability, 0.0),
        probability_after=pair.after.to_rows(consensus_after.probability, 0.0),
        unobserved_before=np.zeros(pair.before.given, bool),
        unobserved_after=np.zeros(pair.after.given, bool),
        items=items,
        emd=votes.emd,
        config=config,
        diagnostics=_diagnostics(before, after, pair, fits, votes, clock, config),
    )


class _Votes(NamedTuple):
    """What the pairs of restarts say: for each restart and Gaussian, how many of the other cloud's restarts want it."""

    before: np.ndarray
    after: np.ndarray
    emd: float
    solved: int
    pairs: int


def _fit_both(pair: PreparedPair, config: DetectionConfig, report: Progress) -> tuple[Fit, Fit]:
    """The fits of both clouds with a leading axis of restarts; those that failed are left out."""
    total = 2 * config.number_of_restarts()
    done = iter(range(1, total + 1))
    keys = list(jax.random.split(jax.random.key(config.seed), config.number_of_restarts()))
    both = fits_of(
        [pair.before.weighted, pair.after.weighted],
        # The same starts for both, whichever is the earlier one: equal clouds have equal mixtures.
        [keys, keys],
        max_components=pair.max_components,
        prior=_prior(pair, config),
        starts=None,
        settings=FitSettings(patience=PATIENCE),
        precision="float64",
        devices=None,
        progress=lambda: report("Fitting the mixtures", 0.15 + 0.65 * next(done) / total),
    )
    before, after = (_finite(name, fits) for name, fits in zip(("before", "after"), both, strict=True))
    return before, after


def _prior(pair: PreparedPair, config: DetectionConfig) -> Prior | None:
    """What the config says of the Gaussians; None: nothing."""
    settings = (config.noise_floor, config.concentration, config.covariance_scale, config.noise_share)
    if all(setting is None for setting in settings):
        return None
    points = np.concatenate([pair.before.weighted.points, pair.after.weighted.points])
    return dataclasses.replace(config.over(Prior.figueiredo_jain(3, default_noise_floor(points))), tolerance=0.0)


def _finite(name: str, fits: Fit) -> Fit:
    finite = np.asarray(fits.result != FitStatus.not_finite)
    if not finite.any():
        raise ComputationError(f"{name}: no restart gave a mixture; raise noise_floor")
    kept: Fit = jax.tree.map(lambda leaf: leaf[finite], fits)
    return kept


def _compacted(fits: tuple[Fit, Fit], max_components: int) -> tuple[GaussianMixture, GaussianMixture]:
    """The mixtures of all restarts in the smallest common number of slots."""
    most = max(int(fit.mixture.live.sum(axis=1).max()) for fit in fits)
    slots = next((slots for slots in SLOTS if most <= slots <= max_components), max_components)
    with jax.enable_x64(True):
        compacted = jax.vmap(lambda mixture: mixture.compacted(slots))
        before, after = (jax.tree.map(np.asarray, compacted(fit.mixture)) for fit in fits)
    return before, after


def _compare(mixtures: tuple[GaussianMixture, GaussianMixture], pair: PreparedPair, config: DetectionConfig) -> _Votes:
    """Every pair of restarts at once."""
    masses = float(pair.before.weighted.mass.sum()), float(pair.after.weighted.mass.sum())
    with jax.enable_x64(True):
        if config.method == "greedy":
            compared = _greedy_pairs(*mixtures, kinds=config.kinds)
        else:
            compared = _transport_pairs(
                *mixtures, *masses, config.penalty, threshold=config.threshold, kinds=config.kinds
            )
        changed_before, changed_after, emd, valid = (np.asarray(part) for part in compared)
    if not valid.any():
        raise ComputationError("no pair of restarts could be compared: the transport problems were not solved")
    return _Votes(
        before=votes_of_pairs(changed_before.swapaxes(0, 1), valid.T),
        after=votes_of_pairs(changed_after, valid),
        emd=float(emd[valid].mean()),
        solved=int(valid.sum()),
        pairs=valid.size,
    )


_Compared = tuple[Bool[Array, "r0 r1 k0"], Bool[Array, "r0 r1 k1"], Float[Array, "r0 r1"], Bool[Array, "r0 r1"]]


@kept_jit
def _greedy_pairs(before: GaussianMixture, after: GaussianMixture, *, kinds: Kinds) -> _Compared:
    """Algorithm 1 for all pairs of restarts."""

    def compare(before: GaussianMixture, after: GaussianMixture) -> tuple[JaxArray, JaxArray, JaxArray, JaxArray]:
        removals = remove_changed(before, after, kinds)
        return removals.disappeared, removals.appeared, removals.emd_before, removals.valid

    return _over_pairs(compare)(before, after)


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
) -> _Compared:
    """Partial transport of point counts for all pairs of restarts."""

    def compare(before: GaussianMixture, after: GaussianMixture) -> tuple[JaxArray, JaxArray, JaxArray, JaxArray]:
        unmatched = unmatched_shares(before, after, points_before, points_after, penalty)
        distance = exact_transport(before.weights, after.weights, euclidean(before.means, after.means))
        valid = unmatched.valid & (distance.result == TransportStatus.optimal)
        disappeared = (unmatched.share_before > threshold) & (kinds != "appeared")
        appeared = (unmatched.share_after > threshold) & (kinds != "disappeared")
        return disappeared, appeared, distance.cost, valid

    return _over_pairs(compare)(before, after)


def _over_pairs(function: Callable[..., Any]) -> Callable[..., Any]:
    return jax.vmap(jax.vmap(function, in_axes=(None, 0)), in_axes=(0, None))


def _consensus(
    clouds: tuple[PreparedCloud, PreparedCloud],
    mixtures: GaussianMixture,
    fits: Fit,
    votes: np.ndarray,
    kind: Kind,
    config: DetectionConfig,
    settings: CountSettings = CountSettings(),
) -> CloudConsensus:
    """The changes of the first cloud, by the votes for the Gaussians in whose place it has significantly more points.

    The mixtures differ between restarts, and between samples of one scene; a change must show in the counts, too.
    """
    own, other = clouds
    significance = count_significance(mixtures, own.counted, other.counted, settings)
    votes = np.where(significance >= settings.significance, votes, 0.0)
    reference = int(np.argmin(fits.message_length))
    return cloud_consensus(own.points, mixtures, votes, significance, reference, kind, config.threshold)


def _diagnostics(
    before: ArrayLike | PointCloud,
    after: ArrayLike | PointCloud,
    pair: PreparedPair,
    fits: tuple[Fit, Fit],
    votes: _Votes,
    clock: Clock,
    config: DetectionConfig,
) -> dict[str, Any]:
    """Plain values for the record and the report."""
    return {
        "before": _cloud_diagnostics(before, pair.before, fits[0], config),
        "after": _cloud_diagnostics(after, pair.after, fits[1], config),
        "voxel_size": pair.voxel_size,
        "max_components": pair.max_components,
        "pairs_of_restarts": votes.pairs,
        "pairs_solved": votes.solved,
        "seconds": clock.seconds,
        "device": jax.devices()[0].device_kind,
        "precision": "float64",
    }


def _cloud_diagnostics(
    given: ArrayLike | PointCloud, cloud: PreparedCloud, fits: Fit, config: DetectionConfig
) -> dict[str, Any]:
    return {
        **cloud.diagnostics(given),
        "outliers": cloud.outliers,
        "points_fitted": len(cloud.weighted.mass),
        "restarts_failed": config.number_of_restarts() - len(fits.steps),
        "components": fits.mixture.live.sum(axis=1).tolist(),
        "message_length": np.round(fits.message_length, 3).tolist(),
        "steps": fits.steps.tolist(),
        "converged": np.asarray(fits.result == FitStatus.converged).tolist(),
    }
