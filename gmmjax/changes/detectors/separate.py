"""Changes by a mixture for each cloud, compared by optimal transport: what the thesis's detectors have in common."""

import abc
import dataclasses
from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import numpy as np
from jaxtyping import Bool, Float

from gmmjax._typing import Array
from gmmjax.changes.change import Changes, Kind
from gmmjax.changes.config import DetectionConfig
from gmmjax.changes.detectors.count_significance import CountSettings, count_significance
from gmmjax.changes.detectors.detector import AbstractChangeDetector, Scan
from gmmjax.changes.objects.cloud_changes import CloudChanges
from gmmjax.changes.objects.consensus import ConsensusSettings, cloud_consensus, votes_of_pairs
from gmmjax.changes.objects.found import KINDS, Found
from gmmjax.changes.prepare.checking import NAMES
from gmmjax.changes.prepare.separate_clouds import PreparedCloud, PreparedPair, prepare_pair
from gmmjax.changes.progress import Clock, Progress, silent
from gmmjax.errors import ComputationError
from gmmjax.mixtures import Fit, FitSettings, FitStatus, GaussianMixture, Prior, default_noise_floor, fits_of
from gmmjax.pair import Pair, each

Compared = tuple[Bool[Array, "r0 r1 k0"], Bool[Array, "r0 r1 k1"], Float[Array, "r0 r1"], Bool[Array, "r0 r1"]]
"""For each pair of restarts which Gaussians changed, the earth mover's distance, and whether it could be compared."""


def over_pairs(function: Callable[..., Any]) -> Callable[..., Any]:
    """The function of two mixtures for every pair of restarts."""
    return jax.vmap(jax.vmap(function, in_axes=(None, 0)), in_axes=(0, None))


class _Votes(NamedTuple):
    """What the pairs of restarts say.

    Attributes:
        changed: for each restart and Gaussian the share of the other cloud's restarts by which it changed.
        emd: earth mover's distance, mean over the pairs.
        solved: pairs whose transport problems were solved.
        pairs: of restarts.
    """

    changed: Pair[np.ndarray]
    emd: float
    solved: int
    pairs: int


@dataclasses.dataclass(frozen=True)
class AbstractSeparateDetector(AbstractChangeDetector):
    """Each cloud is fitted from several random starts, and every pair of restarts is compared by optimal transport.

    Points and Gaussians get the mean of the votes as probability.

    Attributes:
        counts: which Gaussians have significantly more points than the other cloud in their place.
        slots: the mixtures are compared in as few slots as they fit in: programs compile for these numbers only, and
            for K_max. (): always K_max.
        patience: of annihilation. Real scans want more Gaussians than they are given; a message length this much above
            the best one (nats an observation) does not come back, and going down to one Gaussian would only cost time.
            Infinite: it goes down.
        consensus: how points are labelled with the Gaussians.
    """

    counts: CountSettings = CountSettings()
    slots: tuple[int, ...] = (8, 16)
    patience: float = 0.25
    consensus: ConsensusSettings = ConsensusSettings()

    @abc.abstractmethod
    def compare(self, mixtures: Pair[GaussianMixture], points: Pair[float]) -> Compared:
        """Compares every pair of restarts.

        Args:
            mixtures: of both clouds, with a leading axis of restarts, in float64.
            points: observations in either cloud.
        """

    def changes(self, scans: Pair[Scan], report: Progress = silent) -> Changes:
        """The record of what changed."""
        clock = Clock(report)
        clock.start("preparation", "Filtering the points", 0.0)
        pair = prepare_pair(scans.map(lambda scan: scan.cloud), self.config)
        clock.start("fits", "Fitting the mixtures", 0.15)
        fits = self._fit(pair, report)
        clock.start("comparison", "Comparing the mixtures", 0.8)
        mixtures = self._compacted(fits, pair.max_components)
        votes = self._votes(mixtures, pair)
        clock.start("labels", "Labelling the points", 0.9)
        found = Found(
            each(self._cloud_changes, pair.clouds, pair.clouds.swapped, mixtures, fits, votes.changed, KINDS),
            pair.clouds.map(lambda cloud: np.zeros(len(cloud.points), bool)),
        )
        items, labels = found.merged()
        clock.finish()
        diagnostics = _diagnostics(scans, pair, fits, votes, clock, self.config)
        return found.record(pair.clouds, items, labels, votes.emd, self.config, diagnostics)

    def _fit(self, pair: PreparedPair, report: Progress) -> Pair[Fit]:
        """The fits of both clouds with a leading axis of restarts; those that failed are left out."""
        restarts = self.config.number_of_restarts()
        done = iter(range(1, 2 * restarts + 1))
        keys = list(jax.random.split(jax.random.key(self.config.seed), restarts))
        both = fits_of(
            list(pair.clouds.map(lambda cloud: cloud.weighted)),
            # The same starts for both, whichever is the earlier one: equal clouds have equal mixtures.
            [keys, keys],
            max_components=pair.max_components,
            prior=_prior(pair, self.config),
            starts=None,
            settings=FitSettings(patience=self.patience),
            precision="float64",
            devices=None,
            progress=lambda: report("Fitting the mixtures", 0.15 + 0.65 * next(done) / (2 * restarts)),
        )
        return each(_finite, NAMES, Pair(*both))

    def _compacted(self, fits: Pair[Fit], max_components: int) -> Pair[GaussianMixture]:
        """The mixtures of all restarts in the smallest common number of slots."""
        most = max(int(fit.mixture.live.sum(axis=1).max()) for fit in fits)
        slots = next((slots for slots in self.slots if most <= slots <= max_components), max_components)
        with jax.enable_x64(True):
            compacted = jax.vmap(lambda mixture: mixture.compacted(slots))
            return fits.map(lambda fit: jax.tree.map(np.asarray, compacted(fit.mixture)))

    def _votes(self, mixtures: Pair[GaussianMixture], pair: PreparedPair) -> _Votes:
        """Every pair of restarts at once."""
        points = pair.clouds.map(lambda cloud: float(cloud.weighted.mass.sum()))
        with jax.enable_x64(True):
            compared = self.compare(mixtures, points)
            changed_before, changed_after, emd, valid = (np.asarray(part) for part in compared)
        if not valid.any():
            raise ComputationError("no pair of restarts could be compared: the transport problems were not solved")
        return _Votes(
            Pair(votes_of_pairs(changed_before.swapaxes(0, 1), valid.T), votes_of_pairs(changed_after, valid)),
            emd=float(emd[valid].mean()),
            solved=int(valid.sum()),
            pairs=valid.size,
        )

    def _cloud_changes(
        self,
        own: PreparedCloud,
        other: PreparedCloud,
        mixtures: GaussianMixture,
        fits: Fit,
        votes: np.ndarray,
        kind: Kind,
    ) -> CloudChanges:
        """The changes of one cloud, by the votes for the Gaussians in whose place it has significantly more points.

        The mixtures differ between restarts, and between samples of one scene; a change must show in the counts, too.
        """
        significance = count_significance(mixtures, own.counted, other.counted, self.counts)
        votes = np.where(significance >= self.counts.significance, votes, 0.0)
        reference = int(np.argmin(fits.message_length))
        threshold, settings = self.config.threshold, self.consensus
        return cloud_consensus(own.points, mixtures, votes, significance, reference, kind, threshold, settings)


def _prior(pair: PreparedPair, config: DetectionConfig) -> Prior | None:
    """What the config says of the Gaussians; None: nothing."""
    settings = (config.noise_floor, config.concentration, config.covariance_scale, config.noise_share)
    if all(setting is None for setting in settings):
        return None
    points = np.concatenate([cloud.weighted.points for cloud in pair.clouds])
    return dataclasses.replace(config.over(Prior.figueiredo_jain(3, default_noise_floor(points))), tolerance=0.0)


def _finite(name: str, fits: Fit) -> Fit:
    finite = np.asarray(fits.result != FitStatus.not_finite)
    if not finite.any():
        raise ComputationError(f"{name}: no restart gave a mixture; raise noise_floor")
    kept: Fit = jax.tree.map(lambda leaf: leaf[finite], fits)
    return kept


def _diagnostics(
    scans: Pair[Scan], pair: PreparedPair, fits: Pair[Fit], votes: _Votes, clock: Clock, config: DetectionConfig
) -> dict[str, Any]:
    """Plain values for the record and the report."""
    restarts = config.number_of_restarts()
    clouds = each(lambda *of_cloud: _cloud_diagnostics(restarts, *of_cloud), scans, pair.clouds, fits)
    return {
        "before": clouds.before,
        "after": clouds.after,
        "voxel_size": pair.voxel_size,
        "max_components": pair.max_components,
        "pairs_of_restarts": votes.pairs,
        "pairs_solved": votes.solved,
        "seconds": clock.seconds,
        "device": jax.devices()[0].device_kind,
        "precision": "float64",
    }


def _cloud_diagnostics(restarts: int, scan: Scan, cloud: PreparedCloud, fits: Fit) -> dict[str, Any]:
    return {
        **cloud.diagnostics(scan.cloud),
        "outliers": cloud.outliers,
        "points_fitted": len(cloud.weighted.mass),
        "restarts_failed": restarts - len(fits.steps),
        "components": fits.mixture.live.sum(axis=1).tolist(),
        "message_length": np.round(fits.message_length, 3).tolist(),
        "steps": fits.steps.tolist(),
        "converged": np.asarray(fits.result == FitStatus.converged).tolist(),
    }
